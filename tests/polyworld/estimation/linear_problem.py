"""Problems whose residuals are linear in the unknowns: least squares and posteriors are known in closed form."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_settings import DescentSettings
from polyworld.estimation.least_squares import Point, Problem
from polyworld.estimation.problem import Block, Evaluated
from polyworld.estimation.stretches import Link
from polyworld.estimation.unknown import Unknown, of_paths
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]

PLACE, SPEED = 0.5, 2.0  # standard deviations of links [m], [m/s]
STATES = tuple(f"{f}.{a}" for f in ("position", "velocity") for a in "xyz")
SHARED = ("friction", "restitution", "linear_damping", "angular_damping")
BALL = World(objects=(RigidObject(name="ball", shape=Sphere(radius=0.1), position=(0.0, 0.0, 0.0)),))


@dataclass
class Rows:
    """What counts as measured: `size` numbers."""

    size: int

    def residuals(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return nothing: a linear problem has no motion."""
        raise NotImplementedError

    def owners(self, samples: int) -> list[str]:
        """Return the only body."""
        return ["ball"] * min(samples, self.size)


@dataclass
class Linear:
    """residuals = offset + by_shared a + by_states y, and so the end of a stretch where the rows go on."""

    offset: Array
    by_shared: Array
    by_states: Array

    def __call__(self, shared: Array, states: Array) -> Array:
        """Return residuals (k, m) of settings (k, S), (k, N)."""
        value: Array = self.offset + shared @ self.by_shared.T + states @ self.by_states.T
        return value


def shared_unknown(i: int, **fields: object) -> Unknown:
    """The i-th shared unknown, unbounded for all that matters."""
    given = {"start": 0.0, "lower": -1e3, "upper": 1e3, "typical": 1.0, **fields}
    return Unknown(SHARED[i], (f"objects.ball.{SHARED[i]}",), "1", **given)  # type: ignore[arg-type]


class LinearProblem(Problem):
    """runs: number of stretches of each run. Every stretch has six states and `rows` residuals."""

    def __init__(
        self,
        runs: Sequence[int],
        unknowns: Sequence[Unknown],
        *,
        rows: int = 20,
        huber: float = np.inf,
        seed: int = 0,
        scale: float = 1.0,
        state_prior: float = np.inf,
        renewed: int = 1,
    ) -> None:
        rng, self.laws, self.ends = np.random.default_rng(seed), {}, {}
        s, blocks = len(unknowns), []
        paths = [f"objects.ball.{n}" for n in STATES]
        states = of_paths(dict.fromkeys(paths, (0.0, 1.0)), dict.fromkeys(paths, (0.3, state_prior)))
        for count in runs:
            run = []
            for b in range(count):
                link = Link(1.0, {"ball": PLACE}, {"ball": SPEED}, {"ball": 0.1}, ("ball",)) if b + 1 < count else None
                block = Block(f"run {len(blocks)}", BALL, np.arange(3.0), Rows(rows), states, link)
                self.laws[id(block)] = Linear(
                    scale * rng.normal(size=rows), rng.normal(size=(rows, s)), rng.normal(size=(rows, 6))
                )
                self.ends[id(block)] = Linear(rng.normal(size=6), rng.normal(size=(6, s)), rng.normal(size=(6, 6)))
                run.append(block)
            for before, after in itertools.pairwise(run):
                before.after = after
            blocks.append(run)
        super().__init__(blocks, unknowns, DescentSettings(huber=huber, iterations=60, rest=1e-10, renewed=renewed))

    def evaluate(
        self,
        settings: Sequence[tuple[Block, Array, Array]],
        most: float,  # noqa: ARG002
    ) -> list[Evaluated]:
        """Evaluate the linear laws instead of rollouts."""
        found = []
        for block, shared, states in settings:
            end = self.ends[id(block)](shared, states) if block.link else None
            found.append(Evaluated(self.laws[id(block)](shared, states), end))
        return found

    def dense(self) -> tuple[Array, Array]:
        """Return (matrix (m, n), offset (m,)) of all residuals: of stretches, links and priors, in one system."""
        blocks = [(r, b) for r, run in enumerate(self.runs) for b in range(len(run))]
        s, n = len(self.shared), len(self.shared) + 6 * len(blocks)
        rows: list[Array] = []
        offsets: list[Array] = []
        unit = np.array([PLACE] * 3 + [SPEED] * 3)
        for i, (r, b) in enumerate(blocks):
            block, own = self.runs[r][b], slice(s + 6 * i, s + 6 * i + 6)
            for law, linked in ((self.laws[id(block)], False), (self.ends[id(block)], True)):
                if linked and block.link is None:
                    continue
                part = np.zeros((len(law.offset), n))
                part[:, :s], part[:, own] = law.by_shared, law.by_states
                if linked:
                    part[:, own.stop : own.stop + 6] = -np.diag(1.0 / unit)
                rows.append(part)
                offsets.append(law.offset)
            sd = block.states.prior[:, 1]
            if np.isfinite(sd).all():
                part = np.zeros((6, n))
                part[:, own] = np.diag(1.0 / sd)
                rows.append(part)
                offsets.append(-block.states.prior[:, 0] / sd)
        for i in np.flatnonzero(np.isfinite(self.prior_sd)):
            part = np.zeros((1, n))
            part[0, i] = 1.0 / self.prior_sd[i]
            rows.append(part)
            offsets.append(np.array([-self.prior_mean[i] / self.prior_sd[i]]))
        return np.concatenate(rows), np.concatenate(offsets)


def flat(point: Point) -> Array:
    """Return all coordinates of a point in one vector, in the order of `LinearProblem.dense`."""
    return np.concatenate([point.shared, *(y for run in point.states for y in run)])
