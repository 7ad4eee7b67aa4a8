"""Robust least squares over runs that share constants: block-bordered normal equations, states eliminated by run.

Levenberg-Marquardt (Marquardt 1963) with Huber's loss by iterated weights; derivatives by differences in one batch a
stretch; several dampings tried in one batch; bounds by an active set. Runs are joined by the shared unknowns
alone, so that initial states are eliminated by a Schur complement a run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.declared import bounds_in_coordinates
from polyworld.estimation.differences import coloured, difference_slopes
from polyworld.estimation.fit_settings import DescentSettings
from polyworld.estimation.machines import Machines
from polyworld.estimation.problem import Block, Evaluated, evaluate, link_start
from polyworld.estimation.robust import huber_loss, huber_weights
from polyworld.estimation.unknown import Unknown

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """Shared coordinates (S,), and initial states (N,) of every block of every run."""

    shared: Array
    states: tuple[tuple[Array, ...], ...]


@dataclass(frozen=True)
class Linearised:
    """Residuals (m,) of a block, slopes by shared (m, S) and by its states (m, N); the same of its end, if linked."""

    residuals: Array
    shared: Array
    states: Array
    end: tuple[Array, Array, Array] | None


@dataclass
class Normal:
    """Normal equations: of the shared coordinates (S, S), (S,), and by run of its states (n, n), (n,), and both.

    slopes: residuals and derivatives of every block, run by run, from which they were assembled.
    """

    shared: Array
    gradient: Array
    own: list[Array]
    own_gradient: list[Array]
    border: list[Array]
    slopes: list[Linearised]

    def information(self) -> Array:
        """Return the information of the shared coordinates (S, S) with the states of all runs eliminated."""
        found = self.shared.copy()
        for own, border in zip(self.own, self.border, strict=True):
            found -= border.T @ inverse(own) @ border
        return found


@dataclass(frozen=True)
class Minimum:
    """Where a descent ended. cost: robust chi-square, links and priors times the squared scale; misfit: of residuals
    alone."""

    point: Point
    cost: float
    normal: Normal
    converged: bool
    misfit: float


class Problem:
    """Runs of blocks with shared unknowns that have Gaussian priors.

    scale: of residuals in standard deviations of the noise: priors and links count by its square, as if each residual
    were divided by it.
    """

    def __init__(
        self,
        runs: Sequence[Sequence[Block]],
        shared: Sequence[Unknown],
        settings: DescentSettings,
        machines: Machines | None = None,
    ) -> None:
        self.runs, self.shared, self.settings = [tuple(r) for r in runs], tuple(shared), settings
        self.lower, self.upper = bounds_in_coordinates(shared)
        # Values stay at the bound below it, where slopes vanish: a minimum there is one at the bound.
        self.least = np.maximum(self.lower, [u.lower if u.scale == "linear" else -np.inf for u in shared])
        self.prior_mean = np.array([u.prior[0] if u.prior else 0.0 for u in shared])
        self.prior_sd = np.array([u.prior[1] if u.prior else np.inf for u in shared])
        self.typical = np.array([u.typical for u in shared])
        machines = machines or Machines()
        for run in self.runs:
            for block in run:
                block.prepare(self.shared, machines)
        self.rollouts = 0
        self.scale = 1.0

    def start(self) -> Point:
        """Return where unknowns start."""
        shared = np.array([np.log(u.start) if u.scale == "log" else u.start for u in self.shared])
        return Point(shared, tuple(tuple(b.states.start.copy() for b in run) for run in self.runs))

    def costs(self, points: Sequence[Point], most: float) -> Array:
        """Return the robust chi-square (K,) of points, with priors and links times the squared scale."""
        shared = np.stack([p.shared for p in points])
        states = [
            [np.stack([p.states[r][b] for p in points]) for b in range(len(run))] for r, run in enumerate(self.runs)
        ]
        total: Array = self.prior_costs(shared) + self.run_costs(shared, states, most).sum(axis=1)
        return total

    def prior_costs(self, shared: Array) -> Array:
        """Return the part (K,) of the priors of shared coordinates (K, S)."""
        scale = self.scale
        total: Array = ((scale * (shared - self.prior_mean) / self.prior_sd) ** 2).sum(axis=1)
        return total

    def run_costs(self, shared: Array, states: Sequence[Sequence[Array]], most: float) -> Array:
        """Return the robust chi-square (K, R) of runs at shared (K, S) and states[run][block] (K, N)."""
        settings = [(b, shared, states[r][i]) for r, run in enumerate(self.runs) for i, b in enumerate(run)]
        found, scale, huber = iter(self.evaluate(settings, most)), self.scale, self.settings.huber
        total = np.zeros((len(shared), len(self.runs)))
        for r, run in enumerate(self.runs):
            for i, block in enumerate(run):
                one, prior = next(found), block.states.prior
                total[:, r] += huber_loss(one.residuals, huber).sum(axis=1)
                total[:, r] += ((scale * (states[r][i] - prior[:, 0]) / prior[:, 1]) ** 2).sum(axis=1)
                if one.end is not None:
                    start, _ = link_start(run[i + 1], block, states[r][i + 1])
                    total[:, r] += scale**2 * huber_loss(one.end - start, huber).sum(axis=1)
        return total

    def evaluate(self, settings: Sequence[tuple[Block, Array, Array]], most: float) -> list[Evaluated]:
        """Evaluate settings of blocks, simulated together."""
        self.rollouts += sum(len(s) for _, s, _ in settings)
        return evaluate(settings, most)

    def normal(self, at: Point, most: float) -> Normal:
        """Linearise at a point."""
        return self._assembled(at, self.linearised(at, most))

    def _assembled(self, at: Point, slopes: list[Linearised]) -> Normal:
        s, scale = len(self.shared), self.scale
        found = Normal(np.zeros((s, s)), np.zeros(s), [], [], [], slopes)
        inside = np.isfinite(self.prior_sd)
        firm = (scale / self.prior_sd[inside]) ** 2
        found.shared[inside, inside] += firm
        found.gradient[inside] += firm * (at.shared - self.prior_mean)[inside]
        each = iter(slopes)
        for r, run in enumerate(self.runs):
            sizes = np.cumsum([0, *(b.states.count for b in run)])
            own, border = np.zeros((sizes[-1], sizes[-1])), np.zeros((sizes[-1], s))
            gradient = np.zeros(sizes[-1])
            for b, block in enumerate(run):
                where = np.arange(sizes[b], sizes[b + 1])
                one = next(each)
                pieces = [(1.0, one.residuals, one.shared, one.states, where)]
                if one.end is not None:
                    end, a, y = one.end
                    start, turn = link_start(run[b + 1], block, at.states[r][b + 1][None])
                    both = np.arange(sizes[b], sizes[b + 2])
                    pieces.append((scale**2, end - start[0], a, np.concatenate([y, -turn], axis=1), both))
                for size, residual, a, y, place in pieces:
                    w = size * huber_weights(residual, self.settings.huber)
                    aw, yw = a * w[:, None], y * w[:, None]
                    found.shared += aw.T @ a
                    found.gradient += aw.T @ residual
                    own[np.ix_(place, place)] += yw.T @ y
                    gradient[place] += yw.T @ residual
                    border[place] += yw.T @ a
                prior = block.states.prior
                firm = (scale / prior[:, 1]) ** 2
                own[where, where] += firm
                gradient[where] += np.where(firm > 0.0, (at.states[r][b] - prior[:, 0]) * firm, 0.0)
            found.own.append(own)
            found.own_gradient.append(gradient)
            found.border.append(border)
        return found

    def linearised(self, at: Point, most: float) -> list[Linearised]:
        """Return residuals and slopes of every block, by differences away from bounds in one batch.

        Coordinates that move bodies of different groups are varied together (Curtis, Powell & Reid 1974, J. Inst. Maths
        Applics 13, 117).
        """
        settings, plans = [], []
        s = len(at.shared)
        for run, own in zip(self.runs, at.states, strict=True):
            for block, states in zip(run, own, strict=True):
                n = len(states)
                steps = np.concatenate([self.typical, block.states.typical]) * self.settings.step
                centre = np.concatenate([at.shared, states])
                inside = centre + steps <= np.concatenate([self.upper, np.full(n, np.inf)])
                moved = centre + np.where(inside, steps, -steps)
                index, touched = np.arange(s + n), block.touched(self.shared)
                colour = coloured(touched)
                count = int(colour.max(initial=-1)) + 1
                points = np.repeat(centre[None], count + 1, axis=0)
                points[1 + colour, index] = moved
                settings.append((block, points[:, :s], points[:, s:]))
                plans.append((block, (moved - centre)[:, None], touched, colour))
        found = []
        for one, (block, width, touched, colour) in zip(self.evaluate(settings, most), plans, strict=True):
            ours = ends = None
            if touched.shape[1] > 1:
                measured, linked = block.owned(most, one.end is not None)
                ours, ends = touched[:, measured], touched[:, linked]
            end = None
            if one.end is not None:
                of_end = difference_slopes(one.end, colour, width, ends)
                end = (one.end[0], of_end[:, :s], of_end[:, s:])
            every = difference_slopes(one.residuals, colour, width, ours)
            found.append(Linearised(one.residuals[0], every[:, :s], every[:, s:], end))
        return found

    def secant(self, normal: Normal, before: Point, at: Point, most: float) -> Normal:
        """Linearise at a point with the slopes of the one before, corrected along the step between them.

        One rollout a block; Broyden (1965), Math. Comp. 19, 577, with steps in units of what is typical.
        """
        blocks = [(b, r, i) for r, run in enumerate(self.runs) for i, b in enumerate(run)]
        settings = [(b, at.shared[None], at.states[r][i][None]) for b, r, i in blocks]
        found = []
        for one, old, (block, r, i) in zip(self.evaluate(settings, most), normal.slopes, blocks, strict=True):
            change = np.concatenate([at.shared - before.shared, at.states[r][i] - before.states[r][i]])
            units = np.concatenate([self.typical, block.states.typical]) ** 2
            along = change / units / max(float(change @ (change / units)), 1e-300)
            s = len(at.shared)

            def corrected(
                new: Array, was: Array, by_shared: Array, by_states: Array,
                change: Array = change, along: Array = along, s: int = s,
            ) -> tuple[Array, Array, Array]:  # fmt: skip
                missed = new - was - by_shared @ change[:s] - by_states @ change[s:]
                return new, by_shared + np.outer(missed, along[:s]), by_states + np.outer(missed, along[s:])

            end = None if one.end is None or old.end is None else corrected(one.end[0], *old.end)
            found.append(Linearised(*corrected(one.residuals[0], old.residuals, old.shared, old.states), end))
        return self._assembled(at, found)

    def step(self, normal: Normal, at: Point, damping: float) -> Point:
        """Return the point that a damped Gauss-Newton step leads to, within bounds."""
        shared, gradient = normal.shared + damping * np.diag(np.diag(normal.shared) + 1e-12), normal.gradient.copy()
        solved = []
        for own, g, border in zip(normal.own, normal.own_gradient, normal.border, strict=True):
            damped = own + np.diag(damping * np.diag(own) + 1e-9)
            both = np.linalg.solve(damped, np.concatenate([g[:, None], border], axis=1))
            shared, gradient = shared - border.T @ both[:, 1:], gradient - border.T @ both[:, 0]
            solved.append((both[:, 0], both[:, 1:]))
        free = ~(
            ((at.shared <= self.least) & (normal.gradient > 0.0))
            | ((at.shared >= self.upper) & (normal.gradient < 0.0))
        )
        change = np.zeros(len(gradient))
        if free.any():
            size = np.maximum(np.diag(shared)[free], 1e-300) ** -0.5  # units differ by orders of magnitude
            scaled = shared[np.ix_(free, free)] * size[:, None] * size
            change[free] = -size * np.linalg.lstsq(scaled, gradient[free] * size, rcond=1e-12)[0]
        moved = np.clip(at.shared + change, self.least, self.upper)
        change = moved - at.shared
        states = []
        for run, own_states, (g, border) in zip(self.runs, at.states, solved, strict=True):
            turn = -g - border @ change
            cuts = np.cumsum([b.states.count for b in run])[:-1]
            states.append(tuple(y + d for y, d in zip(own_states, np.split(turn, cuts), strict=True)))
        return Point(moved, tuple(states))

    def descend(
        self,
        at: Point,
        most: float,
        watch: Callable[[float], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> Minimum:
        """Minimise from a point over a share of every block's time."""
        cost = float(self.costs([at], most)[0])
        damping, still = 1e-2, 0
        normal, age = self.normal(at, most), 0
        for _ in range(self.settings.iterations):
            if cancelled is not None and cancelled():
                break
            trials = [self.step(normal, at, damping * f) for f in self.settings.dampings]
            costs = self.costs(trials, most)
            best = int(np.argmin(costs))
            gain = cost - float(costs[best])
            little, old = gain < self.settings.rest * self.scale**2, age > 0
            if gain > 0.0:
                before, at, cost = at, trials[best], float(costs[best])
                damping = float(np.clip(damping * self.settings.dampings[best], self.settings.least, 1e4))
                age = 0 if age + 1 >= self.settings.renewed or (little and old) else age + 1
                normal = self.secant(normal, before, at, most) if age else self.normal(at, most)
            elif old:
                normal, age = self.normal(at, most), 0
            else:
                damping = min(damping * self.settings.dampings[-1], 1e6)
            if watch is not None:
                watch(cost)
            still = 0 if not little else still if old else still + 1
            if still >= 2:
                break
        return Minimum(at, cost, normal, still >= 2, self._misfit(normal))

    def fit(
        self,
        at: Point | None = None,
        watch: Callable[[float, float], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
        stages: Sequence[float] | None = None,
    ) -> Minimum:
        """Fit over growing shares of the time, from where unknowns start or from a point.

        Each stage has the scale of residuals that the one before left, and the last is repeated where it left another.
        watch: called with the share of the work done and the cost. cancelled: asked before each iteration.
        """
        stages = [*(stages or self._stages()), 1.0]
        at = at or self.start()
        for number, share in enumerate(stages):
            steps = 0

            def watched(cost: float, number: int = number) -> None:
                nonlocal steps
                steps += 1
                if watch is not None:
                    watch((number + 1.0 - 0.8**steps) / len(stages), cost)

            found = self.descend(at, share, watched, cancelled)
            at, before = found.point, self.scale
            scale = float(np.sqrt(self.remainder(found)))
            last = number == len(stages) - 1
            if last or (share == 1.0 and abs(scale - before) < self.settings.same * before):
                break
            self.scale = scale
        return found

    def _stages(self) -> list[float]:
        """Return shares of the time fitted in turn, each with half as many samples again as the one before."""
        blocks = [b for run in self.runs for b in run]
        found, before = [], 0
        for share in (float(self.settings.opening), *self.settings.stages):
            samples = max((b.samples(share) for b in blocks), default=0)
            if share == 1.0 or samples > 1.5 * before:
                found.append(share)
                before = samples
        last = max((len(b.times) for b in blocks), default=0)
        return [s for s in found if s == 1.0 or max(b.samples(s) for b in blocks) < last / 1.25]

    def at(self, point: Point) -> Minimum:
        """Return a point as a minimum that something else found."""
        normal = self.normal(point, 1.0)
        return Minimum(point, float(self.costs([point], 1.0)[0]), normal, True, self._misfit(normal))

    def _misfit(self, normal: Normal) -> float:
        every = np.concatenate([one.residuals for one in normal.slopes])
        return float(huber_loss(every, self.settings.huber).sum())

    def remainder(self, found: Minimum) -> float:
        """Return the mean square of residuals in variances of the noise, at least 1: what the model leaves."""
        slopes = found.normal.slopes
        count = sum(len(one.residuals) + (0 if one.end is None else len(one.end[0])) for one in slopes)
        free = count - len(self.shared) - sum(one.states.shape[1] for one in slopes)
        return float(max(1.0, found.misfit / max(free, 0.25 * count, 1.0)))

    def evidence(self, found: Minimum) -> float:
        """Return minus twice the logarithm of the evidence, up to a constant, by Laplace's approximation.

        The minimum over the variance of residuals, the part of that variance, and how much the data narrow the priors
        of the shared unknowns: ln det(S H), H (S, S) the information with initial states eliminated, S of the priors.
        """
        known, variance = np.isfinite(self.prior_sd), self.scale**2
        scaled = found.normal.information()[np.ix_(known, known)] * np.outer(self.prior_sd[known], self.prior_sd[known])
        occam = np.linalg.slogdet(scaled / variance + 1e-12 * np.eye(len(scaled)))[1]
        count = sum(len(one.residuals) for one in found.normal.slopes)
        return float(found.cost / variance + count * np.log(variance) + occam)

    def slacks(self, point: Point, r: int) -> tuple[float, ...]:
        """Return by link of a run the root mean square departure from it, in its standard deviations."""
        run, found = self.runs[r], []
        states = point.states[r]
        for b, one in enumerate(
            self.evaluate([(k, point.shared[None], y[None]) for k, y in zip(run, states, strict=True)], 1.0)
        ):
            if one.end is not None:
                start, _ = link_start(run[b + 1], run[b], states[b + 1][None])
                found.append(float(np.sqrt(np.mean((one.end - start) ** 2))))
        return tuple(found)


def inverse(own: Array) -> Array:
    """Return the inverse of the information of states (n, n), some of which nothing may show."""
    return np.asarray(np.linalg.pinv(own + 1e-9 * np.eye(len(own)), hermitian=True) if len(own) else own)
