"""Noise against noise whose level, correlation and outliers are known."""

from functools import partial

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.noise import Noise, measured_noise, refined_noise
from polyworld.estimation.sample_outliers import outliers
from tests.polyworld.linear_case import (
    Array,
    Design,
    Draw,
    correlated,
    flight_design,
    flight_fit,
    flight_world,
    white,
    with_outliers,
)


def refined(plan: Design) -> Noise:
    noise = measured_noise(plan)
    for _ in range(2):
        noise = refined_noise(plan, noise, flight_fit(plan, noise)[1])
    return noise


def one_run(times: Array, places: Array, orientations: Array | None = None, sigma: float | None = None) -> Design:
    turned = np.full((len(times), 1, 4), np.nan) if orientations is None else orientations[:, None]
    return design(flight_world(), Recording((Run("run", ("ball",), times, places[:, None], turned, sigma),)))


@pytest.mark.parametrize("sigma", [0.001, 0.03])
def test_level_of_white_noise_is_found_before_any_model(sigma: float) -> None:
    noise = measured_noise(flight_design(np.random.default_rng(1), white, sigma))
    assert noise.levels[0].sigma == pytest.approx(sigma, rel=0.06)
    assert noise.correlation["position"].phi < 0.1


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_level_and_correlation_of_correlated_noise_are_found_after_a_fit(seed: int) -> None:
    noise = refined(flight_design(np.random.default_rng(seed), correlated, 0.01))
    correlation = noise.correlation["position"]
    assert correlation.phi == pytest.approx(0.9, abs=4.0 * correlation.error)
    assert correlation.error < 0.02
    assert noise.levels[0].sigma == pytest.approx(0.01, rel=0.15)
    assert correlation.tau == pytest.approx(-1.0 / 120.0 / np.log(0.9), rel=0.4)


@pytest.mark.parametrize(
    ("count", "runs", "phi"), [(20, 16, 0.0), (20, 16, 0.6), (28, 8, 0.3), (60, 8, 0.0), (60, 8, 0.6)]
)
def test_level_and_correlation_of_short_series_are_found_without_bias(count: int, runs: int, phi: float) -> None:
    draw = partial(correlated, phi=phi) if phi else white
    before, after, whitened, correlations = [], [], [], []
    for seed in range(6):
        plan = flight_design(np.random.default_rng(seed), draw, 0.001, runs=runs, count=count, rate=30.0)
        noise = refined(plan)
        before.append(measured_noise(plan).levels[0].sigma / 0.001)
        after.append(noise.levels[0].sigma / 0.001)
        correlations.append(noise.correlation["position"].phi)
        whitened.append(flight_fit(plan, noise)[0].chi2 / (noise.count - sum(r.count for r in plan.runs)))
    assert np.median(before) == pytest.approx(1.0, abs=0.1)
    assert np.median(after) == pytest.approx(1.0, abs=0.1)
    assert np.mean(after) == pytest.approx(1.0, abs=0.1)
    assert np.mean(correlations) == pytest.approx(phi, abs=0.06)
    assert np.mean(whitened) == pytest.approx(1.0, abs=0.08)


def test_bounces_and_curved_flights_do_not_pass_for_correlation_of_short_series() -> None:
    """Drag bends the flight, and a third of the runs rebound, all unknown to the noise before any model."""
    rng = np.random.default_rng(15)
    times = np.arange(28) / 30.0
    runs = []
    for k in range(9):
        fall = np.exp(-0.8 * times)[:, None] * rng.uniform(1.0, 3.0, 3)
        kink = np.where(k % 3 == 0, 3.0, 0.0) * np.maximum(times - rng.uniform(0.3, 0.6), 0.0)[:, None]
        seen = fall + kink + correlated(rng, (28, 3), 0.005, phi=0.5)
        runs.append(Run(f"run{k}", ("ball",), times, seen[:, None], np.full((28, 1, 4), np.nan)))
    noise = measured_noise(design(flight_world(), Recording(tuple(runs))))
    assert noise.correlation["position"].phi == pytest.approx(0.5, abs=0.2)
    assert noise.levels[0].sigma == pytest.approx(0.005, rel=0.2)


