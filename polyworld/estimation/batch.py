"""Simulate settings of several runs as one batch, and compare their motion with what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.comparing import Comparison, Motion
from polyworld.estimation.design import Design, RunDesign, owner
from polyworld.estimation.unknown import Unknown
from polyworld.model import mesh_of
from polyworld.probing.readouts.material_points import MaterialPoints, material_points
from polyworld.solver.planar import PlanarSimulator
from polyworld.solver.planar.plane_motion import PlaneMotion
from polyworld.solver.rollout import ScheduledSimulator, Simulator, scheduled_simulator, simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World, geometry
from polyworld.world.observer import clock_ratio, observe, observed_spins, sampling_times
from polyworld.world.parameters import parameter_paths, read_parameter

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CLOCK = "time.seconds_per_frame"
ORIGIN = "time.origin"
ROUNDING = 1e-7  # [s] by which instants of runs may differ that are sampled together
FULLER = 1.5  # times as many instants as a run has, at most, for it to be sampled together with others
ROOM = 1.5  # times as many worlds as are asked for, that a simulator is made for: sizes come and go
KEPT = 4  # simulators of a batch, where what is sampled changes with an observer's clock


@dataclass(frozen=True)
class Settings:
    """Settings (k) to be simulated for one run: shared values (k, S) and initial-state coordinates (k, N)."""

    run: int
    shared: Array
    states: Array


def batches(world: World, design: Design) -> list[Batch]:
    """Return the batches that the runs of a design are simulated in.

    Runs that show the same objects share one, each sampled at its own instants; where a simulator has one list of
    instants for all worlds, runs share it that have much the same ones, long ones first.
    """
    found: list[Batch] = []
    for run in sorted(design.runs, key=lambda r: (-len(r.times), r.index)):
        batch = next((b for b in found if b.takes(run)), None)
        if batch is None:
            batch = Batch(run.world(world), run.absent)
            found.append(batch)
        batch.add(run)
    return found


class Batch:
    """Runs of one world that are simulated together. members: index -> run."""

    def __init__(self, world: World, absent: tuple[str, ...]) -> None:
        self.world, self.absent = world, absent
        self.members: dict[int, RunDesign] = {}
        self.observer = world.observer
        self._own_times = not world.coupled and all(o.start_time <= 0.0 for o in world.objects)
        self._lists: list[Array] = []  # of instants, one of each member or one for all
        self._slots: dict[int, int] = {}
        self._simulators: dict[tuple[int, bytes], Simulator] = {}
        self._scheduled: dict[bytes, ScheduledSimulator] = {}
        self._paths = frozenset(parameter_paths(world))
        self._described: dict[str, float] = {}
        self._markers: dict[tuple[int, str], MaterialPoints] = {}
        axes = geometry.plane_axes(world.environment.motion_plane)
        self._comparison = Comparison(world.planar, axes, self._rows_of)

    # -- members -------------------------------------------------------------------------------------------------

    def takes(self, run: RunDesign) -> bool:
        """Return whether a run can be simulated with those that are members."""
        if run.absent != self.absent:
            return False
        if self._own_times:
            return True
        times = self._lists[0]
        if self.observer is not None:  # what an observer displaces is counted from a run's own instants
            if self.observer.shift_run in (run.run.name, next(iter(self.members.values())).run.name):
                return False  # the instants of that run are its own
            return len(run.times) == len(times) and bool(np.all(np.abs(run.times - times) < ROUNDING))
        # Up to one instant a step the steps at most double, which costs less than a batch of its own.
        steps = (run.times[-1] - run.times[0]) / self.world.time.substep
        return bool(len(_union(times, run.times)) <= max(FULLER * len(run.times), steps))

    def add(self, run: RunDesign) -> None:
        """Take a run in."""
        self.members[run.index] = run
        if self._own_times:
            known = {own.tobytes(): i for i, own in enumerate(self._lists)}
            self._slots[run.index] = known.get(run.times.tobytes(), len(self._lists))
            if self._slots[run.index] == len(self._lists):
                self._lists.append(run.times)
            return
        self._slots[run.index] = 0
        if not self._lists:
            self._lists.append(run.times)
        elif self.observer is None:
            self._lists[0] = _union(self._lists[0], run.times)

    def _rows_of(self, run: RunDesign) -> Ints:
        """Return where a run's instants (T,) are among those compared: the sampled ones, or what an observer
        reports."""
        if self.observer is not None:
            return np.arange(len(run.times))
        return np.searchsorted(self._lists[self._slots[run.index]], run.times - ROUNDING)

    # -- evaluation ----------------------------------------------------------------------------------------------

    def residuals(self, unknowns: tuple[Unknown, ...], settings: Sequence[Settings], horizon: float) -> list[Array]:
        """Return residuals (k, m) of settings."""
        runs = [self.members[s.run] for s in settings]
        counts = [len(s.shared) for s in settings]
        first = np.concatenate([[0], np.cumsum(counts)])
        moved, observer, lists = self._rolled(unknowns, settings, horizon)
        whole_runs = horizon >= 1.0 or self.observer is not None
        reached = [len(lists[self._slots[r.index]]) if whole_runs else self._reached(r.index, horizon) for r in runs]
        found = [np.empty(0)] * len(settings)
        alike: dict[int, list[int]] = {}
        for i, count in enumerate(counts):
            alike.setdefault(count, []).append(i)
        for count, same in alike.items():
            whole = len(same) == len(settings)
            worlds = None if whole else np.concatenate([np.arange(first[i], first[i] + count) for i in same])
            own = [runs[i] for i in same]
            motion = self._motion(own, count, moved, worlds, observer, lists)
            residual = self._comparison.residuals(own, motion, np.array([reached[i] for i in same]))
            for j, i in enumerate(same):
                found[i] = residual[j, :, : runs[i].length]
        return found

    def _rolled(
        self, unknowns: tuple[Unknown, ...], settings: Sequence[Settings], horizon: float
    ) -> tuple[BatchTrajectory | PlaneMotion, dict[str, Array], list[Array]]:
        """Roll out all settings, in the plane itself where that is enough; also the observer's parameters of each
        world, and the lists of instants sampled."""
        count = sum(len(s.shared) for s in settings)
        values = self._values(unknowns, settings, count)
        observer = {path: v for path, v in values.items() if path.startswith("observer.")}
        overrides = {path: v for path, v in values.items() if path not in observer and path in self._paths}
        lists = self._lists
        if self.observer is not None:
            base = read_parameter(self.world, CLOCK)
            overrides[CLOCK] = overrides.get(CLOCK, np.full(count, base)) * clock_ratio(self.observer, observer)
            lists = self._sampling_times(settings, observer)
            reached = np.array([np.isfinite(own).sum() for own in lists])
            samples = np.repeat([reached[self._slots[s.run]] for s in settings], [len(s.shared) for s in settings])
        else:
            samples = np.repeat([self._reached(s.run, horizon) for s in settings], [len(s.shared) for s in settings])
        if not self._own_times:
            return self._simulator(lists[0], count).run(overrides or None, samples=int(samples.max())), observer, lists
        chosen = self._scheduled_simulator(lists, count)
        schedule = np.repeat([self._slots[s.run] for s in settings], [len(s.shared) for s in settings])
        if self.observer is None and isinstance(chosen, PlanarSimulator):
            return chosen.roll(overrides or None, samples=samples, schedule=schedule), observer, lists
        return chosen.run(overrides or None, samples=samples, schedule=schedule), observer, lists

    def _reached(self, run: int, horizon: float) -> int:
        """Return how many of the instants sampled it takes to reach that part of a run's time."""
        own = self.members[run]
        return int(self._rows_of(own)[np.count_nonzero(own.instants_before(horizon)) - 1]) + 1

    def _sampling_times(self, settings: Sequence[Settings], observer: dict[str, Array]) -> list[Array]:
        """Return instants that let the observer report at every run's stamps; of runs not asked for their stamps."""
        lists = list(self._lists)
        first = 0
        for s in settings:
            rows = slice(first, first + len(s.shared)) if self._own_times else slice(None)
            own = {path: v[rows] for path, v in observer.items()}
            first += len(s.shared)
            slot = self._slots[s.run]
            lists[slot] = sampling_times(self._lists[slot], own, self.observer, self.members[s.run].run.name)
        return lists

    def _simulator(self, times: Array, count: int) -> Simulator:
        key = (count, times.tobytes())
        if key not in self._simulators:
            _make_room(self._simulators)
            self._simulators[key] = simulator(self.world, times, n_worlds=count)
        return self._simulators[key]

    def _scheduled_simulator(self, lists: Sequence[Array], count: int) -> ScheduledSimulator:
        times = np.full((len(lists), max(len(own) for own in lists)), np.nan)
        for row, own in zip(times, lists, strict=True):
            row[: len(own)] = own
        key = times.tobytes()
        known = self._scheduled.get(key)
        if known is None or known.n_worlds < count:
            self._scheduled.pop(key, None)
            _make_room(self._scheduled)
            self._scheduled[key] = scheduled_simulator(self.world, times, n_worlds=int(ROOM * count) + 1)
        return self._scheduled[key]

    # -- motion as it is compared --------------------------------------------------------------------------------

    def _motion(
        self,
        runs: Sequence[RunDesign],
        count: int,
        moved: BatchTrajectory | PlaneMotion,
        worlds: Ints | None,
        observer: dict[str, Array],
        lists: Sequence[Array],
    ) -> Motion | PlaneMotion:
        """Motion of some worlds (None: of all), `count` of each of some runs, as the observer reports it."""
        if isinstance(moved, PlaneMotion):
            if worlds is None:
                return moved
            own = {name: getattr(moved, name)[worlds] for name in ("times", "pose", "rate", "height", "diverged")}
            return replace(moved, **own)
        chosen = slice(None) if worlds is None else worlds
        names, positions, velocities, columns = self._recorded(runs, count, moved, chosen)
        orientations, spins = moved.orientations[chosen], moved.angular_velocities[chosen]
        if columns is not None:
            orientations, spins = orientations[:, :, columns], spins[:, :, columns]
        diverged = moved.stopped[chosen]
        if self.observer is None:
            return Motion(names, diverged, positions, orientations, spins)
        most = max(len(r.times) for r in runs)
        shown = [np.full((len(diverged), most, *v.shape[2:]), np.nan) for v in (positions, orientations, spins)]
        times = moved.times[chosen]
        for i, run in enumerate(runs):
            at, length = slice(i * count, (i + 1) * count), len(lists[self._slots[run.index]])
            parameters = {path: v[chosen][at] for path, v in observer.items()}
            p, q, v, w, t = (x[at, :length] for x in (positions, orientations, velocities, spins, times))
            of_run = (parameters, self.observer, run.run.name)
            seen = (*observe(p, q, v, w, t, run.times, *of_run), observed_spins(w, t, run.times, *of_run))
            for whole, reported in zip(shown, seen, strict=True):
                whole[at, : len(run.times)] = reported
        return Motion(names, diverged, *shown)

    def _recorded(
        self, runs: Sequence[RunDesign], count: int, moved: BatchTrajectory, chosen: slice | Ints
    ) -> tuple[tuple[str, ...], Array, Array, list[int] | None]:
        """Return names, positions and velocities (W, T, n, 3) of what runs record, and which bodies these are: None for
        all bodies as they come; markers on deformable objects follow their material points."""
        names = runs[0].run.names
        if not any("#" in name for name in names):
            return moved.names, moved.positions[chosen], moved.velocities[chosen], None
        places, speeds = [], []
        for column, name in enumerate(names):
            if "#" not in name:
                index = moved.names.index(name)
                places.append(moved.positions[chosen][:, :, index])
                speeds.append(moved.velocities[chosen][:, :, index])
                continue
            points = moved.deformables[owner(name)].points[chosen]
            moving = moved.deformables[owner(name)].velocities[chosen]
            own_places, own_speeds = [], []
            for i, run in enumerate(runs):
                marker, at = self._marker(run, column, name), slice(i * count, (i + 1) * count)
                own_places.append(marker.places(points[at])[..., 0, :])
                own_speeds.append(marker.places(moving[at])[..., 0, :])
            places.append(np.concatenate(own_places))
            speeds.append(np.concatenate(own_speeds))
        columns = [moved.names.index(owner(n)) for n in names]
        return names, np.stack(places, axis=2), np.stack(speeds, axis=2), columns

    def _marker(self, run: RunDesign, column: int, name: str) -> MaterialPoints:
        key = (run.index, name)
        if key not in self._markers:
            mesh = mesh_of(self.world, self.world.deformable(owner(name)))
            rows = np.flatnonzero(np.all(np.isfinite(run.run.positions[:, column]), axis=-1))
            if not len(rows):
                raise ValueError(f"marker {name!r} of run {run.run.name!r} is never seen in all three components")
            self._markers[key] = material_points(mesh, run.run.positions[rows[0], column][None])
        return self._markers[key]

    # -- parameters ----------------------------------------------------------------------------------------------

    def _values(self, unknowns: tuple[Unknown, ...], settings: Sequence[Settings], count: int) -> dict[str, Array]:
        """Return values (W,) of all parameters that differ from the world's."""
        shared = np.concatenate([s.shared for s in settings])
        values = {path: shared[:, i].copy() for i, u in enumerate(unknowns) for path in u.paths if u.run is None}
        first = np.concatenate([[0], np.cumsum([len(s.shared) for s in settings])])
        for i, u in enumerate(unknowns):
            if u.run is None:
                continue
            for path in u.paths:
                own = values.setdefault(path, np.full(count, self._described_value(path)))
                for at, item in zip(first, settings, strict=False):
                    if u.is_of(self.members[item.run].run):
                        own[at : at + len(item.shared)] = item.shared[:, i]
        self._add_states(values, settings, first)
        origins = [np.full(len(s.shared), self.members[s.run].run.origin) for s in settings]
        if any(np.any(o) for o in origins):  # when each run starts, for laws that depend on time
            values[ORIGIN] = values.get(ORIGIN, self.world.time.origin) + np.concatenate(origins)
        return values

    def _add_states(self, values: dict[str, Array], settings: Sequence[Settings], first: Ints) -> None:
        given = tuple(values)
        for at, item in zip(first, settings, strict=False):
            rows = slice(at, at + len(item.shared))
            own = {path: values[path][rows].copy() for path in given}
            offset = 0
            for coordinates in self.members[item.run].states:
                n = len(coordinates.labels)
                for path, v in coordinates.overrides(item.states[:, offset : offset + n], own).items():
                    if path not in values:
                        values[path] = np.full(first[-1], self._described_value(path))
                    values[path][rows] = v
                offset += n

    def _described_value(self, path: str) -> float:
        if path not in self._described:
            self._described[path] = read_parameter(self.world, path) or 0.0
        return self._described[path]


def _union(times: Array, others: Array) -> Array:
    """Return instants of both, those within rounding of each other once."""
    both = np.sort(np.concatenate([times, others]))
    kept: Array = both[np.concatenate([[True], np.diff(both) > ROUNDING])]
    return kept


def _make_room(kept: dict[Any, Any]) -> None:
    """Let go of the simulator that was made first where there are many."""
    if len(kept) >= KEPT:
        kept.pop(next(iter(kept)))
