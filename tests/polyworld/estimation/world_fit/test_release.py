"""Bodies alike get parameters of their own where their tracks, from closed formulas, ask for it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from polyworld.estimation.world_fit import (
    FitProblem,
    FitResult,
    OrdinarySettings,
    PrefixSettings,
    default_unknowns,
    fit_by_prefixes,
    plausible_unknowns,
    release_shared,
    with_supports,
)
from tests.polyworld.estimation.world_fit.floor_scenes import (
    GRAVITY,
    box,
    frames,
    scene,
    slowed,
    tracks_of,
    upright,
)


def fitted(coefficients: Sequence[float]) -> tuple[FitResult, FitResult]:
    """Fit three boxes that slide side by side with coefficients of friction: shared, and after the release."""
    places = {
        name: slowed(frames(24), 2.0, mu * GRAVITY) + np.array([0.0, 1.0 * k, 0.0])
        for k, (name, mu) in enumerate(zip("abc", coefficients, strict=True))
    }
    tracks = tracks_of(places, orientations={name: upright(24) for name in "abc"})
    world = with_supports(scene([box(name) for name in "abc"], tracks), tracks)
    found = default_unknowns(world, tracks, shared=())
    problem = FitProblem(world, tracks, plausible_unknowns(world, tracks, found))
    start = fit_by_prefixes(problem, PrefixSettings(starts=1))[0]
    own = plausible_unknowns(world, tracks, found, OrdinarySettings(alike=4))
    _, kept = release_shared(problem, start, own)
    return start.best, kept.best


def test_boxes_of_unlike_friction_are_released_and_each_gets_its_own() -> None:
    coefficients = (0.1, 0.2, 0.3)
    shared, kept = fitted(coefficients)
    assert kept.loss < 0.5 * shared.loss
    for name, mu in zip("abc", coefficients, strict=True):
        assert kept.by_name[f"{name}.friction"] == pytest.approx(mu, abs=0.02)


def test_boxes_of_one_friction_keep_sharing_it() -> None:
    _, kept = fitted((0.2, 0.2, 0.2))
    assert kept.by_name["friction of a, b, c"] == pytest.approx(0.2, abs=0.01)
