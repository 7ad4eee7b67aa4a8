"""Levenberg-Marquardt run by run, where nothing is shared: each takes its own steps, and none waits for another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.descent import STUCK, TRIALS, Estimate, Steps, linearised, standard_steps, trial_costs
from polyworld.estimation.forward import Forward
from polyworld.estimation.noise import Noise
from polyworld.estimation.normal_equations import Linearised, NormalEquations

Array = NDArray[np.float64]

FIRST, LEAST, MOST = 1e-4, 1e-8, 1e8  # dampings
BEYOND = 1e4  # times that damping which bettered nothing, tried next
ATTEMPTS = 2  # at dampings, before a run is left where it is


def descend_per_run(
    forward: Forward, noise: Noise, at: Estimate, horizon: float, steps: Steps, iterations: int, tolerance: float
) -> tuple[Estimate, Steps, int, bool]:
    """Descend from the initial states of runs, at fixed shared values: return where that ends, steps for difference
    quotients there, iterations used, and whether all runs have converged.

    tolerance: of a run's chi2, below whose fall it is at rest.
    """
    if not any(len(s) for s in at.states):
        return at, steps, 0, True  # nothing to fit
    runs = len(at.states)
    damping, resting, failed = np.full(runs, FIRST), np.zeros(runs, dtype=bool), np.zeros(runs, dtype=bool)
    for iteration in range(iterations):
        linear = linearised(forward, noise, at, horizon, steps)
        chi2 = np.array([float(r @ r) for r in linear.r])
        diverged = ~np.isfinite(chi2)
        failed, resting = failed | diverged, resting | diverged
        if resting.all():
            return at, steps, iteration, not failed.any()
        steps = standard_steps(forward, linear)
        normal = NormalEquations(forward, linear)
        moved = resting.copy()
        for attempt in range(ATTEMPTS):
            dampings = damping * (BEYOND**attempt * TRIALS)[:, None]
            options = [Estimate(at.values, normal.stepped(at.states, d[:, None])) for d in dampings]
            costs = trial_costs(forward, noise, options, horizon)
            best = np.argmin(costs, axis=0)
            least = costs[best, np.arange(runs)]
            better = (least < chi2) & ~moved
            if attempt == 0:
                predicted = _predicted_fall(linear, at, options[0])
            states = tuple(options[best[k]].states[k] if better[k] else s for k, s in enumerate(at.states))
            at = Estimate(at.values, states)
            fallen = np.subtract(chi2, least, out=np.zeros(runs), where=better)
            resting = resting | (better & (fallen < tolerance + 1e-6 * chi2))
            damping = np.where(better, np.clip(dampings[best, np.arange(runs)], LEAST, MOST), damping)
            moved = moved | better
            if moved.all():
                break
        stuck = ~moved
        failed = failed | (stuck & (predicted >= np.maximum(tolerance, STUCK * chi2)))
        resting = resting | stuck
        if resting.all():
            return at, steps, iteration + 1, not failed.any()
    return at, steps, iterations, False


def _predicted_fall(linear: Linearised, at: Estimate, to: Estimate) -> Array:
    """Return the fall of chi2 (R,) that the slopes predict for a step, 0 of a run whose rollout diverges."""
    falls = []
    for r, b, new, old in zip(linear.r, linear.b, to.states, at.states, strict=True):
        if not np.all(np.isfinite(r)):
            falls.append(0.0)
            continue
        after = r + b @ (new - old)
        falls.append(float(r @ r) - float(after @ after))
    return np.array(falls)
