"""Intervals of fitted unknowns: from the curvature, put right where the misfit does not grow as a parabola."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from polyworld.discrepancy.forward import Settings
from polyworld.discrepancy.trial import Bench, Trial

Array = NDArray[np.float64]

LEVEL = float(norm.isf(0.025))  # standard deviations of a two-sided 95% interval
ROUNDS = 3
FOLLOWED = 3  # steps of all else after an unknown that was moved
STRETCH = (0.8, 3.0)  # of the parabola's half width, beyond which a correction is not believed


def intervals95(bench: Bench, trial: Trial) -> Array:
    """95% intervals (S, 2) of the shared unknowns, within their bounds.

    Profile likelihood (Venzon & Moolgavkar 1988, Applied Statistics 37, 87): each unknown is moved, the other unknowns
    and the initial states follow, in steps of Gauss and Newton with the slopes at the fit, and the ends lie where chi2
    has grown by the square of 1.96. Infinite where the data say nothing.
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
        grown = _profiled(bench, trial, moved, index) - trial.chi2
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


def _profiled(bench: Bench, trial: Trial, moved: Array, index: NDArray[np.int64]) -> Array:
    """chi2 (K,) where the unknown index[k] has the value moved[k, index[k]], and all else follows."""
    lower = np.array([u.lower for u in trial.hypothesis.unknowns])
    upper = np.array([u.upper for u in trial.hypothesis.unknowns])
    ground, slopes = trial.ground, trial.fit.linear.a
    values = moved
    states = [
        s + (values - trial.values) @ (answer @ a).T
        for s, answer, a in zip(trial.fit.states, ground.answers, slopes, strict=True)
    ]
    least, residuals = _whitened(bench, trial, values, states)
    information = sum((a.T @ a for a in ground.slopes), np.zeros((values.shape[1],) * 2))
    for _ in range(FOLLOWED):
        gradient = sum((r @ a for r, a in zip(residuals, ground.slopes, strict=True)), np.zeros_like(values))
        step = np.zeros_like(values)
        for k, fixed in enumerate(index):
            others = np.arange(values.shape[1]) != fixed
            inverse = np.linalg.pinv(information[np.ix_(others, others)], rcond=1e-10, hermitian=True)
            step[k, others] = -inverse @ gradient[k, others]
        to = np.clip(values + step, lower, upper)
        there = [
            s + (r + (to - values) @ a.T) @ answer.T
            for s, r, a, answer in zip(states, residuals, slopes, ground.answers, strict=True)
        ]
        chi2, found = _whitened(bench, trial, to, there)
        better = chi2 < least
        least = np.where(better, chi2, least)
        values = np.where(better[:, None], to, values)
        states = [np.where(better[:, None], new, old) for new, old in zip(there, states, strict=True)]
        residuals = [np.where(better[:, None], new, old) for new, old in zip(found, residuals, strict=True)]
        if not better.any():
            break
    return least


def _whitened(bench: Bench, trial: Trial, values: Array, states: Sequence[Array]) -> tuple[Array, list[Array]]:
    """chi2 (K,), infinite where a rollout diverges, and whitened residuals[run] (K, m), there 0."""
    settings = [Settings(r.index, values, states[r.index]) for r in bench.design.runs]
    total = np.zeros(len(values))
    found = []
    for r, raw in zip(bench.design.runs, bench.forward(trial.hypothesis).residuals(settings), strict=True):
        white = bench.noise.whiten(r.index, raw)
        sound = np.all(np.isfinite(white), axis=1)
        found.append(np.where(sound[:, None], white, 0.0))
        total += np.where(sound, (found[-1] ** 2).sum(axis=1), np.inf)
    return total, found
