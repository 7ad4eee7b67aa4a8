"""Choices among hypotheses whose predictions are made up, and intervals against ordinary least squares."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import norm

from polyworld.data.recording import Recording, Run
from polyworld.gap import GapSettings
from polyworld.gap.catalogue import named
from polyworld.gap.choose import choose, credible, resampled, score, winners
from polyworld.gap.fitting import Fitted, correlation_evidence, fit
from polyworld.gap.ground import ground_of
from polyworld.gap.hypothesis import Hypothesis, extended
from polyworld.gap.verdict import intervals
from polyworld.world import World

Array = NDArray[np.float64]

SETTINGS, COUNTS = GapSettings(), np.full(6, 100.0)


def predicted(errors: Array, price: float, phi: float = 0.0) -> Fitted:
    """A hypothesis that predicts six runs with these errors, its residuals correlated by phi from row to row."""
    white = np.random.default_rng(1).normal(size=(6, 2000, 3))
    grids = tuple(lfilter([1.0], [1.0, -phi], g, axis=0) for g in white)
    return cast(Fitted, SimpleNamespace(errors=errors, price=price, simplicity=price, grids=grids))


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_correlated_residuals_count_as_so_many_independent_ones_as_their_mean_says(phi: float) -> None:
    """The variance of a mean of n values is (1 + phi) / (1 - phi) / n (Bartlett 1935)."""
    share = score([predicted(np.full(6, 1.1), 1.0, phi), predicted(np.full(6, 5.0), 0.0)], COUNTS)
    assert share == pytest.approx((1.0 - phi) / (1.0 + phi), rel=0.1)


@pytest.mark.parametrize(("phi", "times"), [(0.1, 1.0), (0.3, 1.0), (-0.3, 0.0)])
def test_evidence_of_correlation_is_half_the_squared_score(phi: float, times: float) -> None:
    """The correlation of n values that are independent has a variance of 1 / n (Bartlett 1946)."""
    evidence = correlation_evidence(predicted(np.full(6, 1.1), 1.0, phi))
    assert np.median(evidence) == pytest.approx(times * 0.5 * phi**2 * 1999 * 3 - np.log(6.0), rel=0.2)
    assert np.all(correlation_evidence(predicted(np.full(6, 1.1), 1.0)) < SETTINGS.excluded)


def test_the_simplest_of_those_near_the_best_is_chosen() -> None:
    null, plain, rich = (predicted(np.full(6, e), p) for e, p in ((3.0, 0.0), (1.01, 1.0), (1.005, 4.0)))
    score([null, plain, rich], COUNTS)
    choice = choose([null, plain, rich], SETTINGS, 1.0)
    assert choice.chosen is plain
    assert all(f is plain for f in winners([null, plain, rich], SETTINGS, 1.0))


def test_a_richer_one_that_predicts_every_run_better_is_chosen() -> None:
    plain, rich = predicted(np.full(6, 1.5), 1.0), predicted(np.full(6, 1.0), 5.0)
    score([plain, rich], COUNTS)
    assert choose([plain, rich], SETTINGS, 1.0).chosen is rich


def test_a_gain_in_one_run_alone_does_not_decide() -> None:
    errors = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.4])
    plain, rich = predicted(errors, 1.0), predicted(np.full(6, 1.0), 5.0)
    score([plain, rich], COUNTS)
    choice = choose([plain, rich], SETTINGS, 1.0)
    assert min(choice.near, key=lambda f: f.total) is rich
    assert choice.chosen is plain


def test_noise_moves_a_difference_of_scores_by_the_distance_of_predictions() -> None:
    """Var(log-likelihood ratio) of two predictions d standard deviations apart is d^2 (Cox 1961)."""
    right, other = predicted(np.ones(6), 1.0), predicted(np.ones(6), 1.0)
    other.grids = tuple(g + 0.05 for g in right.grids)
    assert score([right, other], COUNTS) == 1.0
    totals = resampled([right, other], SETTINGS, 1.0)
    assert np.std(totals[:, 1] - totals[:, 0]) == pytest.approx(0.05 * np.sqrt(6 * 6000), rel=0.15)


def test_intervals_are_those_of_ordinary_least_squares() -> None:
    """Gravity from three free falls whose noise is known: place, velocity and gravity are linear unknowns."""
    rng, sigma, times = np.random.default_rng(3), 0.002, np.arange(60) / 60.0
    slopes = np.stack([np.ones(60), times, 0.5 * times**2], axis=1)
    runs, pull = [], []
    for k in range(3):
        path = slopes @ np.array([5.0, k - 1.0, -9.7]) + rng.normal(0.0, sigma, 60)
        pull.append(np.linalg.lstsq(slopes, path, rcond=None)[0][2])
        places = np.full((60, 1, 3), np.nan)
        places[:, 0, 2] = path
        runs.append(Run(f"r{k}", ("ball",), times, places, np.full((60, 1, 4), np.nan), sigma))
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.05}, "position": [0, 0, 5]}
    world = World.model_validate({"objects": [ball], "time": {"substep": 0.004}})
    ground = ground_of(world, Recording(tuple(runs)), SETTINGS)
    (law,) = extended(Hypothesis(ground.world), named(["gravity_error"])[0], ground.recording)
    fitted = fit(ground, law, growing=True, scale=1.0)
    ((low, high),) = intervals(fitted)
    error = sigma * np.sqrt(np.linalg.inv(slopes.T @ slopes)[2, 2] / 3.0)
    assert 0.5 * (low + high) == pytest.approx(np.mean(pull), abs=0.2 * error)
    assert 0.5 * (high - low) == pytest.approx(norm.ppf(0.975) * error * fitted.scale, rel=0.1)


@pytest.mark.parametrize(("error", "trusted"), [(1.01, True), (1.1, False), (1.05, False)])
def test_what_bends_has_to_reach_the_noise_or_to_halve_what_is_beyond_it(error: float, trusted: bool) -> None:
    """A law with a place beside one that leaves 14% more than the noise: 1.1 leaves five sixths of what was beyond."""

    def made(key: frozenset[tuple[str, str]], error: float, *parts: object) -> Fitted:
        kind = SimpleNamespace(possible=lambda *_: True, key=key, parts=parts)
        own = {"hypothesis": kind, "error": error, "errors": np.full(6, error), "values": np.zeros(0)}
        return cast(Fitted, SimpleNamespace(**own, ground=SimpleNamespace(settings=SETTINGS, counts=COUNTS)))

    attraction = SimpleNamespace(
        candidate=SimpleNamespace(name="central_force", local=False), variant=SimpleNamespace(label=""),
        bends=False, stands_in=True,
    )  # fmt: skip
    null = made(frozenset(), 1.14)
    pulled = made(frozenset({("central_force", "")}), error, attraction)
    assert any(f is pulled for f in credible([null, pulled], null)) == trusted