@pytest.mark.parametrize("draw", [white, correlated, with_outliers])
def test_whitened_residuals_have_unit_variance_and_no_correlation(draw: Draw) -> None:
    plan = flight_design(np.random.default_rng(3), draw, 0.01)
    noise = refined(plan)
    fit, _ = flight_fit(plan, noise)
    assert fit.chi2 / (noise.count - sum(r.count for r in plan.runs)) == pytest.approx(1.0, abs=0.1)
    neighbours = np.concatenate(
        [fit.linear.r[s.run][s.where][1:] * fit.linear.r[s.run][s.where][:-1] for s in plan.series]
    )
    assert abs(neighbours.mean()) < 0.06


def test_outliers_are_set_aside_and_little_else() -> None:
    rng = np.random.default_rng(4)
    plan = flight_design(rng, with_outliers, 0.01)
    noise = refined(plan)
    assert noise.outlier_share == pytest.approx(0.02, abs=0.006)
    clean = refined(flight_design(rng, white, 0.01))
    assert clean.outlier_share < 0.001


def test_model_error_does_not_pass_for_correlation() -> None:
    """A push that the world does not know leaves parabolas of 100 standard deviations."""
    noise = refined(flight_design(np.random.default_rng(5), white, 0.001, push=np.array([1.0, 0.5, 0.0])))
    assert noise.correlation["position"].phi < 0.1
    assert noise.levels[0].sigma == pytest.approx(0.001, rel=0.06)


def test_steps_and_kinks_are_no_outliers() -> None:
    rng = np.random.default_rng(6)
    times = np.arange(192) / 120.0
    step = np.where(times > 0.8, 0.05, 0.0)
    ramp = np.interp(times, [0.0, 0.8, 0.8 + 1.5 / 120.0, 1.6], [0.0, 0.0, 0.05, 0.03])
    kink = 2.0 * np.abs(times - 0.8)
    for shape in (step, ramp, kink):
        assert not outliers(times, shape + rng.normal(0, 0.001, 192), 0.001).any()


def test_two_outliers_side_by_side_are_found() -> None:
    rng = np.random.default_rng(7)
    values = rng.normal(0, 1.0, 100)
    values[[40, 41, 0, 99]] += 12.0
    assert np.array_equal(np.flatnonzero(outliers(np.arange(100.0), values, 1.0)), [0, 40, 41, 99])


def test_rounded_positions_keep_at_least_the_noise_of_rounding() -> None:
    times = np.arange(100) / 30.0
    places = np.stack([np.round(0.2 * times, 2), np.full(100, 0.5), np.round(0.1 * times, 2)], axis=1)
    noise = measured_noise(one_run(times, places))
    for s in noise.sigma:
        assert np.all(s > 0.0)
    assert noise.sigma[0][0] >= 0.01 / np.sqrt(12.0) * 0.999


def test_rows_shown_twice_are_set_aside() -> None:
    rng = np.random.default_rng(8)
    times = np.arange(200) / 120.0
    places = 10.0 + 3.0 * times[:, None] + rng.normal(0, 0.001, (200, 3))
    places[[50, 120]] = places[[49, 119]]
    noise = measured_noise(one_run(times, places))
    assert noise.repeated == 2
    assert noise.count == 3 * 198


def test_gaps_and_uneven_times_leave_the_level() -> None:
    rng = np.random.default_rng(9)
    times = np.sort(rng.uniform(0.0, 4.0, 500))
    places = 10.0 + 3.0 * times[:, None] + rng.normal(0, 0.01, (500, 3))
    places[100:180] = np.nan
    noise = measured_noise(one_run(times, places))
    assert noise.levels[0].sigma == pytest.approx(0.01, rel=0.15)


