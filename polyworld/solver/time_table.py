"""When a run takes its steps: segments between sample times and the times at which objects join."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TimeTable:
    """Segments between consecutive sample and start times.

    end (K,) [s]; steps (K,): substeps in the segment; sample (K,): index of the sample taken at its end or
    -1; joins (n,): first segment in which an object moves.
    """

    end: Array
    steps: NDArray[np.int32]
    sample: NDArray[np.int32]
    joins: NDArray[np.int32]


def time_table(world: World, sample_times: Array) -> TimeTable:
    """Segments of a run; every substep is at most `world.time.substep` at the world's own seconds_per_frame."""
    starts = np.array([o.start_time for o in world.objects])
    every = np.concatenate([starts, [getattr(d, "start_time", 0.0) for d in world.deformables]])
    inner = every[(every > 0) & (every < sample_times[-1])]
    end = np.unique(np.concatenate([sample_times, inner]))
    before = np.concatenate([[0.0], end[:-1]])
    # A ratio that is whole but for rounding is whole: 0.04 / 0.002 makes 20 substeps, not 21.
    steps = np.ceil((end - before) / world.time.substep * (1.0 - 1e-12)).astype(np.int32)
    sample = np.full(len(end), -1, dtype=np.int32)
    sample[np.searchsorted(end, sample_times)] = np.arange(len(sample_times), dtype=np.int32)
    joins = np.searchsorted(before, starts).astype(np.int32)
    joins[starts <= 0] = 0
    return TimeTable(end, steps, sample, joins)
