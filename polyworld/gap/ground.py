"""Lay out the runs of a recording with their noise, readouts and initial states, as blocks of a problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.edits.removal import without
from polyworld.estimation.fit_settings import DescentSettings
from polyworld.estimation.least_squares import Problem
from polyworld.estimation.machines import Machines
from polyworld.estimation.noise import RunNoise, run_noise
from polyworld.estimation.problem import Block
from polyworld.estimation.readout import ObservedMotion, RunReadout, arcs, owner
from polyworld.estimation.states import state_coordinates
from polyworld.estimation.unknown import StateMap, Unknown, joined
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.settings import GapSettings
from polyworld.world import World
from polyworld.world.observer import MARGIN, clock_ratio

Array = NDArray[np.float64]

CLOCK = "time.seconds_per_frame"
COARSER = (8.0, 4.0, 2.0)  # times the world's substep
COARSEST = 0.02  # [s]
ALIKE = 0.03  # standard deviations of the noise by which a coarser motion may differ
RELATIVELY = 1e-3  # of what the world is off at its start
DESCENT = DescentSettings(dampings=(0.03, 1.0, 30.0, 1000.0))


@dataclass
class Ground:
    """Runs of a recording laid out for a world. noise: of each run, measured before any fit."""

    world: World
    recording: Recording
    settings: GapSettings
    noise: tuple[RunNoise, ...]
    readouts: tuple[RunReadout, ...] = field(init=False, repr=False)
    states: tuple[StateMap, ...] = field(init=False, repr=False)
    counts: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        known = set(self.world.moving_names)
        unknown = sorted({owner(n) for run in self.recording.runs for n in run.names} - known)
        if unknown:
            raise ValueError(f"the recording holds objects {unknown} that the world has not; objects: {sorted(known)}")
        for run in self.recording.runs:
            if len(run.times) < 2:
                raise ValueError(f"run {run.name!r} has {len(run.times)} instants; at least 2 are needed")
        self._machines = Machines()  # of fits one after another of one hypothesis
        self._everywhere = {owner(n) for run in self.recording.runs for n in run.names}
        runs, noise = self.recording.runs, self.noise
        known_at_first = [
            _known_at_first(joined(state_coordinates(self._present(self.world, r), r)), r, n)
            for r, n in zip(runs, noise, strict=True)
        ]
        self.states = tuple(states for states, _ in known_at_first)
        series = [run for _, run in known_at_first]
        self.readouts = tuple(RunReadout(self.world, r, n) for r, n in zip(series, noise, strict=True))
        self.counts = np.array([float(r.size) for r in self.readouts])
        if not self.counts.all():
            empty = [r.name for r, c in zip(runs, self.counts, strict=True) if not c]
            raise ValueError(f"runs {empty} hold no measured component")

    @property
    def relative_noise(self) -> float:
        """Noise of positions over the extent of the motion."""
        levels, extents = [], []
        for run, noise in zip(self.recording.runs, self.noise, strict=True):
            seen = np.isfinite(run.positions).any(axis=0)
            if seen.any():
                levels.append(float(np.median(noise.position[seen])))
                extents += [
                    float(np.ptp(v[np.isfinite(v)])) for v in run.positions.reshape(len(run.times), -1).T[seen.ravel()]
                ]
        return float(np.median(levels) / max(max(extents), 1e-12)) if levels else 0.0

    def problem(self, hypothesis: Hypothesis) -> Problem:
        """Return the least-squares problem of a hypothesis: a block a run."""
        worlds: dict[tuple[str, ...], World] = {}
        blocks = []
        for run, readout, states in zip(self.recording.runs, self.readouts, self.states, strict=True):
            world = worlds.setdefault(self._absent(run), self._present(hypothesis.world, run))
            extra = [_own_map(u) for u in hypothesis.own(run.name)]
            stamps = run.times - run.times[0] + run.lead
            block = Block(run.name, world, stamps, readout, joined([states, *extra]) if extra else states)
            block.derive = _Derived(world, run.origin)
            if world.observer is not None:
                block.observer = ObservedMotion(world, run)
                block.times = _sampled(stamps, hypothesis.unknowns, world)
            blocks.append([block])
        shared = None if hypothesis.world.coupled else self._machines
        return Problem(blocks, hypothesis.unknowns, DESCENT, shared)

    def cut(self, runs: Sequence[Run], noise: Sequence[RunNoise]) -> Ground:
        """Return the same of other runs, or of parts of these."""
        return Ground(self.world, Recording(tuple(runs)), self.settings, tuple(noise))

    def _absent(self, run: Run) -> tuple[str, ...]:
        return tuple(sorted(self._everywhere - {owner(n) for n in run.names}))

    def _present(self, world: World, run: Run) -> World:
        """Return the world without the objects that other runs show and this one does not."""
        for name in self._absent(run):
            if name in world.moving_names:
                world = without(world, name)
        return world


def ground_of(world: World, recording: Recording, settings: GapSettings) -> Ground:
    """Lay a recording out for a world, its noise measured, at the coarsest substep that moves it alike."""
    noise = run_noise([_along_arcs(world, run) for run in recording.runs])
    recording = Recording(tuple(_thinned(r, settings.samples) for r in recording.runs))
    ground = Ground(world, recording, settings, noise)
    reference = _start_residuals(ground)
    for factor in COARSER:
        substep = world.time.substep * factor
        if substep > COARSEST or world.coupled:
            continue
        coarse = Ground(world.with_substep(substep), recording, settings, noise)
        apart = _start_residuals(coarse) - reference
        alike = max(ALIKE, RELATIVELY * float(np.sqrt(np.mean(reference**2))))
        if np.isfinite(apart).all() and float(np.sqrt(np.mean(apart**2))) < alike:
            return coarse
    return ground


def _known_at_first(states: StateMap, run: Run, noise: RunNoise) -> tuple[StateMap, Run]:
    """Return coordinates with spins that were measured at the first instant alone as priors, and the run without them.

    They are known of its initial state, and no series whose misfit could show what the motion lacks.
    """
    seen = np.isfinite(run.angular_velocities)
    prior, spins = states.prior.copy(), run.angular_velocities.copy()
    for column, axis in np.argwhere(seen[0] & (seen.sum(axis=0) == 1)).tolist():
        label = f"{run.names[column]}.angular_velocity.{'xyz'[axis]}"
        if label in states.labels:
            prior[states.labels.index(label)] = spins[0, column, axis], noise.spin[column, axis]
            spins[0, column, axis] = np.nan
    return replace(states, prior=prior), replace(run, angular_velocities=spins)


def _along_arcs(world: World, run: Run) -> Run:
    """Return the run with arcs as the positions of what was measured as an angle, whose noise is the same everywhere
    along them."""
    positions = run.positions.copy()
    for column, (arc, _) in arcs(world, run).items():
        positions[:, column] = arc[:, None]
    return replace(run, positions=positions)


def _thinned(run: Run, most: int) -> Run:
    """Return every few samples of a long run: motion is resolved by far fewer than it takes to measure the noise."""
    stride = max(1, len(run.times) // most)
    return run if stride == 1 else run.rows(np.arange(len(run.times)) % stride == 0)


def _start_residuals(ground: Ground) -> Array:
    problem = ground.problem(Hypothesis(ground.world))
    at = problem.start()
    jobs = [(run[0], at.shared[None], own[0][None]) for run, own in zip(problem.runs, at.states, strict=True)]
    return np.concatenate([one.residuals[0] for one in problem.evaluate(jobs, 1.0)])


@dataclass(frozen=True)
class _Derived:
    """Parameters of a run's world that follow: its clock's origin, and the frame as the observer counts it."""

    world: World
    origin: float

    def __call__(self, values: dict[str, Array]) -> Mapping[str, Array]:
        found: dict[str, Array] = {}
        count = len(next(iter(values.values()))) if values else 1
        if self.origin:
            found["time.origin"] = np.full(count, self.world.time.origin + self.origin)
        if self.world.observer is not None:
            own = {p: v for p, v in values.items() if p.startswith("observer.")}
            frame = values.get(CLOCK, np.full(count, self.world.time.seconds_per_frame))
            found[CLOCK] = frame * clock_ratio(self.world.observer, own)
        return found


def _sampled(stamps: Array, unknowns: Sequence[Unknown], world: World) -> Array:
    """Return instants about the stamps that a shift of time within its bounds may show."""
    shifted = [p for u in unknowns for p in u.paths if p in ("observer.shift", "observer.time_offset")]
    assert world.observer is not None
    if not shifted and not world.observer.shift and not world.observer.time_offset:
        return stamps
    interval = float(np.median(np.diff(stamps)))
    gaps = np.flatnonzero(np.diff(stamps) > 1.5 * interval)
    inside = [np.arange(stamps[k] + interval, stamps[k + 1] - 0.5 * interval, interval) for k in gaps]
    before = stamps[0] - interval * np.arange(1, MARGIN + 1)
    after = stamps[-1] + interval * np.arange(1, MARGIN + 1)
    return np.unique(np.concatenate([before[before >= 0.0], stamps, after, *inside]))


def _own_map(u: Unknown) -> StateMap:
    def overrides(values: Array, _: Mapping[str, Array]) -> dict[str, Array]:
        return {path: values[:, 0].copy() for path in u.paths}

    prior = np.array([[u.start, np.inf if u.plausible is None else u.plausible]])
    return StateMap((u.name,), np.array([u.start]), np.array([u.typical]), prior, overrides)
