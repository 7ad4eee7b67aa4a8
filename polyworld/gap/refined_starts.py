"""Refine where fits of an effect with a place or a rhythm begin, by the score test alone.

chi2 depends on these in no simple way, and fits from a coarse grid of starts end at wrong minima. The strength is
eliminated by the score test, one batch of rollouts for all places: new ones are tried around the best, ever nearer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.score_test import ScoreTestStart, score_test_starts
from polyworld.gap.settings import ZoomSettings

Array = NDArray[np.float64]

SEED = 1822  # of the directions, the same for all


def closer(
    context: FitContext,
    ground: FittedHypothesis,
    hypothesis: Hypothesis,
    found: Sequence[ScoreTestStart],
    settings: ZoomSettings | None = None,
) -> list[ScoreTestStart]:
    """Refine starts of a hypothesis that adds an effect with a place to `ground`; the best few."""
    settings = settings or ZoomSettings()
    part = hypothesis.parts[-1]
    variant = part.variant
    count = len(variant.unknowns)
    placed = [u for u in variant.unknowns if u.name in variant.idle]
    at = [i - count for i, u in enumerate(variant.unknowns) if u.name in variant.idle]
    typical = np.array([u.typical for u in placed])
    lower, upper = np.array([u.lower for u in placed]), np.array([u.upper for u in placed])
    directions = np.concatenate(
        [np.zeros((1, len(at))), np.random.default_rng(SEED).normal(size=(settings.around, len(at)))]
    )
    best = _distinct(found, at, typical, settings)
    for level in range(settings.levels):
        starts = []
        for tested in best:
            before = tested.values if tested.before is None else tested.before
            fixed = dict(zip([u.name for u in variant.unknowns], before[-count:], strict=True))
            for direction in directions:
                place = np.clip(before[at] + settings.width * 0.5**level * direction * typical, lower, upper)
                starts.append(fixed | dict(zip([u.name for u in placed], place.tolist(), strict=True)))
        around = replace(part, variant=replace(variant, starts=tuple(starts)))
        moved = replace(hypothesis, parts=(*hypothesis.parts[:-1], around))
        best = _distinct([*best, *score_test_starts(context, ground, [moved], len(starts))], at, typical, settings)
    return [replace(tested, hypothesis=hypothesis) for tested in best]


def _distinct(
    found: Sequence[ScoreTestStart], at: list[int], typical: Array, settings: ZoomSettings
) -> list[ScoreTestStart]:
    """Choose the best few starts, best first, that are not all at one place."""
    kept: list[ScoreTestStart] = []
    for tested in sorted(found, key=lambda x: x.chi2):
        if all(float(np.max(np.abs(_place(tested, at) - _place(k, at)) / typical)) > settings.separation for k in kept):
            kept.append(tested)
        if len(kept) == settings.kept:
            break
    return kept


def _place(tested: ScoreTestStart, at: list[int]) -> Array:
    place: Array = (tested.values if tested.before is None else tested.before)[at]
    return place
