"""Decide between hypotheses by the extended BIC: rank them, say which compete with the best, and price effects.

The score is `FittedHypothesis.ebic`: chi2 and the price of the effects, by the formula of
`estimation.criteria.extended_bic`; with model error admitted it is `stability.Contest.scores`. Lower is better. A
difference of 10 is "very strong", one up to 2 "not worth more than a bare mention" (Kass & Raftery 1995, J. Am. Stat.
Assoc. 90, 773); the margins are in `settings`. `contest` ranks by it, `search` drops effects by it, `search_loop` sets
an effect against none, and `decide` gives the verdict.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.criteria import extended_bic
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.score_test import ScoreTestStart

Array = NDArray[np.float64]


def ranked(trials: Iterable[FittedHypothesis]) -> list[FittedHypothesis]:
    """Return fits by their scores, best first; equal ones keep their order."""
    return sorted(trials, key=lambda t: t.ebic)


def ranked_by_title(trials: Iterable[FittedHypothesis]) -> list[FittedHypothesis]:
    """Return fits by their scores, best first; equal ones in alphabetical order."""
    return sorted(trials, key=lambda t: (t.ebic, t.hypothesis.title))


def behind(trial: FittedHypothesis, best: FittedHypothesis) -> float:
    """Return by how much the score of a fit exceeds that of another."""
    return trial.ebic - best.ebic


def competes(trial: FittedHypothesis, best: FittedHypothesis, margin: float) -> bool:
    """Return whether a fit is behind the best by no more than a margin, so that the evidence excludes neither."""
    return bool(within(trial.ebic, best.ebic, margin))


def within(scores: float | Array, best: float | Array, margin: float) -> NDArray[np.bool_]:
    """Return whether scores exceed others by no more than a margin, elementwise."""
    return np.less_equal(scores, best + margin)


def bic(chi2: float, unknowns: int, context: FitContext) -> float:
    """Return chi2 + k log n: the score of a law that was not chosen among candidates."""
    return extended_bic(chi2, unknowns, context.observations, 0, 1)


def predicted(tested: ScoreTestStart, context: FitContext) -> float:
    """Return the score that the score test predicts of a hypothesis."""
    hypothesis = tested.hypothesis
    return extended_bic(tested.chi2, hypothesis.extra, context.observations, len(hypothesis.parts), context.candidates)


def predicted_gain(parent: FittedHypothesis, tested: ScoreTestStart, context: FitContext) -> float:
    """Return the predicted fall of chi2 less the price of the hypothesis' unknowns; all have equally many effects."""
    return parent.chi2 - tested.chi2 - tested.hypothesis.extra * float(np.log(context.observations))


def required_gain(unknowns: int, observations: float, candidates: int, margin: float) -> float:
    """Return by how much an effect has to lower chi2 to lower the score by a margin."""
    return extended_bic(0.0, unknowns, observations, 1, candidates) + margin


def added_price(fewer: FittedHypothesis, more: FittedHypothesis) -> float:
    """Return what the further effects of a hypothesis cost: by how much they have to lower chi2."""
    return (more.ebic - more.chi2) - (fewer.ebic - fewer.chi2)
