"""The forward model: a world and a horizon in, motion and events out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from polyworld.core import interruption
from polyworld.model import model_of
from polyworld.solver.core.patience import PATIENCE, in_words
from polyworld.solver.core.saved_state import SavedState
from polyworld.solver.energy_watch import watch
from polyworld.solver.stepper import NO_COUPLED_STATE, Stepper, solver_of
from polyworld.trajectory import BatchTrajectory, Rollout
from polyworld.trajectory.events import all_events
from polyworld.world import World

Array = NDArray[np.float64]

MAX_SUBSTEPS = 2_000_000  # a second or so for six planar bodies, half a minute for six spatial ones
MAX_SAMPLES = 200_000  # some 100 bytes a sample and object
TIMED = 0.2  # [s] that are timed to predict a whole rollout: a hundred times the noise of a clock and a scheduler


class Simulator(Protocol):
    """W variants of one world, stepped together; buffers and graphs are kept from one run to the next."""

    names: tuple[str, ...]
    n_worlds: int

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        """Roll all variants out from their initial state.

        overrides: parameter path -> values (n_worlds,), see `polyworld.world.parameters`. samples: how many leading
        sample times to reach (default all).
        """
        ...

    def slowest_part(self) -> str:
        """Say what makes a run slow, after one."""
        ...


class ScheduledSimulator(Simulator, Protocol):
    """W variants or fewer of one rigid world, each sampled at one of S lists of times."""

    def run(
        self,
        overrides: Mapping[str, Array] | None = None,
        *,
        samples: int | NDArray[np.int64] | None = None,
        schedule: NDArray[np.int64] | None = None,
    ) -> BatchTrajectory:
        """As `Simulator.run`. schedule (W,), W <= n_worlds: which list of sample times each world has (default: the
        first in all n_worlds); times, and states, are NaN beyond the end of a shorter one. samples: of all worlds, or
        of each (W,)."""
        ...


def simulator(
    world: World,
    sample_times: Array,
    *,
    n_worlds: int = 1,
    record_events: bool = False,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
    start: SavedState | None = None,
    patience: float = math.inf,
) -> Simulator:
    """Return the simulator fitting the world's representations.

    sample_times (T,): increasing, >= 0 [s], at the world's own seconds_per_frame; a variant with another
    seconds_per_frame is sampled at proportionally other times. threads: default all cores; the result does
    not depend on it, to the bit. progress: called with the share done, 0 to 1, while worlds with deformable objects run
    (others are done before anyone asks); what it raises ends the run. patience: see `rollout`.
    """
    times = np.array(sample_times, dtype=float)
    if times.ndim != 1 or len(times) == 0:
        raise ValueError(f"sample_times must be a list of at least one time, got shape {times.shape}")
    if not np.all(np.isfinite(times)) or times[0] < 0 or np.any(np.diff(times) <= 0):
        raise ValueError("sample_times must be finite, not negative, and increase")
    if n_worlds < 1:
        raise ValueError(f"n_worlds must be at least 1, got {n_worlds}")
    if world.coupled:
        if start is not None:
            raise ValueError(NO_COUPLED_STATE)
        from polyworld.solver.coupled.simulator import CoupledSimulator

        return CoupledSimulator(
            model_of(world),
            times,
            n_worlds=n_worlds,
            record_events=record_events,
            threads=threads,
            progress=progress,
            patience=patience,
        )
    made = solver_of(world)(
        model_of(world), times, n_worlds=n_worlds, record_events=record_events, threads=threads, start=start
    )
    made.patience = patience
    return made


def scheduled_simulator(
    world: World, sample_times: Array, *, n_worlds: int = 1, threads: int | None = None
) -> ScheduledSimulator:
    """The simulator of a rigid world whose variants are sampled at times of their own.

    sample_times (S, T): lists of increasing times, >= 0 [s], each filled up with NaN. n_worlds: how many variants there
    is room for. Raises ValueError for worlds that hold deformable objects, or in which objects join later than the
    start where there are several lists.
    """
    times = np.array(sample_times, dtype=float)
    finite = np.isfinite(times)
    if times.ndim != 2 or not finite[:, 0].all() or np.any(finite[:, 1:] & ~finite[:, :-1]):
        raise ValueError("sample_times must be lists (S, T) that are filled up with NaN at their ends")
    if np.any(times[:, 0] < 0) or np.any(np.diff(times, axis=1)[finite[:, 1:]] <= 0):
        raise ValueError("sample_times must not be negative, and increase")
    if world.coupled:
        raise ValueError("worlds with deformable objects have one list of sample times: use `simulator`")
    return solver_of(world)(model_of(world), times, n_worlds=n_worlds, threads=threads)


def rollout(
    world: World,
    horizon: float,
    *,
    sample_interval: float | None = None,
    record_events: bool = True,
    progress: Callable[[float], None] | None = None,
    start: SavedState | None = None,
    patience: float = PATIENCE,
) -> Rollout:
    """Roll one world out to `horizon` [s], sampled every `sample_interval` [s] (default: one frame of the world, 0.04 s
    where it names no other).

    Samples are taken at 0, one interval, two, ... and at the horizon. record_events: False for the motion alone, which
    is the same; the rollout then has no events and says so (`Rollout.contacts_until`). progress: as for `simulator`.
    start: a state of this world, see `state_at`, that the run goes on from; the horizon still counts from time 0, and
    the result holds the samples and events from that state on. Where it was saved at a sample time they equal those of
    the whole run to the bit. patience: wall-clock seconds that the run may take; `predicted_cost` says what it will. A
    world with deformable objects that is predicted to take longer is refused after a second, with what makes it slow,
    and one that slows down later ends as truncated; one of rigid objects is stopped and refused. Raises ValueError for
    a horizon that is not positive, or asks for more than MAX_SUBSTEPS substeps or MAX_SAMPLES samples; TooLong, a
    ValueError.
    """
    times = sampled_times(world, horizon, sample_interval)
    _check_patience(patience)
    if start is not None:
        if not isinstance(start, SavedState):
            raise TypeError(
                f"start must be a SavedState, as `state_at` and `SavedState.from_bytes` return, not {start!r:.40}"
            )
        times = _times_from(start.time, times)
    machine = simulator(
        world, times, record_events=record_events, threads=1, progress=progress, start=start, patience=patience
    )
    batch, reasons = watch(machine.run(), [world], from_start=start is None)
    found = _rollout_of(world, batch, 0, horizon, reasons[0])
    return found if start is None else replace(found, events=tuple(e for e in found.events if e.time >= start.time))


@dataclass(frozen=True)
class Cost:
    """Predicted cost of a rollout on this machine: wall-clock seconds, its substeps, and what makes it slow."""

    seconds: float
    substeps: int
    cause: str

    def __str__(self) -> str:
        return f"about {in_words(self.seconds)} for {self.substeps} substeps. {self.cause}".strip()


def predicted_cost(world: World, horizon: float, *, sample_interval: float | None = None) -> Cost:
    """Predict what `rollout` takes from its first steps, timed for TIMED; contacts may make later ones slower.

    Building the world's meshes and loading its kernels come on top.
    """
    times = sampled_times(world, horizon, sample_interval)
    machine = simulator(world, times, record_events=True, threads=1)
    machine.run(samples=1)  # loads the kernels
    samples, seconds = 1, 0.0
    while seconds < TIMED and samples < len(times):
        samples = min(2 * samples, len(times))
        begin = time.perf_counter()
        machine.run(samples=samples)
        seconds = time.perf_counter() - begin
    share = times[samples - 1] / times[-1] if samples > 1 else 1.0
    return Cost(seconds / float(share), int(np.ceil(horizon / world.time.substep - 1e-9)), machine.slowest_part())


def state_at(
    world: World, time: float, *, sample_interval: float | None = None, start: SavedState | None = None
) -> SavedState:
    """Return the state of a world of rigid bodies at a time [s] of its rollout, for `rollout(start=...)`.

    sample_interval: of the rollout, of which `time` is best a multiple, for its steps end at samples. start: an earlier
    state to begin with. Raises ValueError for worlds with deformable objects, RuntimeError where the world diverges.
    """
    if world.coupled:
        raise ValueError(NO_COUPLED_STATE)
    if not (np.isfinite(time) and time >= 0.0):
        raise ValueError(f"time must be 0 or more, got {time}")
    stepper = Stepper(world, interval=sample_interval, start=start)
    times = sampled_times(world, time, sample_interval) if time > 0.0 else np.zeros(1)
    for end in times[1:] if start is None else _times_from(start.time, times)[1:]:
        stepper.advance_to(float(end))
    return stepper.save()


def _check_patience(patience: float) -> None:
    if not patience > 0.0:
        raise ValueError(f"patience must be positive seconds, or math.inf for no limit, got {patience}")


def _times_from(begin: float, times: Array) -> Array:
    """The sample times from a state at `begin` [s] on, itself the first; ValueError where there are none."""
    apart = 1e-9 * max(1.0, begin)
    if times[-1] <= begin + apart:
        raise ValueError(f"the saved state is at {begin:.6g} s: the end must lie beyond it, got {times[-1]:.6g} s")
    return np.concatenate([[begin], times[times > begin + apart]])


def rollouts(
    world: World,
    members: Sequence[World],
    overrides: Mapping[str, Array],
    horizon: float,
    *,
    sample_interval: float | None = None,
    record_events: bool = True,
    progress: Callable[[float], None] | None = None,
    patience: float = PATIENCE,
) -> tuple[Rollout, ...]:
    """Roll variants of one world out together, as `rollout` does one.

    overrides: parameter path -> values (N,) that make the world into `members`. A member with another
    seconds_per_frame has a proportional horizon. record_events, progress, patience: as for `rollout`.
    """
    times = sampled_times(world, horizon, sample_interval)
    _check_patience(patience)
    machine = simulator(
        world, times, n_worlds=len(members), record_events=record_events, progress=progress, patience=patience
    )
    batch, reasons = watch(machine.run(overrides), members)
    frame = world.time.seconds_per_frame
    return tuple(
        _rollout_of(member, batch, i, horizon * member.time.seconds_per_frame / frame, reasons[i])
        for i, member in enumerate(members)
    )


def sampled_times(world: World, horizon: float, sample_interval: float | None = None) -> Array:
    """Return the sample times (T,) of a rollout; raises ValueError where there would be too many, see `rollout`."""
    interval = world.time.seconds_per_frame if sample_interval is None else sample_interval
    for name, value in (("sample_interval", interval), ("horizon", horizon)):
        if isinstance(value, str) or not np.isscalar(value):
            raise TypeError(f"{name} must be a number of seconds, got {value!r}")
    if not (np.isfinite(interval) and interval > 0):
        raise ValueError(f"sample_interval must be positive, got {interval}")
    if not (np.isfinite(horizon) and horizon > 0):
        raise ValueError(f"horizon must be positive, got {horizon}")
    longest = MAX_SUBSTEPS * min(world.time.substep, interval)
    if horizon > longest:
        raise ValueError(
            f"a horizon of {horizon} s asks for more than {MAX_SUBSTEPS} substeps; the longest is {longest:.6g} s"
        )
    if horizon / interval > MAX_SAMPLES:
        raise ValueError(
            f"a horizon of {horizon} s makes more than {MAX_SAMPLES} samples: "
            f"take a sample_interval of at least {horizon / MAX_SAMPLES:.6g} s"
        )
    whole = int(np.floor(horizon / interval * (1 + 1e-12)))
    times: Array = np.arange(whole + 1, dtype=np.float64) * interval
    if horizon - times[-1] > 1e-9 * interval:
        times = np.append(times, horizon)
    return times


def _rollout_of(world: World, batch: BatchTrajectory, index: int, horizon: float, reason: str | None) -> Rollout:
    """The rollout of one world of a batch. reason: why it diverged."""
    interruption.check()
    trajectory = batch.world(index)
    diverged, truncated = bool(batch.diverged[index]), batch.truncated.get(index)
    element = batch.diverged_element
    until = None if batch.contacts_until is None else batch.contacts_until[index]
    recorded = until is None or until > 0.0
    return Rollout(
        world_id=world.id,
        horizon=horizon,
        trajectory=trajectory,
        events=all_events(world, trajectory, batch.events[index]) if recorded else (),
        status="diverged" if diverged else "completed" if truncated is None else "truncated",
        diverged_time=float(batch.diverged_time[index]) if diverged else None,
        diverged_object=batch.names[int(batch.diverged_object[index])] if diverged else None,
        diverged_element=int(element[index]) if diverged and element is not None else None,
        diverged_reason=reason,
        truncated=truncated,
        contacts_until=until,
    )
