"""Blocks of a study made ready: whitened residuals of many settings, by batches of rollouts.

A block is a run, or a stretch of one: a world, instants, what was measured at them, and initial states of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.machines import Job, Machines, Seat, roll
from polyworld.estimation.stretches import Link
from polyworld.estimation.unknown import StateMap, Unknown
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

LOST = 1e3  # standard deviations that a residual counts whose rollout diverges


class Readout(Protocol):
    """Measurements of a block, in the order of time."""

    size: int

    def residuals(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return standardised residuals (k, m) of all that was measured within the first `samples` instants."""
        ...

    def owners(self, samples: int) -> list[str]:
        """Return the object (m,) of every residual within the first `samples` instants."""
        ...


@dataclass(frozen=True)
class Evaluated:
    """Residuals (k, m) of k settings in standard deviations, and where they end (k, q) in those of the link."""

    residuals: Array
    end: Array | None


@dataclass
class Block:
    """A run, or a stretch of one.

    times (T,) [s]: instants at which it was measured, since its start. observed_by: path -> parameters (k,) of worlds
    that follow from others, such as a clock's; None where nothing does. after: the stretch that `link` leads to.
    observer: (motion, parameters `observer.*` (k,)) -> the motion as it is observed; None where it is as it was.
    groups: a partition of the bodies into those that may act on one another; () where all may.
    """

    name: str
    world: World
    times: Array
    readout: Readout
    states: StateMap
    link: Link | None = None
    derive: Callable[[dict[str, Array]], Mapping[str, Array]] | None = None
    observer: Callable[[BatchTrajectory, Mapping[str, Array]], BatchTrajectory] | None = None
    groups: tuple[frozenset[str], ...] = ()
    after: Block | None = None
    seat: Seat = field(init=False, repr=False)
    bound: Ints = field(init=False, repr=False)
    _terms: dict[str, list[tuple[int, float, bool, float]]] = field(init=False, repr=False)

    def prepare(self, shared: Sequence[Unknown], machines: Machines) -> None:
        """Take a seat, and find which shared unknowns count in this block's world."""
        end = [self.link.time] if self.link else []
        self.seat = machines.seat(self.world, np.concatenate([self.times, end]))
        known = machines.paths(self.world)
        self._terms = {}
        for i, u in enumerate(shared):
            powers = u.powers or (1.0,) * len(u.paths)
            for path, power in zip(u.paths, powers, strict=True):
                if path in known and u.run in (None, self.name) and (self.name, path) not in u.elsewhere:
                    self._terms.setdefault(path, []).append((i, power, u.scale == "log", u.lower))
        self._limits = {path: (spec.lower, spec.upper) for path, spec in known.items()}
        if self.link and self.after:  # places and velocities; turns and spins where they are the next stretch's to fit
            _, slopes = _start(self.after, self.link, self.after.states.start[None])
            kept = (slopes != 0.0).any(axis=1).reshape(-1, 4, 3)
            kept[:, :2] = True
            kept[:, 2] &= np.array([[n in self.link.turns] for n in self.link.place])
            self.bound = np.flatnonzero(kept)

    def touched(self, shared: Sequence[Unknown]) -> Flags:
        """Return which groups (S + N, G) every coordinate moves: all where it is not of certain bodies alone."""
        found = np.ones((len(shared) + self.states.count, max(len(self.groups), 1)), dtype=bool)
        if len(self.groups) > 1:
            for row, u in zip(found, shared, strict=False):
                parts = [path.split(".") for path in u.paths]
                if all(p[0] == "objects" for p in parts):
                    row[:] = [any(p[1] in group for p in parts) for group in self.groups]
            for row, label in zip(found[len(shared) :], self.states.labels, strict=True):
                own = [label.rsplit(".", 1)[0] in g or label.split(".")[0] in g for g in self.groups]
                if any(own):
                    row[:] = own
        return found

    def owned(self, most: float, link: bool) -> tuple[Ints, Ints]:
        """Return the group to which every residual (m,) belongs, and every component (q,) of the link's end."""
        index = {name: i for i, group in enumerate(self.groups) for name in group}
        owners = self.readout.owners(self.samples(most))
        ends = np.repeat([index[n] for n in self.link.place], 12)[self.bound] if self.link and link else np.zeros(0)
        return np.array([index[n] for n in owners], dtype=np.int64), ends.astype(np.int64)

    @property
    def size(self) -> int:
        """Number of measured components."""
        return self.readout.size

    def samples(self, most: float) -> int:
        """Return how many samples lie within a share `most` of the block's time; above 1, that many."""
        if most > 1.0:
            return min(int(most), len(self.times))
        end = self.times[0] + most * (self.times[-1] - self.times[0])
        return max(2, int(np.searchsorted(self.times, end * (1.0 + 1e-12), "right")))

    def overrides(self, shared: Array, states: Array) -> dict[str, Array]:
        """Return values (k,) by path of shared coordinates (k, S) and states (k, N)."""
        found: dict[str, Array] = {}
        for path, terms in self._terms.items():
            value = (
                np.exp(sum(p * shared[:, i] for i, p, *_ in terms))
                if terms[0][2]
                else sum(p * np.maximum(shared[:, i], lower) for i, p, _, lower in terms)
            )
            found[path] = np.clip(value, *self._limits[path])
        for path, value in self.states.overrides(states, found).items():  # a trial step may go anywhere
            found[path] = np.clip(value, *self._limits[path]) if path in self._limits else value
        if self.derive is not None:
            found |= self.derive(found)
        return found

    def job(self, shared: Array, states: Array, most: float) -> Job:
        """Return the rollouts that an evaluation takes."""
        count = self.samples(most)
        reach = len(self.times) + (self.link is not None) if count == len(self.times) else count
        values = self.overrides(shared, states)
        observed = {path: values.pop(path) for path in tuple(values) if path.startswith("observer.")}
        return Job(self.seat, values, len(shared), reach, observed)

    def read(self, batch: BatchTrajectory, most: float, observed: Mapping[str, Array]) -> Evaluated:
        """Compare the motion of such rollouts with what was measured. observed: parameters (k,) of the observer."""
        count = self.samples(most)
        broken = batch.stopped
        if self.observer is not None:
            batch = self.observer(batch, observed)
        residuals = self.readout.residuals(batch, count)
        residuals[broken | ~np.isfinite(residuals).all(axis=1)] = LOST
        if self.link is None or count < len(self.times):
            return Evaluated(residuals, None)
        assert self.after is not None
        columns, at = [batch.names.index(n) for n in self.link.place], len(self.times)
        described = np.array([self.after.world.object(n).orientation for n in self.link.place])
        turn = rotation_vector(batch.orientations[:, at, columns], described)
        moved = batch.positions, batch.velocities, batch.angular_velocities
        place, speed, spin = (values[:, at, columns] for values in moved)
        end = np.stack([place, speed, turn, spin], axis=2) / self.link.deviations()[..., None]
        end = end.reshape(len(end), -1)[:, self.bound]
        end[broken] = LOST
        return Evaluated(residuals, end)


