"""Closer and closer starts for an effect with a place or a rhythm, by the score test alone.

Where an effect is, chi2 depends on in no simple way, and fits from a coarse grid of starts end beside it. Its strength
is eliminated by the score test, one batch of rollouts for all places: good ones are looked round at, nearer each time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.score_test import ScoreTestStart, leads
from polyworld.estimation.trial import FitContext, FittedHypothesis

Array = NDArray[np.float64]

LEVELS = 3
KEPT = 4  # places that are looked round at
AROUND = 24  # new ones around each
WIDTH = 1.0  # of a typical change, in which the first ones lie; half of it at each level after that
APART = 0.1  # typical changes by which places differ
SEED = 1822  # of the directions, the same for all


def closer(
    bench: FitContext, ground: FittedHypothesis, hypothesis: Hypothesis, found: Sequence[ScoreTestStart]
) -> list[ScoreTestStart]:
    """The best of ever closer starts around some leads to a hypothesis that adds an effect with a place to `ground`."""
    part = hypothesis.parts[-1]
    variant = part.variant
    count = len(variant.unknowns)
    placed = [u for u in variant.unknowns if u.name in variant.idle]
    at = [i - count for i, u in enumerate(variant.unknowns) if u.name in variant.idle]
    typical = np.array([u.typical for u in placed])
    lower, upper = np.array([u.lower for u in placed]), np.array([u.upper for u in placed])
    ways = np.concatenate([np.zeros((1, len(at))), np.random.default_rng(SEED).normal(size=(AROUND, len(at)))])
    best = _apart(found, at, typical)
    for level in range(LEVELS):
        starts = []
        for lead in best:
            before = lead.values if lead.before is None else lead.before
            fixed = dict(zip([u.name for u in variant.unknowns], before[-count:], strict=True))
            for way in ways:
                place = np.clip(before[at] + WIDTH * 0.5**level * way * typical, lower, upper)
                starts.append(fixed | dict(zip([u.name for u in placed], place.tolist(), strict=True)))
        around = replace(part, variant=replace(variant, starts=tuple(starts)))
        moved = replace(hypothesis, parts=(*hypothesis.parts[:-1], around))
        best = _apart([*best, *leads(bench, ground, [moved], len(starts))], at, typical)
    return [replace(lead, hypothesis=hypothesis) for lead in best]


def _apart(found: Sequence[ScoreTestStart], at: list[int], typical: Array) -> list[ScoreTestStart]:
    """The best few of some leads, best first, that are not all at one place."""
    kept: list[ScoreTestStart] = []
    for lead in sorted(found, key=lambda x: x.chi2):
        if all(float(np.max(np.abs(_place(lead, at) - _place(k, at)) / typical)) > APART for k in kept):
            kept.append(lead)
        if len(kept) == KEPT:
            break
    return kept


def _place(lead: ScoreTestStart, at: list[int]) -> Array:
    place: Array = (lead.values if lead.before is None else lead.before)[at]
    return place
