"""What the score test promises of further effects, and in which order they are to be tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.score_test import ScoreTestStart
from polyworld.estimation.trial import FittedHypothesis


@dataclass(frozen=True, eq=False)
class PredictedGain:
    """A lead on top of a parent, and its share of the best gain promised."""

    parent: FittedHypothesis
    lead: ScoreTestStart
    share: float


def promise(lead: ScoreTestStart, observations: float) -> float:
    """chi2 that a lead promises, its unknowns paid for as by BIC."""
    return lead.chi2 + lead.hypothesis.extra * float(np.log(observations))


def shares(
    found: Sequence[tuple[FittedHypothesis, ScoreTestStart]], level: float, observations: float
) -> list[PredictedGain]:
    """Leads with their share of the best gain on chi2 `level` that any of them promises."""
    gains = [level - promise(lead, observations) for _, lead in found]
    best = max(max(gains, default=0.0), 1e-9)
    return [PredictedGain(parent, lead, gain / best) for (parent, lead), gain in zip(found, gains, strict=True)]


def labels(hypothesis: Hypothesis) -> list[str]:
    """Its effects and their variants, in the order in which they were added."""
    return [f"{p.candidate.name}|{p.variant.label}" for p in hypothesis.parts]


def identity(hypothesis: Hypothesis) -> tuple[str, ...]:
    """What makes two hypotheses the same, in whatever order their effects were added."""
    return tuple(sorted(labels(hypothesis)))


def in_turn(promises: Sequence[PredictedGain]) -> list[PredictedGain]:
    """The best of every parent, then the second of every one, and so on: the best parent need not be half the truth."""
    found: dict[int, dict[tuple[str, ...], list[PredictedGain]]] = {}
    for p in promises:
        found.setdefault(id(p.parent), {}).setdefault(identity(p.lead.hypothesis), []).append(p)
    columns = [list(own.values()) for own in found.values()]
    rows = zip_longest(*columns, fillvalue=[])
    return [p for row in rows for same in row for p in same]


def first_of_each(promises: Sequence[PredictedGain], most: int, least: float) -> list[PredictedGain]:
    """The best lead of each hypothesis, at most so many, of those that promise at least a share of the best gain."""
    chosen: dict[tuple[str, ...], PredictedGain] = {}
    for p in promises:
        if p.share >= least:
            chosen.setdefault(identity(p.lead.hypothesis), p)
    return list(chosen.values())[:most]
