"""The score test: predict the gain of each effect from the slope of the trajectories where it does nothing yet.

Rao 1948 (Proc. Camb. Phil. Soc. 44, 50): derivatives of the residuals by an effect's unknowns, projected off all that
is fitted already, against the residuals. It needs one batch of rollouts for each way to add an effect, all of its
starts (places, frequencies) in it, and predicts both chi2 and the unknowns of a fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.descent import FIRST_STEP, least_step
from polyworld.estimation.fit_context import FitContext, FittedHypothesis, NuisanceProjection
from polyworld.estimation.forward import Settings
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.normal_equations import PRIOR, within_reach
from polyworld.estimation.unknown import Unknown

Array = NDArray[np.float64]

MOST_WORLDS = 768  # rolled out in one batch: beyond this memory counts and speed gains nothing


@dataclass(frozen=True)
class ScoreTestStart:
    """Start of the fit of a hypothesis: shared values (S,), and the chi2 that the slope predicts there.

    before (S,): the same with the effect still off, as its start has it. states[run] (N,): the initial states that go
    with the values. None where they are not known.
    """

    hypothesis: Hypothesis
    values: Array
    chi2: float
    before: Array | None = None
    states: tuple[Array, ...] | None = None


def score_test_starts(
    context: FitContext, trial: FittedHypothesis, hypotheses: Sequence[Hypothesis], keep: int, horizon: float = 1.0
) -> list[ScoreTestStart]:
    """Return `keep` starts of each hypothesis that adds one effect to a fitted one, largest predicted gain first.

    horizon: part of each run's time that the trial was fitted to. Effects with a score test of their own are judged by
    whole runs, and left out of shorter ones.
    """
    nuisance = trial.nuisance
    found: list[ScoreTestStart] = []
    special: dict[str, list[Hypothesis]] = {}
    for hypothesis in hypotheses:
        candidate = hypothesis.parts[-1].candidate
        if candidate.score_test is not None:
            special.setdefault(candidate.name, []).append(hypothesis)
            continue
        tried = _with_further_starts(context, trial, hypothesis) if horizon >= 1.0 else hypothesis
        own = [replace(tested, hypothesis=hypothesis) for tested in _of_one(context, trial, tried, nuisance, horizon)]
        found += sorted(own, key=lambda tested: tested.chi2)[:keep]
    for group in special.values() if horizon >= 1.0 else ():
        by_itself = group[0].parts[-1].candidate.score_test
        found += by_itself(context, trial, group, keep) if by_itself is not None else []
    return sorted(found, key=lambda tested: tested.chi2)


def _with_further_starts(context: FitContext, trial: FittedHypothesis, hypothesis: Hypothesis) -> Hypothesis:
    """Add starts of a hypothesis' last effect that are estimated from residuals."""
    part = hypothesis.parts[-1]
    if part.candidate.further is None:
        return hypothesis
    first = part.variant.starts[0]
    more = tuple({**first, **start} for start in part.candidate.further(context, trial, part.variant))
    variant = replace(part.variant, starts=(*part.variant.starts, *more))
    return replace(hypothesis, parts=(*hypothesis.parts[:-1], replace(part, variant=variant)))