def test_noise_of_rotations_is_found_beyond_full_turns() -> None:
    rng = np.random.default_rng(10)
    times = np.arange(300) / 120.0
    half = 0.5 * (20.0 * times + rng.normal(0, 0.02, 300))
    turned = np.stack([np.cos(half), np.zeros(300), np.zeros(300), np.sin(half)], axis=1)
    noise = measured_noise(one_run(times, np.full((300, 3), np.nan), turned))
    about_z = next(s for s in one_run(times, np.full((300, 3), np.nan), turned).series if s.axis == 2)
    assert noise.sigma[0][about_z.where][0] == pytest.approx(0.02, rel=0.2)
    assert noise.levels[0].unit == "rad"


def test_levels_of_axes_are_separated_and_those_of_alike_runs_pooled() -> None:
    rng = np.random.default_rng(11)

    def deep(rng: np.random.Generator, shape: tuple[int, int], sigma: float) -> Array:
        return rng.normal(0, 1.0, shape) * sigma * np.array([1.0, 5.0, 1.0])

    plan = flight_design(rng, deep, 0.001, runs=6, count=60)
    noise = measured_noise(plan)
    along, across = [], []
    for s in plan.series:
        (along if s.axis == 1 else across).append(noise.sigma[s.run][s.where][0])
    assert np.median(along) == pytest.approx(0.005, rel=0.2)
    assert np.median(across) == pytest.approx(0.001, rel=0.2)
    assert np.std(np.log(across)) < 0.15  # single series scatter by about 0.17


def test_noise_that_the_recording_states_is_believed_unless_the_data_are_noisier() -> None:
    rng = np.random.default_rng(12)
    times = np.arange(200) / 120.0
    places = 10.0 + rng.normal(0, 0.01, (200, 3))
    assert measured_noise(one_run(times, places, sigma=0.011)).levels[0].sigma == pytest.approx(0.011)
    noisier = measured_noise(one_run(times, places, sigma=0.001))
    assert noisier.levels[0].sigma == pytest.approx(0.01, rel=0.15)
    assert "noisier" in noisier.summary()


@pytest.mark.parametrize("count", [2, 5, 9])
def test_very_short_runs_have_a_noise(count: int) -> None:
    rng = np.random.default_rng(13)
    plan = one_run(np.arange(count) / 30.0, 10.0 + rng.normal(0, 0.01, (count, 3)))
    noise = measured_noise(plan)
    again = refined_noise(plan, noise, [np.zeros(plan.length)])
    for n in (noise, again):
        assert np.all(np.isfinite(n.whiten(0, np.ones(plan.length))))
        assert np.all(n.sigma[0] > 0.0)


def test_whitening_is_the_exact_filter_over_gaps() -> None:
    """Against the inverse of the Cholesky factor of the covariance phi^|dt|."""
    plan = flight_design(np.random.default_rng(14), correlated, 0.01, runs=1, count=60)
    noise = refined(plan)
    s = plan.series[0]
    kept = noise.kept[0][s.where]
    t = plan.runs[0].times[s.rows]
    c = noise.correlation["position"]
    covariance = noise.sigma[0][s.where][0] ** 2 * c.phi ** (np.abs(t[:, None] - t) / c.interval)
    values = np.random.default_rng(0).normal(size=plan.length)
    expected = np.linalg.solve(np.linalg.cholesky(covariance[np.ix_(kept, kept)]), values[s.where][kept])
    assert noise.whiten(0, values)[s.where][kept] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("rate", [10.0, 20.0, 100.0])
def test_an_oscillation_with_few_samples_a_period_is_not_taken_for_noise(rate: float) -> None:
    times = np.arange(0.0, 4.0, 1.0 / rate)
    swing = 0.15 * np.sin(8.0 * times)  # 1.27 Hz
    clean = np.stack([swing, 0.15 * np.cos(8.0 * times), 0.0 * times], axis=1)
    places = clean + np.random.default_rng(11).normal(0.0, 2e-4, clean.shape)
    noise = measured_noise(one_run(times, places))
    assert 1e-4 < noise.levels[0].sigma < 5e-4
