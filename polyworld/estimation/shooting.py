"""Fit chains of segments with a continuity tolerance that is lowered in stages until each run is one trajectory.

Multiple shooting (Bock 1983): the segments' initial states follow the data, so that no stage is far from a solution,
however many impacts a run has. A tolerance that stays above zero is the model-error term of weak-constraint data
assimilation (Tremolet 2006, Q. J. R. Meteorol. Soc. 132, 2483).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.continuity import Boundary
from polyworld.estimation.least_squares import (
    FIRST_STEP,
    FLOOR,
    PRIOR,
    SHARED_DAMPINGS,
    STATE_DAMPINGS,
    STEP,
    STEPS,
    Chains,
    Linear,
    NormalEquations,
    Point,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stage:
    """What a stage of a fit came to: tolerance of jumps (in units of their scales), chi2 of the data, squared jumps in
    those units, iterations, and whether it converged."""

    tolerance: float
    chi2: float
    jumps: float
    iterations: int
    converged: bool

    @property
    def cost(self) -> float:
        """What the stage minimised."""
        return self.chi2 + self.jumps / self.tolerance**2


@dataclass
class Fit:
    """A fit in progress: point, dampings and steps carry over from stage to stage."""

    chains: Chains
    at: Point
    damping: float = 1e-3
    run_damping: Array | None = None
    steps: tuple[Array, tuple[Array, ...]] | None = None
    linear: Linear | None = None

    def first_steps(self) -> tuple[Array, tuple[Array, ...]]:
        """Steps of difference quotients while no standard errors are known."""
        return FIRST_STEP * self.chains.typical, tuple(
            FIRST_STEP * s.layout.typical for s in self.chains.problem.segments
        )

    def stage(self, tolerance: float, iterations: int, gain: float) -> Stage:
        """Descend at one tolerance until the cost falls by less than `gain`, or iterations run out."""
        chains = self.chains
        runs = len(chains.problem.chains)
        run_damping = np.full(runs, 1e-3) if self.run_damping is None else self.run_damping
        steps = self.first_steps() if self.steps is None else self.steps
        data = broken = cost = np.inf
        converged = False
        used = 0
        while used < iterations:
            used += 1
            linear = chains.linearise(self.at, *steps)
            self.linear = linear
            data = float(sum(r @ r for r in linear.r))
            broken = float(sum(j @ j for j in linear.jump))
            cost = data + broken / tolerance**2
            if not np.isfinite(cost):
                break
            normal = NormalEquations(chains, linear, tolerance)
            self.steps = steps = standard_steps(normal)
            better = self._try(normal, tolerance, cost, run_damping)
            if better is None:
                self.damping = min(self.damping * 1e3, 1e8)
                run_damping = np.minimum(run_damping * 1e3, 1e8)
                if self.damping >= 1e6:
                    converged = True  # no step of any length lowers the cost
                    break
                continue
            to, there, run_damping = better
            self.at = to
            if cost - there < gain:
                converged = True
                cost = there
                break
            cost = there
        self.run_damping = np.clip(run_damping, 1e-6, 1e2)
        self.damping = float(np.clip(self.damping, 1e-6, 1e2))
        d, j = chains.costs([self.at])
        return Stage(tolerance, float(d.sum()), float(j.sum()), used, converged)

    def _try(
        self, normal: NormalEquations, tolerance: float, cost: float, run_damping: Array
    ) -> tuple[Point, float, Array] | None:
        chains = self.chains
        runs = range(len(chains.problem.chains))
        shared = len(self.at.values)
        g_factors = SHARED_DAMPINGS if shared else np.ones(1)
        inverses = [[normal.factor(r, float(run_damping[r] * f), FLOOR) for r in runs] for f in STATE_DAMPINGS]
        points: list[Point] = []
        middle = inverses[len(STATE_DAMPINGS) // 2]
        matrix, vector = normal.reduced(middle)
        for g in g_factors:
            step = normal.shared_step(matrix, vector, self.at.values, self.damping * g) if shared else np.zeros(0)
            for own in inverses:
                states = list(self.at.states)
                for r in runs:
                    change = normal.state_step(r, own[r], step)
                    for k, where in normal.offsets[r].items():
                        states[k] = states[k] + change[where]
                points.append(Point(self.at.values + step, tuple(states)))
        data, broken = chains.costs(points)
        total = (data + broken / tolerance**2).reshape(len(g_factors), len(STATE_DAMPINGS), -1)
        choice = np.argmin(total, axis=1)  # (G, R): every run takes the damping that suits it
        least = np.take_along_axis(total, choice[:, None], axis=1)[:, 0].sum(axis=1)
        best = int(np.argmin(least))
        if not least[best] < cost:
            return None
        states = list(self.at.states)
        for r in runs:
            chosen = points[best * len(STATE_DAMPINGS) + int(choice[best, r])]
            for k in normal.offsets[r]:
                states[k] = chosen.states[k]
        self.damping = float(np.clip(self.damping * g_factors[best], 1e-8, 1e8))
        run_damping = np.clip(run_damping * STATE_DAMPINGS[choice[best]], 1e-8, 1e8)
        return Point(points[best * len(STATE_DAMPINGS)].values, tuple(states)), float(least[best]), run_damping


def standard_steps(normal: NormalEquations) -> tuple[Array, tuple[Array, ...]]:
    """Steps of difference quotients that are a fraction of standard errors."""
    chains = normal.chains
    inverses = [normal.factor(r, 0.0, PRIOR) for r in range(len(normal.h))]
    own: list[Array] = [np.zeros(0)] * len(chains.problem.segments)
    for r, inverse in enumerate(inverses):
        errors = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        for k, where in normal.offsets[r].items():
            typical = chains.problem.segments[k].layout.typical
            own[k] = np.clip(STEP * errors[where], STEPS[0] * typical, STEPS[1] * typical)
    if not len(chains.typical):
        return np.zeros(0), tuple(own)
    matrix, _ = normal.reduced(inverses)
    matrix = matrix + np.diag((PRIOR / chains.typical) ** 2)
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(matrix, hermitian=True)), 0.0))
    return np.clip(STEP * errors, STEPS[0] * chains.typical, STEPS[1] * chains.typical), tuple(own)


def set_scales(chains: Chains, at: Point) -> None:
    """Set the unit of every jump: the standard error that a segment's own data leave of its initial state.

    The median over all boundaries of a component's kind is taken, so that a short or ill-placed segment does not have
    a unit of its own; typical changes bound it.
    """
    own = tuple(FIRST_STEP * s.layout.typical for s in chains.problem.segments)
    chains.scale = [np.ones(b.length) for b in chains.continuity.boundaries]
    linear = chains.linearise(at, FIRST_STEP * chains.typical, own)
    found: dict[tuple[int, bool], list[float]] = {}
    for i, boundary in enumerate(chains.continuity.boundaries):
        b = linear.b[boundary.after]
        typical = chains.problem.segments[boundary.after].layout.typical
        covariance = np.linalg.inv(b.T @ b + np.diag((1.0 / typical) ** 2))
        jump = linear.jump_after[i]
        units = np.sqrt(np.maximum(np.einsum("dn,nm,dm->d", jump, covariance, jump), 0.0))
        for kind, unit in zip(_kinds(boundary), units, strict=True):
            found.setdefault(kind, []).append(float(unit))
    middle = {kind: float(np.median(units)) for kind, units in found.items()}
    chains.scale = [np.array([middle[k] for k in _kinds(b)]) for b in chains.continuity.boundaries]


def _kinds(boundary: Boundary) -> list[tuple[int, bool]]:
    """Kind of every component, those about or along the third axis apart; constants last."""
    moving = zip(boundary.kind.tolist(), (boundary.axis == 2).tolist(), strict=True)
    return [*moving, *[(-1, False)] * len(boundary.constant)]
