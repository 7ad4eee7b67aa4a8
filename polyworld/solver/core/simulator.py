"""Roll out worlds of rigid bodies: schedules, overrides, threads and outcomes, the same in planar and in spatial."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers, interruption
from polyworld.core.cores import available_cores
from polyworld.model import Model
from polyworld.model.arrays import RigidArrays
from polyworld.solver.core.episodes import ContactLog
from polyworld.solver.core.patience import TooLong, in_words, time_limit
from polyworld.solver.core.saved_state import SavedState, arrays_of, copied, write_back
from polyworld.solver.core.thread_pool import run_in_pool, shares
from polyworld.solver.core.time_table import TimeTable, schedule_record, schedules, time_table
from polyworld.trajectory import BatchTrajectory, Event, Truncation

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@wp.struct
class Outcome:
    """How runs ended (W,): the object that diverged, -1 for none, and when [s].

    overflowed: above 0 where there was no room for all contacts; what follows the time then is worthless.
    """

    diverged_object: wp.array[wp.int32]
    diverged_time: wp.array[wp.float64]
    overflowed: wp.array[wp.int32]


@dataclass(frozen=True)
class Batch:
    """W worlds that were rolled out: their parameters, schedules (W,), sample times (W, T) [s], and which diverged or
    were truncated (W,).

    count: T, of the samples reached.
    """

    arrays: RigidArrays
    schedule: Ints
    count: int
    times: Array
    diverged: NDArray[np.bool_]
    truncated: NDArray[np.bool_]

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.schedule)


def check_samples(most: int, samples: int | Ints | None) -> Ints:
    """Return how many sample times are to be reached, by all worlds or by each; ValueError beyond 1 to `most`."""
    each: Ints = np.asarray(most if samples is None else samples)
    if each.min() < 1 or each.max() > most:
        raise ValueError(f"samples must lie in 1..{most}, got {samples}")
    return each


def check_worlds(capacity: int, overrides: Mapping[str, Array] | None, schedule: Ints | None) -> int:
    """Return how many worlds a run is of: all there is room for, or as many as `schedule` names.

    Raises ValueError where there is no room for them, or overrides hold other numbers of values.
    """
    worlds = capacity if schedule is None else len(schedule)
    if not 1 <= worlds <= capacity:
        raise ValueError(f"schedule names {worlds} worlds; there is room for 1 to {capacity}")
    lengths = {len(np.atleast_1d(v)) for v in (overrides or {}).values()}
    if lengths - {worlds}:
        raise ValueError(f"overrides must hold {worlds} values, one a world; got {sorted(lengths)}")
    return worlds


class RigidSimulator(ABC):
    """W variants of one world of rigid bodies, run in one kernel launch per share of the worlds.

    See `polyworld.solver.rollout.simulator`. Buffers are allocated once and written in place on every run. Worlds whose
    contacts did not fit are run again with more room, which does not change what they do.
    """

    def __init__(
        self,
        model: Model,
        sample_times: Array,
        *,
        n_worlds: int = 1,
        record_events: bool = False,
        threads: int | None = None,
        episodes: int | None = None,
        start: SavedState | None = None,
    ) -> None:
        """episodes: contact episodes that a world has room for at first, see `ContactLog`. start: the state that all
        worlds go on from."""
        self.model, self.world = model, model.world
        self.names = tuple(o.name for o in self.world.objects)
        self.n_worlds = n_worlds
        self.sample_times = np.atleast_2d(np.asarray(sample_times, dtype=float))
        self.record_events = record_events
        self.threads = (threads or available_cores()) if buffers.threads_serve() else 1
        # Scratch rows: worlds that a CPU's thread takes one after the other use the same, others each its own.
        self._apart = int(not buffers.threads_serve())
        self._slots = n_worlds if self._apart else shares(n_worlds, self.threads)
        self._start = start
        self.patience = math.inf  # [s] of one run
        self._table = schedules(self.world, self.sample_times, None if start is None else start.time)
        self._schedule = schedule_record(self._table, n_worlds)
        self._outcome = Outcome()
        self._outcome.diverged_object = buffers.zeros((n_worlds,), wp.int32)
        self._outcome.diverged_time = buffers.zeros((n_worlds,), wp.float64)
        self._outcome.overflowed = buffers.zeros((n_worlds,), wp.int32)
        self._own, self._reach = buffers.Mirror(self._schedule.own), buffers.Mirror(self._schedule.reach)
        self._steps = buffers.Mirror(self._schedule.steps)
        self._diverged_object = buffers.Mirror(self._outcome.diverged_object)
        self._diverged_time = buffers.Mirror(self._outcome.diverged_time)
        self._overflowed = buffers.Mirror(self._outcome.overflowed)
        self._outcomes = (self._diverged_object, self._diverged_time, self._overflowed)
        all_names = self.names + tuple(s.name for s in self.world.statics)
        self._log = ContactLog(n_worlds, self.names, all_names, record=record_events, capacity=episodes)
        self._build(model)

    def slowest_part(self) -> str:
        """See `polyworld.solver.rollout.Simulator`."""
        shares = f" in {self.n_worlds} worlds" if self.n_worlds > 1 else ""
        return (
            f"{len(self.names)} rigid objects{shares} take steps of {self.world.time.substep:g} s, each as long as all "
            "their contacts and joints together need: fewer objects, or less different masses, take less"
        )

    def run(
        self,
        overrides: Mapping[str, Array] | None = None,
        *,
        samples: int | Ints | None = None,
        schedule: Ints | None = None,
    ) -> BatchTrajectory:
        """Roll variants out from their initial state; see `polyworld.solver.rollout.Simulator`."""
        batch = self._roll(overrides, samples, schedule)
        positions, orientations, velocities, angular_velocities = self._states(batch)
        interruption.check()
        ended = {int(w): Truncation(float(self._diverged_time.values[w]), reason) for w, reason in self._reasons(batch)}
        for motion in (positions, orientations, velocities, angular_velocities):
            for w, truncation in ended.items():
                motion[w, batch.times[w] >= truncation.time] = np.nan
        starts = np.array([o.start_time for o in self.world.objects])
        return BatchTrajectory(
            names=self.names,
            times=batch.times,
            positions=positions,
            orientations=orientations,
            velocities=velocities,
            angular_velocities=angular_velocities,
            active=self.sample_times[0, : batch.count, None] >= starts[None, :],
            diverged=batch.diverged,
            diverged_time=np.where(batch.diverged, self._diverged_time.values[: batch.worlds], np.nan),
            diverged_object=self._diverged_object.values[: batch.worlds].astype(np.int64),
            events=self._events(batch),
            truncated=ended,
            contacts_until=tuple(self._log.complete_until(w) for w in range(batch.worlds)),
        )

    def _reasons(self, batch: Batch) -> list[tuple[int, str]]:
        """Return the truncated worlds and why they are."""
        why = "more contacts at once than there is memory for: objects overlap, or a mesh is too fine for them"
        return [(int(w), why) for w in np.flatnonzero(batch.truncated)]

    def _end_of_contacts(self, batch: Batch, slack: float) -> Array:
        """Return the times (W,) [s] to which contacts last that have not ended, `slack` before the end of the run.

        The last touch before a divergence lies up to a step before it: such a contact has not ended.
        """
        stopped = self._diverged_time.values[: batch.worlds] - 2.0 * self.world.time.substep
        ends: Array = np.where(batch.diverged | batch.truncated, stopped, np.nanmax(batch.times, axis=1) - slack)
        return ends

    def _roll(self, overrides: Mapping[str, Array] | None, samples: int | Ints | None, schedule: Ints | None) -> Batch:
        """Roll variants out; their states stay in the buffers."""
        each = check_samples(self.sample_times.shape[1], samples)
        count = int(each.max())
        worlds = check_worlds(self.n_worlds, overrides, schedule)
        arrays = self.model.arrays(overrides)
        own = np.zeros(worlds, dtype=np.int64) if schedule is None else schedule
        self._own.values[:worlds] = own
        self._reach.values[:worlds] = self._table.segments(own, each)
        self._own.push()
        self._reach.push()
        self._log.clear()
        again: Ints = np.arange(worlds)
        while len(again):
            self._expect(again)
            self._write(arrays, worlds)
            self._forget(again)
            if self._start is not None:
                self.restore(self._start)
            if self.names:
                self._launch(again)
            for kept in self._outcomes:
                kept.pull()
            again = self._short_of_room(worlds)
        truncated = self._overflowed.values[:worlds] > 0
        return Batch(
            arrays=arrays,
            schedule=own,
            count=count,
            times=self.sample_times[own, :count] * arrays.time_scale,
            diverged=(self._diverged_object.values[:worlds] >= 0) & ~truncated,
            truncated=truncated,
        )

    def _expect(self, worlds: Ints) -> None:
        """Set the outcome of some worlds to that of a run that reaches its end."""
        for kept, none in zip(self._outcomes, (-1, np.nan, 0), strict=True):
            kept.values[worlds] = none
            kept.push()

    def _short_of_room(self, worlds: int) -> Ints:
        """Make more room for what did not fit, and return the worlds (k,) to run again with it."""
        full: Ints = np.flatnonzero(self._overflowed.values[:worlds] > 0)
        short = self._log.short()
        if not (len(full) or len(short)):
            return full
        if len(full) and not self._enlarge():
            full = full[:0]
        short = np.setdiff1d(short, full)
        self._log.grow(short)
        again: Ints = np.union1d(full, short)
        self._log.clear(again)
        return again

    # --- one world, interval by interval ----------------------------------------------------------

    def begin(self) -> SavedState:
        """Put the only world where it starts, and return its state at time 0."""
        self._expect(np.zeros(1, dtype=np.int64))
        self._log.clear()
        self._own_arrays = self.model.arrays()
        self._write(self._own_arrays, 1)
        buffers.write(self._schedule.begin, -1.0)
        return self._interval(time_table(self.world, np.zeros(1)), 0.0, 0.0)

    def advance(self, state: SavedState, end: float) -> SavedState:
        """Advance the world from `state`, the last that was returned or restored, to the time `end` [s].

        Raises RuntimeError where it diverges or runs out of room for contacts.
        """
        buffers.write(self._schedule.begin, state.time)
        return self._interval(time_table(self.world, np.array([end]), state.time), state.time, end)

    def _interval(self, table: TimeTable, begin: float, end: float) -> SavedState:
        count = len(table.end)
        for name in ("end", "steps", "sample"):
            buffers.write(getattr(self._schedule, name), getattr(table, name), np.s_[0, :count])
        buffers.write(self._schedule.joins, table.joins, np.s_[: len(table.joins)])
        for kept, value in ((self._own, 0), (self._reach, count)):
            kept.values[0] = value
            kept.push()
        if self._log.reserve_for(end - begin):
            self._take_log()
        if self.names:
            self._launch(np.zeros(1, dtype=np.int64))
        if self._overflowed.pull()[0] > 0:
            raise RuntimeError(f"more contacts at once, before {end:.6g} s, than there is room for: objects overlap")
        diverged = int(self._diverged_object.pull()[0])
        if diverged >= 0:
            raise RuntimeError(
                f"{self.names[diverged]!r} diverged at {self._diverged_time.pull()[0]:.6g} s: go back to a "
                "saved state, and take a shorter time.substep or weaker control"
            )
        motion = (values[0, 0] for values in self._states(self._at(end)))
        return SavedState(self.world.id, end, self.names, *motion, memory={})

    def contacts(self, end: float) -> tuple[Event, ...]:
        """Return the contact events of the only world up to the time `end` [s]."""
        return self._events(self._at(end))[0]

    def _at(self, end: float) -> Batch:
        return Batch(self._own_arrays, np.zeros(1, dtype=np.int64), 1, np.full((1, 1), end), *np.zeros((2, 1), bool))

    @abstractmethod
    def control(
        self, forces: Array, torques: Array, efforts: Mapping[str, float], speeds: Mapping[str, float], /
    ) -> None:
        """Let forces and torques (n, 3), world axes, and motors by joint act until `release`."""

    @abstractmethod
    def release(self) -> None:
        """End what `control` began: motors act as the world describes them."""

    # --- states that a run goes on from ----------------------------------------------------------

    def save(self, motion: SavedState) -> SavedState:
        """Return `motion` with the memory of the only world, after a run that did not diverge."""
        return replace(motion, memory={**copied(self._remembered()), **self._log.saved()})

    def restore(self, state: SavedState) -> None:
        """Let the next launch go on from a state of this world; raises ValueError where it is of another."""
        if state.world_id != self.world.id:
            raise ValueError(
                f"the saved state is of {state.world_id}, this world is {self.world.id}: contacts and joints are "
                "remembered for the world they were saved in; to change a world on its way, describe one whose objects "
                "have the state's positions and velocities"
            )
        if self.n_worlds > 1:
            raise ValueError("a saved state is one world's: roll it out alone")
        write_back(self._remembered(), state.memory)
        self._log.restore(state.memory)
        buffers.write(self._schedule.begin, state.time)

    def _remembered(self) -> dict[str, Any]:
        """Arrays of the solver that outlast a launch, by name."""
        return {name: a for record, kind in self._records().items() for name, a in arrays_of(kind, record).items()}

    @abstractmethod
    def _records(self) -> dict[str, Any]:
        """Return the records whose arrays hold the state of a world, by name."""

    # ---------------------------------------------------------------------------------------------

    def _launch(self, worlds: Ints) -> None:
        """Launch the run of some worlds, in ascending order: as many at a time as follow each other."""
        kernel = self._kernel()
        pieces = shares(len(worlds), self.threads)
        edges = np.linspace(0, len(worlds), pieces + 1).astype(int)

        def piece(index: int) -> None:
            own = worlds[edges[index] : edges[index + 1]]
            gaps = np.flatnonzero(own[1:] - own[:-1] > 1) + 1
            for first, last in itertools.pairwise((0, *gaps.tolist(), len(own))):
                buffers.launch(kernel, last - first, self._inputs(int(own[first]), index))

        buffers.load_kernel(kernel)
        try:
            skip = self._skip_segments
            with interruption.current().stopping(skip), time_limit(self.patience, skip) as too_long:
                run_in_pool(piece, pieces, self.threads)
            if too_long.is_set():
                limit = f"its limit of {in_words(self.patience)} (patience)"
                raise TooLong(f"the rollout was stopped after {limit}. {self.slowest_part()}")
        except (interruption.Interrupted, TooLong):
            self._steps.values[...] = self._table.steps
            self._steps.push()
            raise

    def _skip_segments(self) -> None:
        """Leave a running kernel no more steps: it reads the number of them at the start of each segment.

        On CUDA the copy waits for the kernel, which runs to its end.
        """
        self._steps.values[...] = 0
        self._steps.push()

    @abstractmethod
    def _build(self, model: Model) -> None:
        """Lay the model out and make the buffers."""

    @abstractmethod
    def _kernel(self) -> Any:
        """Return the kernel that runs worlds from start to end."""

    @abstractmethod
    def _inputs(self, first: int, index: int, /) -> list[Any]:
        """Return the kernel's arguments for the share number `index` of the worlds, which begins with world `first`."""

    @abstractmethod
    def _write(self, arrays: RigidArrays, worlds: int, /) -> None:
        """Fill the device arrays of the first `worlds` worlds in place."""

    def _take_log(self) -> None:
        """Let kernels see the arrays of the contact log, which may have been replaced by longer ones."""
        return

    @abstractmethod
    def _forget(self, worlds: Ints) -> None:
        """Mark the samples of some worlds as not taken."""

    @abstractmethod
    def _enlarge(self) -> bool:
        """Make more room for contacts at one time; return False where memory does not allow it."""

    @abstractmethod
    def _states(self, batch: Batch) -> tuple[Array, Array, Array, Array]:
        """Return positions (W, T, n, 3), orientations (W, T, n, 4), velocities and angular velocities (W, T, n, 3)."""

    @abstractmethod
    def _events(self, batch: Batch) -> tuple[tuple[Event, ...], ...]:
        """Return the contact events of each world in order of time."""