def _of_one(
    context: FitContext, trial: FittedHypothesis, hypothesis: Hypothesis, nuisance: NuisanceProjection, horizon: float
) -> list[ScoreTestStart]:
    own = hypothesis.parts[-1].variant
    starts = np.array(hypothesis.starts(trial.values))
    per_start = len(context.design.runs) * (1 + len(own.unknowns) - len(own.idle))
    found: list[ScoreTestStart] = []
    size = max(1, MOST_WORLDS // per_start)
    for first in range(0, len(starts), size):
        found += _of_starts(context, trial, hypothesis, nuisance, starts[first : first + size], horizon)
    return found


def _of_starts(
    context: FitContext,
    trial: FittedHypothesis,
    hypothesis: Hypothesis,
    nuisance: NuisanceProjection,
    starts: Array,
    horizon: float,
) -> list[ScoreTestStart]:
    variant = hypothesis.parts[-1].variant
    own = tuple(u for u in variant.unknowns if u.name not in variant.idle)
    j, k, s = len(starts), len(own), len(trial.values)
    at = s + np.array([i for i, u in enumerate(variant.unknowns) if u.name not in variant.idle])
    first = max(FIRST_STEP, least_step(hypothesis.world))
    steps = np.array([first * u.typical for u in own])
    upper = np.array([u.upper for u in own])
    signed = np.where(starts[:, at] + steps > upper, -steps, steps)
    changed = np.repeat(starts[:, None], k, axis=1)
    changed[:, np.arange(k), at] += signed
    plain = starts[:1] if variant.idle else starts
    values = np.concatenate([plain, changed.reshape(j * k, -1)])
    settings = [
        Settings(r.index, values, np.repeat(trial.fit.states[r.index][None], len(values), axis=0))
        for r in context.design.runs
    ]
    square = np.zeros(j)
    ga, gc = np.zeros((j, s)), np.zeros((j, k))
    cc, ac = np.zeros((j, k, k)), np.zeros((j, s, k))
    answers = []
    for r, raw in zip(context.design.runs, context.forward(hypothesis).residuals(settings, horizon), strict=True):
        white = context.noise.whiten(r.index, raw) * r.before(horizon)
        base = np.broadcast_to(white[: len(plain)], (j, white.shape[1]))
        slopes = (white[len(plain) :].reshape(j, k, -1) - base[:, None]) / signed[:, :, None]
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        answer = nuisance.answers[r.index]
        answers.append((base @ answer.T, slopes @ answer.T, trial.fit.linear.a[r.index].T @ answer.T))
        slopes = nuisance.off(r.index, slopes)
        rest = nuisance.off(r.index, base)
        a = nuisance.slopes[r.index]
        square += (rest**2).sum(axis=1)
        ga += rest @ a
        gc += np.einsum("jkm,jm->jk", slopes, rest)
        cc += np.einsum("jkm,jlm->jkl", slopes, slopes)
        ac += np.einsum("ms,jkm->jsk", a, slopes)
    least = np.array([u.lower for u in hypothesis.unknowns[:s]])
    most = np.array([u.upper for u in hypothesis.unknowns[:s]])
    found = []
    for i in range(j):
        if not np.isfinite(square[i]):
            continue
        matrix = cc[i] - ac[i].T @ nuisance.inverse @ ac[i]
        gradient = gc[i] - ac[i].T @ nuisance.inverse @ ga[i]
        ground_level = square[i] - ga[i] @ nuisance.inverse @ ga[i]
        step = bounded_step(matrix, gradient, own, starts[i, at])
        chi2 = ground_level + 2.0 * gradient @ step + step @ matrix @ step
        begin = starts[i].copy()
        begin[at] += step
        shared = -nuisance.inverse @ (ga[i] + ac[i] @ step)
        begin[:s] = np.clip(begin[:s] + shared, least, most)  # the slope may predict more than there can be
        states = tuple(
            own_states + within_reach(still[i] + step @ moved[i] + shared @ carried, run.typical)
            for run, own_states, (still, moved, carried) in zip(
                context.design.runs, trial.fit.states, answers, strict=True
            )
        )
        found.append(ScoreTestStart(hypothesis, begin, float(chi2), starts[i], states))
    return found


def bounded_step(matrix: Array, gradient: Array, unknowns: Sequence[Unknown], at: Array) -> Array:
    """Return the step (K,) from `at` that minimises 2 gradient^T s + s^T matrix s within the unknowns' bounds."""
    typical = np.array([u.typical for u in unknowns])
    room = [np.array([getattr(u, side) for u in unknowns]) - at for side in ("lower", "upper")]
    damped = matrix + np.diag((PRIOR / typical) ** 2)
    step = np.zeros(len(typical))
    free = np.ones(len(typical), dtype=bool)
    for _ in range(len(typical)):
        step[free] = -np.linalg.solve(
            damped[np.ix_(free, free)], gradient[free] + damped[np.ix_(free, ~free)] @ step[~free]
        )
        out = free & ((step < room[0]) | (step > room[1]))
        if not out.any():
            break
        step[out] = np.clip(step[out], room[0][out], room[1][out])
        free &= ~out
        if not free.any():
            break
    return step
