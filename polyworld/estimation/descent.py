"""Levenberg-Marquardt on simulated trajectories (Marquardt 1963), with every run's initial state eliminated.

The normal equations of shared unknowns and of the initial states of R runs are block-bordered: a Schur complement
leaves a system of the shared unknowns alone. Derivatives are difference quotients from one batch of rollouts, with
steps that are a fraction of standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import Noise
from polyworld.estimation.normal_equations import (
    HELD,
    PRIOR,
    Hold,
    Linearised,
    NormalEquations,
    damped_inverse,
    within_reach,
)
from polyworld.world import World

Array = NDArray[np.float64]

STEP = 0.2  # of a standard error, for difference quotients
FIRST_STEP = 1e-3  # of a typical change, while no standard error is known
STEPS = (1e-5, 1e-2)  # bounds of steps, in typical changes
ROUGH_STEP = 0.3  # of a typical change: no less where a liquid splashes, whose motion jumps a little at any change
TRIALS = 10.0 ** np.array([-2.0, -1.0, 0.0, 1.0, 2.0])  # dampings tried at once, as factors of the last successful one
NO_NEARER = 0.1  # of the distance to its target that a step of a fit has to gain
STUCK = 0.05  # of chi2: a fit that no step betters, though slopes predict a greater fall, has not converged
BENT = 0.02  # of chi2, by which the least damped step is worse than the best where the valley is bent
LEASH = 1.0  # typical changes, that a value may stray by where the data do not determine it yet


@dataclass(frozen=True)
class Estimate:
    """Shared unknowns (S,) and initial states[run] (N,)."""

    values: Array
    states: tuple[Array, ...]


Steps = tuple[Array, tuple[Array, ...]]  # of difference quotients, by shared unknowns (S,) and initial states[run] (N,)


def held(forward: Forward, start: Array, horizon: float) -> Hold:
    """Hold values near their start while only parts of the runs are fitted, unless these parts determine them: a place
    that no body has come to yet would stray."""
    typical = np.array([u.typical for u in forward.unknowns])
    return Hold(start, (1.0 / (LEASH * typical)) ** 2 if horizon < 1.0 else np.zeros(len(start)))


def first_steps(forward: Forward) -> Steps:
    """Return steps of difference quotients while no standard errors are known."""
    first = max(FIRST_STEP, least_step(forward.world))
    shared = np.array([first * u.typical for u in forward.unknowns])
    return shared, tuple(first * r.typical for r in forward.design.runs)


def least_step(world: World) -> float:
    """Return the least step of a difference quotient, in typical changes, that shows beyond the roughness of a world's
    motion."""
    return ROUGH_STEP if world.of_form("liquid") else 0.0


def descend(
    forward: Forward,
    noise: Noise,
    at: Estimate,
    horizon: float,
    steps: Steps,
    iterations: int,
    tolerance: float,
    target: float | None,
    hold: Hold,
) -> tuple[Estimate, Steps, int, bool]:
    """Descend from an estimate: return where it ends, steps for difference quotients there, iterations used, and
    whether it has converged. tolerance, target: as in `profile.fit`."""
    if not len(at.values) and not any(len(s) for s in at.states):
        return at, steps, 0, True  # nothing to fit
    damping = 1e-4
    chi2 = np.inf
    for iteration in range(iterations):
        linear = linearised(forward, noise, at, horizon, steps)
        chi2 = linear.chi2 + hold.cost(at.values)
        if not np.isfinite(chi2):
            return at, steps, iteration, False
        steps = standard_steps(forward, linear)
        dampings = damping * TRIALS
        normal = NormalEquations(forward, linear)
        normal.hold(hold, at.values)
        trials = [_step(forward, normal, at, d) for d in dampings]
        costs = _costs(forward, noise, trials, horizon, hold)
        if costs[0] > min(float(costs.min()), chi2) + BENT * chi2:
            trials, costs = _with_states_after(forward, noise, trials, costs, linear, horizon, hold)
        best = int(np.argmin(costs))
        if not costs[best] < chi2:
            at_rest = _predicted_fall(linear, at, trials[0]) < max(tolerance, STUCK * chi2)
            damping *= 1e4
            if damping > 1e10:
                return at, steps, iteration + 1, at_rest
            trials = [_step(forward, normal, at, d) for d in damping * TRIALS]
            costs = _costs(forward, noise, trials, horizon, hold)
            best = int(np.argmin(costs))
            if not costs[best] < chi2:
                return at, steps, iteration + 1, at_rest
            dampings = damping * TRIALS
        gain = chi2 - costs[best]
        at, chi2 = trials[best], float(costs[best])
        damping = float(np.clip(dampings[best], 1e-8, 1e8))
        if gain < tolerance + 1e-6 * chi2:
            return at, steps, iteration + 1, True
        if target is not None and gain < NO_NEARER * (chi2 - target):
            return at, steps, iteration + 1, False
    return at, steps, iterations, False


def _predicted_fall(linear: Linearised, at: Estimate, to: Estimate) -> float:
    """Return the fall of chi2 that the slopes predict for a step."""
    shared = to.values - at.values
    after = (
        r + a @ shared + b @ (new - old)
        for r, a, b, new, old in zip(linear.r, linear.a, linear.b, to.states, at.states, strict=True)
    )
    return linear.chi2 - float(sum(float(x @ x) for x in after))


def linearised(forward: Forward, noise: Noise, at: Estimate, horizon: float, steps: Steps) -> Linearised:
    """Return residuals before a horizon and their slopes; infinite residuals of runs whose rollout diverges."""
    shared, own = steps
    lower, upper = _bounds(forward)
    s = len(shared)
    # A step that would leave the bounds goes the other way.
    signed = np.where(at.values + shared > upper, -shared, shared)
    settings = []
    for r in forward.design.runs:
        n = r.count
        values = np.repeat(at.values[None], 1 + s + n, axis=0)
        states = np.repeat(at.states[r.index][None], 1 + s + n, axis=0)
        values[1 + np.arange(s), np.arange(s)] += signed
        states[1 + s + np.arange(n), np.arange(n)] += own[r.index]
        settings.append(Settings(r.index, np.clip(values, lower, upper), states))
    rs, aa, bb = [], [], []
    for r, raw in zip(forward.design.runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw) * r.before(horizon)
        base = white[0]
        slopes = (white[1:] - base).T / np.concatenate([signed, own[r.index]])
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        rs.append(base if np.all(np.isfinite(base)) else np.full_like(base, np.inf))
        aa.append(slopes[:, :s])
        bb.append(slopes[:, s:])
    return Linearised(tuple(rs), tuple(aa), tuple(bb))


def linearised_centrally(forward: Forward, noise: Noise, at: Estimate, steps: Steps) -> Linearised:
    """Return residuals of whole runs and their slopes by central differences, as far as bounds let them.

    Where unknowns and states act much alike, what is left of a slope is less than the error of a one-sided quotient.
    """
    shared, own = steps
    lower, upper = _bounds(forward)
    s = len(shared)
    settings, widths = [], []
    for r in forward.design.runs:
        n = r.count
        values = np.repeat(at.values[None], 1 + 2 * (s + n), axis=0)
        states = np.repeat(at.states[r.index][None], 1 + 2 * (s + n), axis=0)
        for side, first in ((1.0, 1), (-1.0, 1 + s + n)):
            values[first + np.arange(s), np.arange(s)] += side * shared
            states[first + s + np.arange(n), np.arange(n)] += side * own[r.index]
        values = np.clip(values, lower, upper)
        settings.append(Settings(r.index, values, states))
        reached = [np.abs(values[f + np.arange(s), np.arange(s)] - at.values) for f in (1, 1 + s + n)]
        widths.append([np.concatenate([way, own[r.index]]) for way in reached])
    rs, aa, bb = [], [], []
    for r, width, raw in zip(forward.design.runs, widths, forward.residuals(settings), strict=True):
        white = noise.whiten(r.index, raw)
        n = len(width[0])
        sides = white[1 : 1 + n], white[1 + n :]
        whole = [np.all(np.isfinite(side), axis=1) for side in sides]  # else a quotient to one side has to do
        forth, back = (np.where(ok[:, None], side, white[0]) for ok, side in zip(whole, sides, strict=True))
        both = sum(np.where(ok, w, 0.0) for ok, w in zip(whole, width, strict=True))
        slopes = (forth - back).T / np.maximum(both, 1e-300)
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        rs.append(white[0])
        aa.append(slopes[:, :s])
        bb.append(slopes[:, s:])
    return Linearised(tuple(rs), tuple(aa), tuple(bb))


def linearised_shared(
    forward: Forward, noise: Noise, at: Estimate, known: tuple[Array, ...], shared: Array
) -> Linearised:
    """Return the same by shared unknowns alone; slopes by the states are the `known` ones."""
    lower, upper = _bounds(forward)
    s = len(shared)
    signed = np.where(at.values + shared > upper, -shared, shared)
    settings = []
    for r in forward.design.runs:
        values = np.repeat(at.values[None], 1 + s, axis=0)
        values[1 + np.arange(s), np.arange(s)] += signed
        states = np.repeat(at.states[r.index][None], 1 + s, axis=0)
        settings.append(Settings(r.index, np.clip(values, lower, upper), states))
    rs, aa = [], []
    for r, raw in zip(forward.design.runs, forward.residuals(settings), strict=True):
        white = noise.whiten(r.index, raw)
        slopes = (white[1:] - white[0]).T / signed
        rs.append(white[0])
        aa.append(np.where(np.isfinite(slopes), slopes, 0.0))
    return Linearised(tuple(rs), tuple(aa), known)


def counts(forward: Forward, horizon: float) -> Array:
    """Return measurements (R,) of each run before a horizon, at least 1."""
    return np.array([max(int(np.count_nonzero(r.before(horizon))), 1) for r in forward.design.runs])


def run_costs(forward: Forward, noise: Noise, at: Estimate, horizon: float) -> Array:
    """Return chi2 (R,) of each run before a horizon, infinite where its rollout diverges."""
    first: Array = trial_costs(forward, noise, [at], horizon)[0]
    return first


def _bounds(forward: Forward) -> tuple[Array, Array]:
    return np.array([u.lower for u in forward.unknowns]), np.array([u.upper for u in forward.unknowns])


def _costs(forward: Forward, noise: Noise, trials: Sequence[Estimate], horizon: float, hold: Hold) -> Array:
    holds = np.array([hold.cost(t.values) for t in trials])
    total: Array = trial_costs(forward, noise, trials, horizon).sum(axis=1) + holds
    return total


def _with_states_after(
    forward: Forward,
    noise: Noise,
    trials: Sequence[Estimate],
    costs: Array,
    linear: Linearised,
    horizon: float,
    hold: Hold,
) -> tuple[list[Estimate], Array]:
    """Return trials with initial states fitted once more at their shared unknowns, where that lessens their costs (K,).

    Where shared unknowns and states pull together along a bent valley, such as a forcing's phase and the speed at the
    start, straight steps of both leave it, however right the shared ones are; so they would have to be small
    (variable projection: Golub & Pereyra 1973, SIAM J. Numer. Anal. 10, 413, with the slopes kept: Kaufman 1975).
    """
    settings = [
        Settings(r.index, np.array([t.values for t in trials]), np.array([t.states[r.index] for t in trials]))
        for r in forward.design.runs
    ]
    states: list[list[Array]] = [list(t.states) for t in trials]
    for r, raw in zip(forward.design.runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw) * r.before(horizon)
        slopes = linear.b[r.index]
        change = (
            np.where(np.isfinite(white), white, 0.0) @ slopes @ damped_inverse(slopes.T @ slopes, r.typical, 1e-9, HELD)
        )
        for k in range(len(trials)):
            states[k][r.index] = states[k][r.index] - within_reach(change[k], r.typical)
    after = [Estimate(t.values, tuple(own)) for t, own in zip(trials, states, strict=True)]
    again = _costs(forward, noise, after, horizon, hold)
    better = again < costs
    return [a if b else t for a, b, t in zip(after, better, trials, strict=True)], np.where(better, again, costs)


def trial_costs(forward: Forward, noise: Noise, trials: Sequence[Estimate], horizon: float) -> Array:
    """Return chi2 (K, R) of each run before a horizon at K estimates, infinite where its rollout diverges."""
    settings = [
        Settings(r.index, np.array([t.values for t in trials]), np.array([t.states[r.index] for t in trials]))
        for r in forward.design.runs
    ]
    costs = np.empty((len(trials), len(forward.design.runs)))
    for r, raw in zip(forward.design.runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw) * r.before(horizon)
        costs[:, r.index] = np.where(np.all(np.isfinite(white), axis=1), (white**2).sum(axis=1), np.inf)
    return costs


def _step(forward: Forward, normal: NormalEquations, at: Estimate, damping: float) -> Estimate:
    """Return the damped Gauss-Newton step; shared unknowns at a bound that the step would leave do not take part."""
    lower, upper = _bounds(forward)
    inverse, matrix, vector = normal.reduced(damping, HELD)
    free = np.ones(len(vector), dtype=bool)
    step = np.zeros(len(vector))
    for _ in range(len(vector) + 1):
        step = np.zeros(len(vector))
        step[free] = -_solve(matrix[np.ix_(free, free)], vector[free], normal.shared[free], damping)
        out = free & (((at.values <= lower) & (step < 0)) | ((at.values >= upper) & (step > 0)))
        if not out.any():
            break
        free &= ~out
    values = np.clip(at.values + step, lower, upper)
    step = values - at.values
    return Estimate(values, normal.carried(at.states, inverse, step))


def _solve(matrix: Array, vector: Array, typical: Array, damping: float) -> Array:
    if not len(vector):
        return vector
    result: Array = damped_inverse(matrix, typical, damping) @ vector
    return result


def covariances(forward: Forward, linear: Linearised) -> tuple[Array, tuple[Array, ...]]:
    """Return the covariance (S, S) of the shared unknowns, and standard deviations (N,) of each run's states for fixed
    ones."""
    normal = NormalEquations(forward, linear)
    inverse, matrix, _ = normal.reduced(1e-12, PRIOR)
    errors = np.sqrt(np.maximum(np.diagonal(inverse, axis1=-2, axis2=-1), 0.0))
    covariance = damped_inverse(matrix, normal.shared, 1e-12) if len(matrix) else matrix
    return covariance, tuple(errors[i, :n] for i, n in enumerate(normal.counts))


def standard_steps(forward: Forward, linear: Linearised) -> Steps:
    """Return steps of difference quotients that are a fraction of standard errors."""
    covariance, own = covariances(forward, linear)
    typical = np.array([u.typical for u in forward.unknowns])
    shortest, longest = (max(bound, least_step(forward.world)) for bound in STEPS)
    shared = np.clip(STEP * np.sqrt(np.maximum(np.diag(covariance), 0.0)), shortest * typical, longest * typical)
    return shared, tuple(
        np.clip(STEP * o, shortest * r.typical, longest * r.typical)
        for o, r in zip(own, forward.design.runs, strict=True)
    )
