"""When a run takes its steps: segments between sample times and the times at which objects join."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TimeTable:
    """Segments between consecutive sample and start times.

    end (K,) [s]; steps (K,): substeps in the segment; sample (K,): index of the sample taken at its end or
    -1; joins (n,): first segment in which an object moves, -1 where it moves already.
    """

    end: Array
    steps: NDArray[np.int32]
    sample: NDArray[np.int32]
    joins: NDArray[np.int32]


def time_table(world: World, sample_times: Array, begin: float | None = None) -> TimeTable:
    """Segments of a run; every substep is at most `world.time.substep` at the world's own seconds_per_frame.

    begin: time of the saved state that the run goes on from [s]; default: it starts at 0.
    """
    first = 0.0 if begin is None else begin
    starts = np.array([o.start_time for o in world.objects])
    every = np.concatenate([starts, [getattr(d, "start_time", 0.0) for d in world.deformables]])
    inner = every[(every > first) & (every < sample_times[-1])]
    end = np.unique(np.concatenate([sample_times, inner]))
    before = np.concatenate([[first], end[:-1]])
    # A ratio that is whole but for rounding is whole: 0.04 / 0.002 makes 20 substeps, not 21.
    steps = np.ceil((end - before) / world.time.substep * (1.0 - 1e-12)).astype(np.int32)
    sample = np.full(len(end), -1, dtype=np.int32)
    sample[np.searchsorted(end, sample_times)] = np.arange(len(sample_times), dtype=np.int32)
    joins = np.searchsorted(before, starts).astype(np.int32)
    joins[starts <= 0] = 0
    if begin is not None:
        joins[(starts <= 0) | (starts < begin)] = -1
    return TimeTable(end, steps, sample, joins)


@dataclass(frozen=True)
class Schedules:
    """Time tables of S lists of sample times, filled up with segments that nobody reaches.

    end, steps, sample (S, K): as in `TimeTable`. joins (n,): the same in all of them. reach (S, T): number of segments
    to each sample, and to the last one beyond it.
    """

    end: Array
    steps: NDArray[np.int32]
    sample: NDArray[np.int32]
    joins: NDArray[np.int32]
    reach: NDArray[np.int32]

    def segments(self, schedule: NDArray[np.int64], samples: NDArray[np.int64]) -> NDArray[np.int32]:
        """Return how many segments (W,) worlds of these schedules (W,) take to their first `samples`."""
        found: NDArray[np.int32] = self.reach[schedule, samples - 1]
        return found


@wp.struct
class Schedule:
    """Schedules as kernels read them, see `Schedules`; own (W,): that of each world, reach (W,): its segments.

    begin (W,): time of the state in the solver's buffers that a run goes on from, negative where it starts [s].
    """

    end: wp.array2d[wp.float64]
    steps: wp.array2d[wp.int32]
    sample: wp.array2d[wp.int32]
    joins: wp.array[wp.int32]
    own: wp.array[wp.int32]
    reach: wp.array[wp.int32]
    begin: wp.array[wp.float64]


def schedule_record(table: Schedules, n_worlds: int) -> Schedule:
    """Return schedules with room for those of `n_worlds` worlds, `own` and `reach`."""
    record = Schedule()
    record.end = buffers.doubles(table.end)
    record.steps, record.sample = buffers.ints(table.steps), buffers.ints(table.sample)
    record.joins = buffers.ints(table.joins)
    record.begin = buffers.full((n_worlds,), -1.0, wp.float64)
    record.own, record.reach = buffers.zeros((n_worlds,), wp.int32), buffers.zeros((n_worlds,), wp.int32)
    return record


def schedules(world: World, sample_times: Array, begin: float | None = None) -> Schedules:
    """Lay out S lists of sample times (S, T), each filled up with NaN; begin: see `time_table`.

    Raises ValueError for several lists where objects join later than the start: they would join in different segments.
    """
    rows = [row[np.isfinite(row)] for row in sample_times]
    tables = [time_table(world, row, begin) for row in rows]
    if len(tables) > 1 and any(o.start_time > 0.0 for o in world.objects):
        raise ValueError("one list of sample times only where objects join later than the start")
    longest = max(len(t.end) for t in tables)
    end = np.zeros((len(tables), longest))
    steps, sample = np.zeros(end.shape, dtype=np.int32), np.full(end.shape, -1, dtype=np.int32)
    reach = np.zeros(sample_times.shape, dtype=np.int32)
    for s, table in enumerate(tables):
        count = len(table.end)
        end[s, :count], steps[s, :count], sample[s, :count] = table.end, table.steps, table.sample
        reach[s] = count
        reach[s, : len(rows[s])] = np.flatnonzero(table.sample >= 0) + 1
    return Schedules(end, steps, sample, tables[0].joins, reach)
