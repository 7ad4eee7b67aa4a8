"""Lay measurements out for fitting: residual series of every run, and the initial states that are its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.edits.removal import without
from polyworld.estimation.states import StateCoordinates, state_coordinates
from polyworld.world import World, geometry

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

POSITION_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Series:
    """One component of one object's motion in one run, a stretch of the run's residual vector.

    run: index. name: object, or marker. axis: 0 to 2 of world axes. kind: position [m], rotation [rad] (rotation
    vector from the observed to the simulated orientation; in planar worlds only the turn about the normal, axis 2) or
    spin [rad/s] (angular velocity; in planar worlds only components along which the normal extends).
    rows (m,): instants at which it was measured. where: its place in the residual vector.
    """

    run: int
    name: str
    kind: Literal["position", "rotation", "spin"]
    axis: int
    rows: Ints
    where: slice


@dataclass(frozen=True)
class RunDesign:
    """One run: what its residual vector (m,) consists of, and its coordinates of the initial state (N,)."""

    index: int
    run: Run
    absent: tuple[str, ...]
    series: tuple[Series, ...]
    length: int
    states: tuple[StateCoordinates, ...]

    @property
    def times(self) -> Array:
        """Instants (T,) [s] since the run's start."""
        times: Array = self.run.times - self.run.times[0] + self.run.lead
        return times

    @property
    def count(self) -> int:
        """Number N of initial-state coordinates."""
        return sum(len(s.labels) for s in self.states)

    @cached_property
    def start(self) -> Array:
        """Initial-state coordinates (N,) as the beginning of the data suggests them."""
        parts = [s.start for s in self.states]
        return np.concatenate(parts) if parts else np.zeros(0)

    @cached_property
    def typical(self) -> Array:
        """Ordinary changes (N,) of these coordinates."""
        parts = [s.typical for s in self.states]
        return np.concatenate(parts) if parts else np.zeros(0)

    @cached_property
    def spread(self) -> Array:
        """How far (N,) coordinates of which nothing was measured may be from zero; 0 for all others."""
        parts = [s.spread for s in self.states]
        return np.concatenate(parts) if parts else np.zeros(0)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names (N,) of the coordinates, for readers."""
        return tuple(f"{s.name}.{label}" for s in self.states for label in s.labels)

    def counted(self, index: int) -> RunDesign:
        """Return the same as run number `index`."""
        return replace(self, index=index, series=tuple(replace(s, run=index) for s in self.series))

    @cached_property
    def layout(self) -> tuple[object, ...]:
        """Return what runs have in common whose residual vectors are laid out alike."""
        return (
            self.run.names,
            self.run.symmetry,
            tuple((s.name, s.kind, s.axis, s.rows.tobytes(), s.where.start) for s in self.series),
        )

    def world(self, world: World) -> World:
        """Return the world without the objects that other runs show and this one does not."""
        for name in self.absent:
            if name in world.moving_names:
                world = without(world, name)
        return world

    def before(self, horizon: float) -> NDArray[np.bool_]:
        """Return which entries (m,) of the residual vector lie in the first part `horizon` (0 to 1] of the run's
        time."""
        there = self.instants_before(horizon)
        keep = np.zeros(self.length, dtype=bool)
        for s in self.series:
            keep[s.where] = there[s.rows]
        return keep

    def instants_before(self, horizon: float) -> NDArray[np.bool_]:
        """Return which instants (T,) lie in that part of the run's time."""
        times = self.times
        end = times[0] + horizon * (times[-1] - times[0])
        there: NDArray[np.bool_] = times <= end * (1.0 + 1e-12)
        return there


@dataclass(frozen=True)
class Design:
    """All runs of a recording of one world."""

    world: World
    recording: Recording
    runs: tuple[RunDesign, ...]

    @property
    def length(self) -> int:
        """Number of measured components in all."""
        return sum(r.length for r in self.runs)

    def only(self, chosen: Sequence[int]) -> Design:
        """Return the design of some of the runs, which are renumbered."""
        runs = tuple(self.runs[k].counted(i) for i, k in enumerate(chosen))
        return Design(self.world, Recording(tuple(r.run for r in runs)), runs)

    def copies(self, run: int, count: int) -> Design:
        """Return the design of one run, so many times: to fit it by multistart."""
        own = self.runs[run]
        return Design(self.world, Recording((own.run,)), tuple(own.counted(i) for i in range(count)))

    @property
    def series(self) -> tuple[Series, ...]:
        """All series of all runs."""
        return tuple(s for r in self.runs for s in r.series)


def design(world: World, recording: Recording, *, initial: Literal["free", "given"] = "free") -> Design:
    """Lay a recording out for a world.

    initial: "free": every run's initial state of every measured object is its own unknown; "given": all runs start as
    the world says. Raises ValueError where a recorded object is not in the world, or a run has fewer than two instants.
    """
    known = set(world.moving_names)
    everywhere = {owner(n) for run in recording.runs for n in run.names}
    unknown = sorted(everywhere - known)
    if unknown:
        raise ValueError(f"the recording holds objects {unknown} that the world has not; objects: {sorted(known)}")
    runs = []
    for index, run in enumerate(recording.runs):
        if len(run.times) < 2:
            raise ValueError(f"run {run.name!r} has {len(run.times)} instants; at least 2 are needed")
        here = {owner(n) for n in run.names}
        absent = tuple(sorted(everywhere - here))
        series, length = _series(world, run, index)
        if length == 0:
            raise ValueError(f"run {run.name!r} holds no measured component")
        own = RunDesign(index, run, absent, series, length, ())
        states = state_coordinates(own.world(world), run) if initial == "free" else ()
        runs.append(RunDesign(index, run, absent, series, length, states))
    return Design(world, recording, tuple(runs))


def owner(name: str) -> str:
    """Return the object that a recorded name belongs to: itself, or of a marker `NAME#k` the deformable object NAME."""
    return name.split("#", 1)[0]


def _series(world: World, run: Run, index: int) -> tuple[tuple[Series, ...], int]:
    found: list[Series] = []
    at = 0
    normal = np.abs(geometry.plane_axes(world.environment.motion_plane)[2]) if world.planar else np.zeros(3)
    spins = _spins(run)
    for column, name in enumerate(run.names):
        for axis in range(3):
            rows = np.flatnonzero(np.isfinite(run.positions[:, column, axis]))
            if normal[axis] > 1.0 - 1e-9:
                continue  # the height above a motion plane cannot change
            if len(rows):
                found.append(Series(index, name, "position", axis, rows, slice(at, at + len(rows))))
                at += len(rows)
        rows = np.flatnonzero(np.all(np.isfinite(run.orientations[:, column]), axis=-1))
        if len(rows) and "#" not in name:
            for axis in (2,) if world.planar else range(3):
                found.append(Series(index, name, "rotation", axis, rows, slice(at, at + len(rows))))
                at += len(rows)
        for axis in range(3):
            rows = np.flatnonzero(np.isfinite(spins[:, column, axis]))
            if len(rows) and "#" not in name and (not world.planar or normal[axis] > 1e-9):
                found.append(Series(index, name, "spin", axis, rows, slice(at, at + len(rows))))
                at += len(rows)
    return tuple(found), at


def _spins(run: Run) -> Array:
    """Measured spins (T, n, 3) [rad/s]; none at the last instant of a segment, which belongs to the next one."""
    if run.window_of is None or np.isfinite(run.positions[-1]).any() or np.isfinite(run.orientations[-1]).any():
        return run.angular_velocities
    spins = run.angular_velocities.copy()
    spins[-1] = np.nan
    return spins
