"""Intervals of fitted unknowns: from the curvature, put right where the misfit does not grow as a parabola."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from polyworld.discrepancy.forward import Settings
from polyworld.discrepancy.trial import Bench, Trial

Array = NDArray[np.float64]

LEVEL = float(norm.isf(0.025))  # standard deviations of a two-sided 95% interval
ROUNDS = 3
STRETCH = (0.3, 3.0)  # of the parabola's half width, beyond which a correction is not believed


def intervals95(bench: Bench, trial: Trial) -> Array:
    """95% intervals (S, 2) of the shared unknowns, within their bounds.

    Profile likelihood along its own path (Venzon & Moolgavkar 1988, Applied Statistics 37, 87): each unknown is moved,
    the other unknowns and the initial states follow as the linearisation has it, and the ends lie where chi2 has grown
    by the square of 1.96. Infinite where the data say nothing.
    """
    unknowns = trial.hypothesis.unknowns
    count = len(unknowns)
    if not count:
        return np.zeros((0, 2))
    covariance = trial.fit.covariance
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    direction = covariance / np.maximum(sd, 1e-300)  # column i: what all unknowns do per standard deviation of i
    lower = np.array([u.lower for u in unknowns])
    upper = np.array([u.upper for u in unknowns])
    index = np.tile(np.arange(count), 2)
    side = np.repeat([-1.0, 1.0], count)
    reach = np.full(2 * count, LEVEL)
    known = np.array([s < 100.0 * (b - a) for s, a, b in zip(sd, lower, upper, strict=True)])
    for _ in range(ROUNDS):
        moved = trial.values + (side * reach)[:, None] * direction[:, index].T
        moved = np.clip(moved, lower, upper)
        grown = _chi2(bench, trial, moved) - trial.chi2
        stretch = LEVEL / np.sqrt(np.maximum(grown, 1e-12))
        wanted = reach * np.clip(stretch, 0.5, 2.0)
        sound = np.isfinite(grown) & (grown > 0.0) & known[index]
        reach = np.where(sound, np.clip(wanted, STRETCH[0] * LEVEL, STRETCH[1] * LEVEL), reach)
        if np.all(np.abs(stretch[sound] - 1.0) < 0.03):
            break
    ends = trial.values[index] + side * reach * sd[index]
    result = np.stack([ends[:count], ends[count:]], axis=1)
    result[~known] = np.array([-np.inf, np.inf])
    clipped: Array = np.clip(result, lower[:, None], upper[:, None])
    return clipped


def _chi2(bench: Bench, trial: Trial, values: Array) -> Array:
    linear = trial.fit.linear
    settings = []
    for r in bench.design.runs:
        a, b = linear.a[r.index], linear.b[r.index]
        response = -np.linalg.lstsq(b, a, rcond=1e-10)[0] if b.shape[1] else np.zeros((0, a.shape[1]))
        states = trial.fit.states[r.index] + (values - trial.values) @ response.T
        settings.append(Settings(r.index, values, states))
    total = np.zeros(len(values))
    for r, raw in zip(bench.design.runs, bench.forward(trial.hypothesis).residuals(settings), strict=True):
        white = bench.noise.whiten(r.index, raw)
        total += np.where(np.all(np.isfinite(white), axis=1), (white**2).sum(axis=1), np.inf)
    return total