def evaluate(settings: Sequence[tuple[Block, Array, Array]], most: float) -> list[Evaluated]:
    """Evaluate settings (block, shared (k, S), states (k, N)), simulated together."""
    jobs = [block.job(shared, states, most) for block, shared, states in settings]
    return [block.read(m, most, j.observed) for (block, _, _), m, j in zip(settings, roll(jobs), jobs, strict=True)]


def link_start(block: Block, before: Block, states: Array) -> tuple[Array, Array]:
    """Return where settings (k, N) of a stretch begin, in the units of the link before (k, q), and slopes (q, N)."""
    assert before.link is not None
    start, slopes = _start(block, before.link, states)
    return start[:, before.bound], slopes[before.bound]


def _start(block: Block, link: Link, states: Array) -> tuple[Array, Array]:
    """Return place, velocity, turn and spin of every body of a link at the start of a block, and slopes."""
    n, rows, deviations = states.shape[1], len(states), link.deviations()
    probes = np.concatenate([states, states[:1] + block.states.typical * np.eye(n)])
    found = block.states.overrides(probes, {})
    start = np.zeros((len(probes), len(link.place), 4, 3))
    for a, name in enumerate(link.place):
        item = block.world.object(name)
        first = (item.position, item.velocity, (0.0, 0.0, 0.0), item.angular_velocity)
        for f, kind in enumerate(("position", "velocity", "rotation", "angular_velocity")):
            for c, axis in enumerate("xyz"):
                start[:, a, f, c] = found.get(f"objects.{name}.{kind}.{axis}", first[f][c]) / deviations[a, f]
    flat = start.reshape(len(probes), -1)
    slopes = (flat[rows:] - flat[0]) / block.states.typical[:, None]
    return flat[:rows], slopes.T
