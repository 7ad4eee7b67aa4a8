"""Other minima of a fit: a bounce that slows a ball is a slippery floor, or a rough one and a spin (Coulomb's law)."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.estimation.world_fit import (
    FitProblem,
    alternative_minima,
    default_unknowns,
    plausible_unknowns,
    refine,
    sample_posterior,
)
from tests.polyworld.estimation.world_fit.floor_scenes import GRAVITY, RADIUS, ball, scene, tracks_of

RESTITUTION, SPEED, DROP, LOST, STEP = 0.7, 2.0, 0.5, 0.4, 0.03


def bounce() -> np.ndarray:
    """Places (T, 3) of a ball that falls by DROP, and loses LOST of its horizontal speed in one bounce."""
    hit = np.sqrt(2.0 * DROP / GRAVITY)
    times = np.arange(18) * STEP
    before = np.stack([SPEED * times, 0.0 * times, RADIUS + DROP - 0.5 * GRAVITY * times**2], axis=1)
    since = times - hit
    up = RESTITUTION * GRAVITY * hit
    after = np.stack(
        [SPEED * hit + (SPEED - LOST) * since, 0.0 * times, RADIUS + up * since - 0.5 * GRAVITY * since**2], 1
    )
    return np.where((times < hit)[:, None], before, after)


@pytest.fixture(scope="module")
def problem() -> FitProblem:
    tracks = tracks_of({"ball": bounce()}, frame=STEP, seed=1)
    world = scene([ball(position=(0.0, 0.0, RADIUS + DROP))], tracks)
    return FitProblem(world, tracks, plausible_unknowns(world, tracks, default_unknowns(world, tracks)))


def test_a_bounce_is_explained_by_sliding_and_by_a_spin(problem: FitProblem) -> None:
    """Sliding: LOST = mu (1 + e) v. Gripping: LOST = 2/7 (SPEED - spin R)."""
    best = refine(problem)
    found = [best, *alternative_minima(problem, best)]
    assert max(f.loss for f in found[:2]) < 1.5
    fall = np.sqrt(2.0 * GRAVITY * DROP)
    slides = [f for f in found if f.by_name["ball.friction"] < 1.2 * LOST / ((1.0 + RESTITUTION) * fall)]
    grips = [f for f in found if f not in slides]
    assert slides
    assert grips
    assert slides[0].by_name["ball.friction"] == pytest.approx(LOST / ((1.0 + RESTITUTION) * fall), rel=0.1)
    spin = (SPEED - 3.5 * LOST) / RADIUS
    assert grips[0].by_name["ball.angular_velocity.y"] == pytest.approx(spin, rel=0.2)


def test_the_posterior_holds_both(problem: FitProblem) -> None:
    best = refine(problem)
    sample = sample_posterior(problem, [best, *alternative_minima(problem, best)])
    assert sample is not None
    column = [u.name for u in sample.unknowns].index("ball.friction")
    limit = LOST / ((1.0 + RESTITUTION) * np.sqrt(2.0 * GRAVITY * DROP))
    slippery = np.mean(sample.values[:, column] < 1.2 * limit)
    assert 0.05 < slippery < 0.95
    alone = sample_posterior(problem, [best])
    assert alone is not None
    assert not 0.05 < np.mean(alone.values[:, column] < 1.2 * limit) < 0.95
