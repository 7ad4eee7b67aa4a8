"""Residuals of many settings of a world against all runs of a recording, simulated in few batches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.discrepancy.candidate import Unknown
from polyworld.discrepancy.design import Design, RunDesign, owner
from polyworld.discrepancy.in_plane import InPlane
from polyworld.discrepancy.turns import counted_angles, counted_vectors
from polyworld.meshing import mesh_of
from polyworld.observer import clock_ratio, observe, sampling_times
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
ROUNDING = 1e-7  # [s] by which instants of runs may differ that are rolled out together


@dataclass(frozen=True)
class Settings:
    """Settings (k) to be simulated for one run: shared values (k, S) and initial-state coordinates (k, N)."""

    run: int
    shared: Array
    states: Array


@dataclass
class Forward:
    """The forward model of one world with S unknowns on a design.

    `residuals` gives simulated less observed, raw, in metres and radians; NaN rows where a rollout diverged.
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
        if self.cancelled is not None and self.cancelled():
            raise InterruptedError("cancelled")
        by_group: dict[int, list[int]] = {}
        for i, item in enumerate(settings):
            by_group.setdefault(self._group(item.run).key, []).append(i)
        results: list[Array] = [np.empty(0)] * len(settings)
        for key, members in by_group.items():
            group = self._groups[key]
            chosen = [settings[i] for i in members]
            batch, observer = group.run(self.unknowns, chosen, horizon)
            self.rollouts += sum(len(s.shared) for s in chosen)
            first = np.concatenate([[0], np.cumsum([len(s.shared) for s in chosen])])
            alike: dict[tuple[int, object], list[int]] = {}
            for j, item in enumerate(chosen):
                alike.setdefault((len(item.shared), self.design.runs[item.run].layout), []).append(j)
            for (count, _), same in alike.items():
                worlds = np.concatenate([np.arange(first[j], first[j] + count) for j in same])
                found = group.compare([self.design.runs[chosen[j].run] for j in same], batch, observer, worlds)
                for j, residual in zip(same, found, strict=True):
                    results[members[j]] = residual
        return results

    def release(self) -> None:
        """Let go of all simulators; they are built anew where they are needed again."""
        self._groups.clear()

    def _group(self, run: int) -> _Group:
        """The group whose simulators roll a run out: runs with the same objects at the same instants share one."""
        own = self.design.runs[run]
        for group in self._groups.values():
            if run in group.members:
                return group
        for group in self._groups.values():
            if group.takes(own):
                group.members.add(run)
                return group
        made = _Group(run, own.world(self.world), self.design)
        self._groups[run] = made
        return made


class _Group:
    """Runs with the same objects at the same instants, simulated together."""

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

    def takes(self, design: RunDesign) -> bool:
        """Whether a run can be simulated by this group's simulators."""
        shifted = None if self.observer is None else self.observer.shift_run
        if shifted in (design.run.name, self._runs[self.key].run.name):
            return False  # the instants of that run are its own
        same = len(design.times) == len(self.times) and bool(np.all(np.abs(design.times - self.times) < ROUNDING))
        return design.absent == self.absent and same

    def run(
        self, unknowns: tuple[Unknown, ...], settings: Sequence[Settings], horizon: float
    ) -> tuple[BatchTrajectory | PlaneMotion, dict[str, Array]]:
        """Roll out all settings as one batch, in the plane itself where that is enough; also the observer's parameters
        of each world."""
        count = sum(len(s.shared) for s in settings)
        shared = np.concatenate([s.shared for s in settings])
        values = {path: shared[:, i].copy() for i, u in enumerate(unknowns) for path in u.paths if u.run is None}
        self._of_single_runs(values, unknowns, settings)
        self._state_values(values, settings, count)
        self._origins(values, settings)
        observer = {path: v for path, v in values.items() if path.startswith("observer.")}
        overrides = {path: v for path, v in values.items() if path not in observer and path in self._paths}
        instants = self.times
        samples: int | None = int(np.count_nonzero(self._runs[self.key].instants_before(horizon)))
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
            return chosen.roll(overrides or None, samples=samples), observer
        return chosen.run(overrides or None, samples=samples), observer

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
        if self.observer is not None:
            positions, orientations = observe(
                positions,
                orientations,
                velocities,
                batch.angular_velocities[worlds][:, :, columns],
                batch.times[worlds],
                self.times,
                {path: v[worlds] for path, v in observer.items()},
                self.observer,
                design.run.name,
            )
        instants = positions.shape[1]
        positions = positions.reshape(len(designs), -1, *positions.shape[1:])
        residual = np.zeros((*positions.shape[:2], design.length))
        turns: dict[str, Array] = {}
        for s in design.series:
            column = names.index(s.name)
            rows = s.rows[s.rows < instants]
            where = slice(s.where.start, s.where.start + len(rows))
            if s.kind == "position":
                seen = np.array([d.run.positions[rows, column, s.axis] for d in designs])
                residual[..., where] = positions[:, :, rows, column, s.axis] - seen[:, None]
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
