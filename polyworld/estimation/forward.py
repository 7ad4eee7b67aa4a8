"""Residuals of many settings of a world against all runs of a recording, simulated in few batches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.estimation.design import Design, RunDesign, owner
from polyworld.estimation.in_plane import InPlane
from polyworld.estimation.rotation_counting import counted_angles, counted_vectors
from polyworld.estimation.unknown import Unknown
from polyworld.meshing import mesh_of
from polyworld.observer import clock_ratio, observe, observed_spins, sampling_times
from polyworld.parameters import parameter_paths, read_parameter
from polyworld.readouts.material_points import MaterialPoints, material_points
from polyworld.rollout import Simulator, simulator
from polyworld.solver.planar import PlanarSimulator
from polyworld.solver.planar.plane_motion import PlaneMotion
from polyworld.symmetry import rotation_vector, smallest_rotation, turn_about
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CLOCK = "time.seconds_per_frame"
ORIGIN = "time.origin"
ROUNDING = 1e-7  # [s] by which instants of runs may differ that are sampled together
FULLER = 1.5  # times as many instants as a run has, at most, for it to be sampled together with others


@dataclass(frozen=True)
class Settings:
    """Settings (k) to be simulated for one run: shared values (k, S) and initial-state coordinates (k, N)."""

    run: int
    shared: Array
    states: Array


@dataclass(frozen=True)
class Ends:
    """States of all bodies at one instant of k worlds: position, velocity (k, n, 3), orientation (k, n, 4), spin
    (k, n, 3); of planar motion, position and velocity are pose and rate in the plane, and the others are empty."""

    position: Array
    velocity: Array
    orientation: Array
    spin: Array

    def rows(self, rows: slice) -> Ends:
        """Those of some worlds."""
        return Ends(self.position[rows], self.velocity[rows], self.orientation[rows], self.spin[rows])


@dataclass(frozen=True)
class Outcome:
    """Residuals (k, m) of a run, and its states at its first and last instant."""

    residual: Array
    begin: Ends
    end: Ends


@dataclass
class Forward:
    """The forward model of one world with S unknowns on a design.

    `residuals` gives simulated less observed, raw, in m, rad and rad/s; NaN rows where a rollout diverged.
    rollouts counts worlds simulated. cancelled: asked between batches; where it says so `InterruptedError` is raised.
    """

    design: Design
    world: World
    unknowns: tuple[Unknown, ...]
    cancelled: Callable[[], bool] | None = None
    rollouts: int = 0
    _groups: dict[int, _Group] = field(default_factory=dict, repr=False)

    def residuals(self, settings: Sequence[Settings], horizon: float = 1.0) -> list[Array]:
        """Residuals (k, m) of each of the settings, in their order.

        horizon: part of each run's time that is of interest, as in `RunDesign.before`; residuals beyond it may be 0.
        """
        return [found for found, _, _ in self._evaluated(settings, horizon, ends=False)]

    def outcomes(self, settings: Sequence[Settings]) -> list[Outcome]:
        """Residuals, and states at both ends, of each of the settings over whole runs, in their order."""
        found = []
        for residual, begin, end in self._evaluated(settings, 1.0, ends=True):
            assert begin is not None
            assert end is not None
            found.append(Outcome(residual, begin, end))
        return found

    def _evaluated(
        self, settings: Sequence[Settings], horizon: float, ends: bool
    ) -> list[tuple[Array, Ends | None, Ends | None]]:
        if self.cancelled is not None and self.cancelled():
            raise InterruptedError("cancelled")
        by_group: dict[int, list[int]] = {}
        for i, item in enumerate(settings):
            by_group.setdefault(self._group(item.run).key, []).append(i)
        results: list[tuple[Array, Ends | None, Ends | None]] = [(np.empty(0), None, None)] * len(settings)
        for key, members in by_group.items():
            group = self._groups[key]
            chosen = [settings[i] for i in members]
            batch, observer, instants = group.run(self.unknowns, chosen, horizon)
            self.rollouts += sum(len(s.shared) for s in chosen)
            first = np.concatenate([[0], np.cumsum([len(s.shared) for s in chosen])])
            alike: dict[tuple[int, object, bytes], list[int]] = {}
            for j, item in enumerate(chosen):
                run = self.design.runs[item.run]
                alike.setdefault((len(item.shared), run.layout, group.rows_of(run).tobytes()), []).append(j)
            for (count, _, _), same in alike.items():
                worlds = np.concatenate([np.arange(first[j], first[j] + count) for j in same])
                runs = [self.design.runs[chosen[j].run] for j in same]
                found = group.compare(runs, group.sampled(batch, runs[0]), observer, worlds)
                begin, end = (group.ends(batch, worlds, runs[0], instants, last) if ends else None for last in (0, 1))
                for i, j in enumerate(same):
                    rows = slice(i * count, (i + 1) * count)
                    own = (x.rows(rows) if x is not None else None for x in (begin, end))
                    results[members[j]] = (found[i], *own)
        return results

    def release(self) -> None:
        """Let go of all simulators; they are built anew where they are needed again."""
        self._groups.clear()

    def _group(self, run: int) -> _Group:
        """The group whose simulators roll a run out: runs with the same objects and much the same instants share one.

        All runs are grouped at once, long ones first, so that a group samples all its members from the beginning.
        """
        if not self._groups:
            for own in sorted(self.design.runs, key=lambda r: (-len(r.times), r.index)):
                group = next((g for g in self._groups.values() if g.takes(own)), None)
                if group is None:
                    group = _Group(own.index, own.world(self.world), self.design)
                    self._groups[own.index] = group
                group.add(own)
        return next(g for g in self._groups.values() if run in g.members)


def _union(times: Array, others: Array) -> Array:
    """Instants of both, those within rounding of each other once."""
    both = np.sort(np.concatenate([times, others]))
    kept: Array = both[np.concatenate([[True], np.diff(both) > ROUNDING])]
    return kept


class _Group:
    """Runs with the same objects whose instants lie on much the same grid, simulated together: rows may be missing."""

    def __init__(self, key: int, world: World, design: Design) -> None:
        self.key = key
        self.world = world
        self.members = {key}
        self._runs = design.runs
        self.absent = design.runs[key].absent
        self.times = design.runs[key].times
        self.observer = world.observer
        self._simulators: dict[tuple[int, bytes], Simulator] = {}
        self._in_plane = InPlane()
        self._markers: dict[tuple[int, str], MaterialPoints] = {}
        self._paths = frozenset(parameter_paths(world))
        self._described: dict[str, float] = {}
        self._rows: dict[int, Ints] = {}

    def takes(self, design: RunDesign) -> bool:
        """Whether a run can be simulated by this group's simulators."""
        if design.absent != self.absent:
            return False
        if self.observer is not None:  # what an observer displaces is counted from a run's own instants
            if self.observer.shift_run in (design.run.name, self._runs[self.key].run.name):
                return False  # the instants of that run are its own
            same = len(design.times) == len(self.times)
            return same and bool(np.all(np.abs(design.times - self.times) < ROUNDING))
        # Up to one instant a step the steps at most double, which costs less than a batch of its own.
        steps = (design.times[-1] - design.times[0]) / self.world.time.substep
        return bool(len(_union(self.times, design.times)) <= max(FULLER * len(design.times), steps))

    def add(self, design: RunDesign) -> None:
        """Take a run in, whose instants are sampled from then on."""
        self.members.add(design.index)
        if self.observer is None:
            self.times = _union(self.times, design.times)
            self._rows.clear()

    def rows_of(self, design: RunDesign) -> Ints:
        """Where a run's instants (T,) are among those sampled."""
        if design.index not in self._rows:
            self._rows[design.index] = np.searchsorted(self.times, design.times - ROUNDING)
        return self._rows[design.index]

    def sampled(self, batch: BatchTrajectory | PlaneMotion, design: RunDesign) -> BatchTrajectory | PlaneMotion:
        """The batch at a run's own instants, as far as it goes."""
        rows = self.rows_of(design)
        if self.observer is not None or np.array_equal(rows, np.arange(len(rows))):
            return batch  # rows beyond a run's last are not looked at
        rows = rows[rows < batch.times.shape[1]]
        if isinstance(batch, PlaneMotion):
            return replace(batch, times=batch.times[:, rows], pose=batch.pose[:, rows], rate=batch.rate[:, rows])
        return replace(
            batch,
            times=batch.times[:, rows],
            positions=batch.positions[:, rows],
            orientations=batch.orientations[:, rows],
            velocities=batch.velocities[:, rows],
            angular_velocities=batch.angular_velocities[:, rows],
            active=batch.active[rows],
            deformables={
                name: replace(m, points=m.points[:, rows], velocities=m.velocities[:, rows], quantities={})
                for name, m in batch.deformables.items()
            },
        )

    def ends(
        self, batch: BatchTrajectory | PlaneMotion, worlds: Ints, design: RunDesign, instants: Array, last: int
    ) -> Ends:
        """States of some worlds at a run's first instant, or at its last."""
        at = int(np.argmin(np.abs(instants - design.times[-1 if last else 0])))
        if isinstance(batch, PlaneMotion):
            none = np.zeros((len(worlds), 0))
            return Ends(batch.pose[worlds, at], batch.rate[worlds, at], none, none)
        motion = (batch.positions, batch.velocities, batch.orientations, batch.angular_velocities)
        return Ends(*(values[worlds, at] for values in motion))

    def run(
        self, unknowns: tuple[Unknown, ...], settings: Sequence[Settings], horizon: float
    ) -> tuple[BatchTrajectory | PlaneMotion, dict[str, Array], Array]:
        """Roll out all settings as one batch, in the plane itself where that is enough; also the observer's parameters
        of each world, and the instants sampled."""
        count = sum(len(s.shared) for s in settings)
        shared = np.concatenate([s.shared for s in settings])
        values = {path: shared[:, i].copy() for i, u in enumerate(unknowns) for path in u.paths if u.run is None}
        self._of_single_runs(values, unknowns, settings)
        self._state_values(values, settings, count)
        self._origins(values, settings)
        observer = {path: v for path, v in values.items() if path.startswith("observer.")}
        overrides = {path: v for path, v in values.items() if path not in observer and path in self._paths}
        instants = self.times
        samples: int | None = max(self._reached(self._runs[s.run], horizon) for s in settings)
        if self.observer is not None:
            base = read_parameter(self.world, CLOCK)
            ratio = clock_ratio(self.observer, observer)
            overrides[CLOCK] = overrides.get(CLOCK, np.full(count, base)) * ratio
            instants = sampling_times(self.times, observer, self.observer, self._runs[self.key].run.name)
            samples = None  # the stamps are not the instants
        key = (count, instants.tobytes())
        if key not in self._simulators:
            if len(self._simulators) >= 4:  # sizes come and go; the newest are those that come again
                self._simulators.pop(next(iter(self._simulators)))
            self._simulators[key] = simulator(self.world, instants, n_worlds=count)
        chosen = self._simulators[key]
        if self.observer is None and isinstance(chosen, PlanarSimulator):
            return chosen.roll(overrides or None, samples=samples), observer, instants
        return chosen.run(overrides or None, samples=samples), observer, instants

    def _reached(self, design: RunDesign, horizon: float) -> int:
        """How many of the instants sampled it takes to reach that part of a run's time."""
        if self.observer is not None:
            return int(np.count_nonzero(design.instants_before(horizon)))
        return int(self.rows_of(design)[np.count_nonzero(design.instants_before(horizon)) - 1]) + 1

    def compare(
        self,
        designs: Sequence[RunDesign],
        batch: BatchTrajectory | PlaneMotion,
        observer: dict[str, Array],
        worlds: Ints,
    ) -> Array:
        """Residuals (R, k, m) of R k worlds of a batch against R runs of the same layout, k worlds each."""
        if isinstance(batch, PlaneMotion):
            return self._in_plane.compare(designs, batch, worlds)
        design = designs[0]
        names = design.run.names
        positions, velocities = self._motion(designs, batch, worlds)
        columns = [batch.names.index(owner(n)) for n in names]
        orientations = batch.orientations[worlds][:, :, columns]
        spins = batch.angular_velocities[worlds][:, :, columns]
        if self.observer is not None:
            own, times, stamps = {path: v[worlds] for path, v in observer.items()}, batch.times[worlds], self.times
            of_run = self.observer, design.run.name
            positions, orientations = observe(positions, orientations, velocities, spins, times, stamps, own, *of_run)
            spins = observed_spins(spins, times, stamps, own, *of_run)
        instants = positions.shape[1]
        positions = positions.reshape(len(designs), -1, *positions.shape[1:])
        spins = spins.reshape(positions.shape)
        residual = np.zeros((*positions.shape[:2], design.length))
        turns: dict[str, Array] = {}
        for s in design.series:
            column = names.index(s.name)
            rows = s.rows[s.rows < instants]
            where = slice(s.where.start, s.where.start + len(rows))
            if s.kind != "rotation":
                measured, moved = ("positions", positions) if s.kind == "position" else ("angular_velocities", spins)
                seen = np.array([getattr(d.run, measured)[rows, column, s.axis] for d in designs])
                residual[..., where] = moved[:, :, rows, column, s.axis] - seen[:, None]
                continue
            if s.name not in turns:
                turns[s.name] = self._turned(designs, orientations[:, rows, column], rows, column)
            residual[..., where] = turns[s.name][..., s.axis].reshape(*residual.shape[:2], -1)
        residual[batch.diverged[worlds].reshape(residual.shape[:2])] = np.nan
        return residual

    def _turned(self, designs: Sequence[RunDesign], simulated: Array, rows: Ints, column: int) -> Array:
        """Rotation vectors (R k, m, 3) from what R runs observed to what was simulated (R k, m, 4)."""
        own = np.array([d.run.orientations[rows, column] for d in designs])
        order = np.full(len(rows), designs[0].run.symmetry[column], dtype=np.int64)
        if not self.world.planar:
            each_run = simulated.reshape(len(own), len(simulated) // len(own), *simulated.shape[1:])
            if np.all(order == 1):  # most often; one look-alike need not be compared with itself
                vectors = rotation_vector(each_run, own[:, None]).reshape(*simulated.shape[:2], 3)
                return counted_vectors(vectors, simulated, own)
            each = [smallest_rotation(part, seen, order) for part, seen in zip(each_run, own, strict=True)]
            return np.concatenate(each)
        observed = np.repeat(own, len(simulated) // len(designs), axis=0)
        normal = geometry.plane_axes(self.world.environment.motion_plane)[2]
        result = np.zeros((*simulated.shape[:2], 3))
        folds = np.maximum(order, 1)
        result[..., 2] = counted_angles(turn_about(simulated, observed, normal, folds), np.pi / folds) * (order > 0)
        return result

    def _motion(self, designs: Sequence[RunDesign], batch: BatchTrajectory, worlds: Ints) -> tuple[Array, Array]:
        """Positions and velocities (R k, T, n, 3) of the recorded names: objects' centres and markers."""
        places, speeds = [], []
        for column, name in enumerate(designs[0].run.names):
            if "#" not in name:
                index = batch.names.index(name)
                places.append(batch.positions[worlds, :, index])
                speeds.append(batch.velocities[worlds, :, index])
                continue
            motion = batch.deformables[owner(name)]
            own = worlds.reshape(len(designs), -1)
            markers = [self._marker(d, column, name) for d in designs]
            places.append(np.concatenate([m.places(motion.points[w]) for m, w in zip(markers, own, strict=True)]))
            places[-1] = places[-1][..., 0, :]
            speeds.append(np.concatenate([m.places(motion.velocities[w]) for m, w in zip(markers, own, strict=True)]))
            speeds[-1] = speeds[-1][..., 0, :]
        return np.stack(places, axis=2), np.stack(speeds, axis=2)

    def _marker(self, design: RunDesign, column: int, name: str) -> MaterialPoints:
        key = (design.index, name)
        if key not in self._markers:
            mesh = mesh_of(self.world, self.world.deformable(owner(name)))
            rows = np.flatnonzero(np.all(np.isfinite(design.run.positions[:, column]), axis=-1))
            if not len(rows):
                raise ValueError(f"marker {name!r} of run {design.run.name!r} is never seen in all three components")
            self._markers[key] = material_points(mesh, design.run.positions[rows[0], column][None])
        return self._markers[key]

    def _origins(self, values: dict[str, Array], settings: Sequence[Settings]) -> None:
        """When each run starts, by its own clock, for laws that depend on time."""
        origins = [np.full(len(s.shared), self._runs[s.run].run.origin) for s in settings]
        base = self.world.time.origin
        if any(np.any(o) for o in origins):
            values[ORIGIN] = values.get(ORIGIN, base) + np.concatenate(origins)

    def _described_value(self, path: str) -> float:
        if path not in self._described:
            self._described[path] = read_parameter(self.world, path) or 0.0
        return self._described[path]

    def _of_single_runs(
        self, values: dict[str, Array], unknowns: tuple[Unknown, ...], settings: Sequence[Settings]
    ) -> None:
        """Unknowns of one run each, in the worlds of that run."""
        first = np.concatenate([[0], np.cumsum([len(s.shared) for s in settings])])
        for i, u in enumerate(unknowns):
            if u.run is None:
                continue
            for path in u.paths:
                if path not in values:
                    values[path] = np.full(first[-1], self._described_value(path))
                for at, item in zip(first, settings, strict=False):
                    if u.is_of(self._runs[item.run].run):
                        values[path][at : at + len(item.shared)] = item.shared[:, i]

    def _state_values(self, values: dict[str, Array], settings: Sequence[Settings], count: int) -> None:
        at, given = 0, tuple(values)
        for item in settings:
            k = len(item.shared)
            own = {path: values[path][at : at + k].copy() for path in given}
            offset = 0
            for coordinates in self._runs[item.run].states:
                n = len(coordinates.labels)
                for path, v in coordinates.overrides(item.states[:, offset : offset + n], own).items():
                    if path not in values:
                        values[path] = np.full(count, self._described_value(path))
                    values[path][at : at + k] = v
                offset += n
            at += k
