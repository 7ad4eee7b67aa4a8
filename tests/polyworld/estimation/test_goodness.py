"""The gate: false alarms on noise of known kinds, and what it lets through."""

import numpy as np
import pytest
from scipy import stats
from scipy.fft import dct

from polyworld.estimation.goodness import Goodness, cosines, goodness
from polyworld.estimation.noise import measured_noise, refined_noise
from tests.polyworld.linear_case import (
    Array,
    Draw,
    correlated,
    flight_design,
    flight_fit,
    white,
    with_outliers,
)


def judged(
    seed: int, draw: Draw, sigma: float = 0.01, *, push: Array | None = None, runs: int = 8, since: float = 0.0
) -> Goodness:
    plan = flight_design(np.random.default_rng(seed), draw, sigma, push=push, runs=runs, since=since)
    noise = measured_noise(plan)
    for _ in range(2):
        noise = refined_noise(plan, noise, flight_fit(plan, noise)[1])
    return goodness(plan, noise, flight_fit(plan, noise)[0])


@pytest.mark.parametrize("draw", [white, correlated, with_outliers])
def test_noise_passes(draw: Draw) -> None:
    verdicts = [judged(seed, draw, runs=3) for seed in range(8)]
    assert sum(not v.passes for v in verdicts) <= 1
    assert np.mean([v.statistic for v in verdicts]) == pytest.approx(1.0, abs=0.2)


def test_p_values_of_white_noise_are_spread_evenly() -> None:
    p = [judged(seed, white, runs=2).p_total for seed in range(100, 118)]
    assert stats.kstest(p, "uniform").pvalue > 0.01


@pytest.mark.parametrize("draw", [white, with_outliers])
def test_a_push_of_noncentrality_200_fails(draw: Draw) -> None:
    """0.5 a t^2 less its line has the squared length a^2 T^4 n / 720 for each run."""
    count, duration, sigma = 192, 1.6, 0.01
    push = np.sqrt(200.0 * 720.0 / (8 * count)) * sigma / duration**2
    for seed in range(2):
        verdict = judged(seed, draw, sigma, push=np.array([push, 0.0, 0.0]))
        assert not verdict.passes
        assert "does not explain" in verdict.summary()


def test_a_push_in_correlated_noise_fails_when_it_is_strong() -> None:
    assert not judged(0, correlated, 0.01, push=np.array([0.5, 0.0, 0.0])).passes


def test_the_axis_that_is_wrong_is_reported() -> None:
    verdict = judged(1, white, 0.01, push=np.array([0.0, 0.1, 0.0]))
    assert verdict.worst is not None
    assert verdict.worst.axis == 1
    assert {s.axis for s in verdict.series[:4]} == {1}
    assert verdict.to_json()["passes"] is False


def test_a_late_push_fails_too() -> None:
    assert not judged(2, white, 0.001, push=np.array([0.3, 0.0, 0.0]), since=1.3).passes


def test_cosines_on_even_instants_are_those_of_the_discrete_cosine_transform() -> None:
    values = np.random.default_rng(0).normal(size=50)
    assert np.abs(cosines(np.arange(50.0), 12).T @ values) == pytest.approx(np.abs(dct(values, norm="ortho")[:12]))


def test_series_too_short_to_judge_do_not_pass() -> None:
    plan = flight_design(np.random.default_rng(0), white, runs=1, count=2)
    noise = measured_noise(plan)
    verdict = goodness(plan, noise, flight_fit(plan, noise)[0])
    assert not verdict.passes
    assert "cannot be judged" in verdict.summary()
