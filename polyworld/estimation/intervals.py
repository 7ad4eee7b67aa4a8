"""Intervals of fitted unknowns: from the curvature, put right where the misfit does not grow as a parabola."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from polyworld.estimation import profile
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.normal_equations import within_reach

Array = NDArray[np.float64]

LEVEL = float(-ndtri(0.025))  # standard deviations of a two-sided 95% interval
ROUNDS = 3
FOLLOWED = 3  # steps of all else after an unknown that was moved
STRETCH = (0.8, 3.0)  # of the parabola's half width, beyond which a correction is not believed
FLAT = 0.5  # of the growth expected at twice the distance, below which a side is looked at farther out
FIRST = 0.1  # of a typical change, at which one begins where the fit gives no width
DOUBLED = 40  # times a distance is doubled at most


def intervals95(context: FitContext, trial: FittedHypothesis) -> Array:
    """Return 95% intervals (S, 2) of the shared unknowns, within their bounds.

    Profile likelihood (Venzon & Moolgavkar 1988, Applied Statistics 37, 87): each unknown is moved, the other unknowns
    and the initial states follow, in steps of Gauss and Newton with the slopes at the fit, and the ends lie where chi2
    has grown by the square of 1.96. The bound where the data say nothing, or nothing on one side.
    """
    unknowns = trial.hypothesis.unknowns
    count = len(unknowns)
    if not count:
        return np.zeros((0, 2))
    trial = replace(trial, fit=profile.with_central_slopes(context.forward(trial.hypothesis), context.noise, trial.fit))
    covariance = trial.fit.covariance
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    direction = covariance / np.maximum(sd, 1e-300)  # column i: what all unknowns do per standard deviation of i
    lower = np.array([u.lower for u in unknowns])
    upper = np.array([u.upper for u in unknowns])
    index = np.tile(np.arange(count), 2)
    side = np.repeat([-1.0, 1.0], count)
    reach = np.full(2 * count, LEVEL)
    known = np.array([s < b - a for s, a, b in zip(sd, lower, upper, strict=True)])
    for _ in range(ROUNDS):
        moved = trial.values + (side * reach)[:, None] * direction[:, index].T
        moved = np.clip(moved, lower, upper)
        grown = _profiled(context, trial, moved, index) - trial.chi2
        stretch = LEVEL / np.sqrt(np.maximum(grown, 1e-12))
        wanted = reach * np.clip(stretch, 0.5, 2.0)
        sound = np.isfinite(grown) & known[index]
        reach = np.where(sound, np.clip(wanted, STRETCH[0] * LEVEL, STRETCH[1] * LEVEL), reach)
        if np.all(np.abs(stretch[sound] - 1.0) < 0.03):
            break
    ends = trial.values[index] + side * reach * sd[index]
    moved = np.clip(trial.values + (2.0 * side * reach)[:, None] * direction[:, index].T, lower, upper)
    twice = moved[np.arange(2 * count), index]
    grown = _profiled(context, trial, moved, index) - trial.chi2
    typical = np.array([u.typical for u in unknowns])[index]
    ends = np.where(known[index], ends, trial.values[index] + FIRST * side * typical)
    far = np.abs(twice - trial.values[index]) / np.maximum(sd[index], 1e-300)  # the bounds may be nearer than twice
    flat = grown < FLAT * np.maximum(far, LEVEL) ** 2
    for k in np.flatnonzero(flat | ~known[index]):
        ends[k] = _far_end(context, trial, int(index[k]), float(ends[k]))
    result = np.stack([ends[:count], ends[count:]], axis=1)
    clipped: Array = np.clip(result, lower[:, None], upper[:, None])
    return clipped


def _far_end(context: FitContext, trial: FittedHypothesis, index: int, end: float) -> float:
    """Return where chi2 has grown by the square of 1.96 on a side on which it grows less and less: a grip that is
    enough to stop all sliding says nothing of a greater one. All else is fitted again at doubled distances, so that the
    end may lie up to twice as far as it should; the bound where none will do, and the end as it was where the first one
    does."""
    unknown = trial.hypothesis.unknowns[index]
    far, states = end, trial.fit.states
    for _ in range(DOUBLED):
        farther = trial.values[index] + 2.0 * (far - trial.values[index])
        if not unknown.lower < farther < unknown.upper:
            return unknown.upper if farther > trial.values[index] else unknown.lower
        there = tuple(
            replace(u, lower=farther, upper=farther) if i == index else u
            for i, u in enumerate(trial.hypothesis.unknowns)
        )
        values = trial.values.copy()
        values[index] = farther
        forward = Forward(context.design, trial.hypothesis.world, there, context.cancelled)
        fit = profile.fit(forward, context.noise, values, states, iterations=FOLLOWED)
        context.forward(trial.hypothesis).rollouts += fit.rollouts
        if not fit.chi2 < trial.chi2 + LEVEL**2:
            return far if far == end else farther
        far, states = farther, fit.states
    return far


@dataclass(frozen=True)
class _Followed:
    """Shared values (K, S) and initial states[run] (K, N) after one unknown was moved.

    What is left: chi2 (K,), infinite where a rollout diverges, and whitened residuals[run] (K, m), there 0.
    """

    values: Array
    states: Sequence[Array]
    chi2: Array
    residuals: Sequence[Array]

    def or_better(self, other: _Followed) -> _Followed:
        """Return the better of both, one by one."""
        better = other.chi2 < self.chi2

        def merged(new: Array, old: Array) -> Array:
            chosen: Array = np.where(better[:, None], new, old)
            return chosen

        return _Followed(
            merged(other.values, self.values),
            [merged(new, old) for new, old in zip(other.states, self.states, strict=True)],
            np.where(better, other.chi2, self.chi2),
            [merged(new, old) for new, old in zip(other.residuals, self.residuals, strict=True)],
        )


def _profiled(context: FitContext, trial: FittedHypothesis, moved: Array, index: NDArray[np.int64]) -> Array:
    """Return chi2 (K,) where the unknown index[k] has the value moved[k, index[k]], and all else follows."""
    lower = np.array([u.lower for u in trial.hypothesis.unknowns])
    upper = np.array([u.upper for u in trial.hypothesis.unknowns])
    ground, slopes = trial.nuisance, trial.fit.linear.a
    count = len(moved)
    states = [
        s + within_reach((moved - trial.values) @ (answer @ a).T, own.typical)
        for own, s, answer, a in zip(context.design.runs, trial.fit.states, ground.answers, slopes, strict=True)
    ]
    # Beyond a kink, as where a grip suffices, all else stays as it is rather than following the slopes.
    alone = np.repeat(trial.values[None], count, axis=0)
    alone[np.arange(count), index] = moved[np.arange(count), index]
    as_they_are = [np.repeat(s[None], count, axis=0) for s in trial.fit.states]
    at = _followed(context, trial, moved, states).or_better(_followed(context, trial, alone, as_they_are))
    information = sum((a.T @ a for a in ground.slopes), np.zeros((moved.shape[1],) * 2))
    for _ in range(FOLLOWED):
        gradient = sum((r @ a for r, a in zip(at.residuals, ground.slopes, strict=True)), np.zeros_like(moved))
        step = np.zeros_like(moved)
        for k, fixed in enumerate(index):
            others = np.arange(moved.shape[1]) != fixed
            inverse = np.linalg.pinv(information[np.ix_(others, others)], rcond=1e-10, hermitian=True)
            step[k, others] = -inverse @ gradient[k, others]
        to = np.clip(at.values + step, lower, upper)
        there = [
            s + within_reach((r + (to - at.values) @ a.T) @ answer.T, own.typical)
            for own, s, r, a, answer in zip(
                context.design.runs, at.states, at.residuals, slopes, ground.answers, strict=True
            )
        ]
        onward = at.or_better(_followed(context, trial, to, there))
        if not (onward.chi2 < at.chi2).any():
            break
        at = onward
    return at.chi2


def _followed(context: FitContext, trial: FittedHypothesis, values: Array, states: Sequence[Array]) -> _Followed:
    settings = [Settings(r.index, values, states[r.index]) for r in context.design.runs]
    total = np.zeros(len(values))
    found = []
    for r, raw in zip(context.design.runs, context.forward(trial.hypothesis).residuals(settings), strict=True):
        white = context.noise.whiten(r.index, raw)
        sound = np.all(np.isfinite(white), axis=1)
        found.append(np.where(sound[:, None], white, 0.0))
        total += np.where(sound, (found[-1] ** 2).sum(axis=1), np.inf)
    return _Followed(values, states, total, found)
