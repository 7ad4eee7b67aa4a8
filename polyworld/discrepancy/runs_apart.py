"""Levenberg-Marquardt where runs share no unknown: each has a damping of its own, so that none holds up the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.discrepancy.descent import TRIALS, Point, Steps, changes_of_states, linearised, standard_steps
from polyworld.discrepancy.forward import Forward, Settings
from polyworld.discrepancy.noise import Noise

Array = NDArray[np.float64]

WEAKEST, FIRST, STRONGEST = 1e-8, 1e-4, 1e8  # dampings
STIFFER = 1e4  # times stronger is the damping of a run that no step betters
CLOSE = 1e-6  # of chi2: a smaller gain is none


def descend_apart(
    forward: Forward, noise: Noise, at: Point, horizon: float, steps: Steps, iterations: int, tolerance: float
) -> tuple[Point, Steps, int, bool]:
    """As `descent.descend`, for initial states alone; `tolerance` is shared among the runs."""
    runs = forward.design.runs
    damping = np.full(len(runs), FIRST)
    done = np.array([r.count == 0 for r in runs])
    for iteration in range(iterations):
        if done.all():
            return at, steps, iteration, True
        linear = linearised(forward, noise, at, horizon, steps)
        cost = np.array([float(r @ r) for r in linear.r])
        done |= ~np.isfinite(cost)
        steps = standard_steps(forward, linear)
        tried = [changes_of_states(forward, linear, damping * factor) for factor in TRIALS]
        options = [np.array([at.states[r.index] - t[r.index] for t in tried]) for r in runs]
        costs = _costs(forward, noise, at.values, options, horizon)
        best = np.argmin(costs, axis=1)
        least = costs[np.arange(len(runs)), best]
        better = (least < cost) & ~done
        states = [options[i][best[i]] if better[i] else at.states[i] for i in range(len(runs))]
        at = Point(at.values, tuple(states))
        gain = np.where(better, cost - least, 0.0)
        done |= better & (gain < tolerance / len(runs) + CLOSE * cost)
        done |= ~better & (damping * STIFFER > STRONGEST)
        damping = np.where(better, np.clip(damping * TRIALS[best], WEAKEST, STRONGEST), damping * STIFFER)
    return at, steps, iterations, bool(done.all())


def _costs(forward: Forward, noise: Noise, values: Array, options: list[Array], horizon: float) -> Array:
    """chi2 (R, K) of each run before a horizon at K initial states of its own, infinite where a rollout diverges."""
    settings = [
        Settings(r.index, np.repeat(values[None], len(options[r.index]), axis=0), options[r.index])
        for r in forward.design.runs
    ]
    costs = []
    for r, raw in zip(forward.design.runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw) * r.before(horizon)
        costs.append(np.where(np.all(np.isfinite(white), axis=1), (white**2).sum(axis=1), np.inf))
    return np.array(costs)
