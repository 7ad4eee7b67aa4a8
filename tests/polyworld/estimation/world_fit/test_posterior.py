"""The posterior sample of a fit, against distributions in closed form and against worlds drawn at random."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest, norm

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import FitProblem, default_unknowns, refine, sample_posterior
from polyworld.estimation.world_fit.tempering import annealed, systematic, tempered
from polyworld.estimation.world_fit.truncated import TruncatedGaussian
from polyworld.world.parameters import read_parameter
from tests.atw_mcp.two_discs import two_discs
from tests.polyworld.sliding_block import fitted_block


def drawn(centre: list[float], gradient: list[float], curvature: list[list[float]]) -> np.ndarray:
    rng = np.random.default_rng(1)
    unit = np.zeros(len(centre)), np.ones(len(centre))
    return TruncatedGaussian(np.array(centre), np.array(gradient), np.array(curvature), *unit).draw(2000, rng)


def test_moves_along_some_directions_keep_the_density() -> None:
    """A ridge of two, cut by a bound, and a flat third: mean and covariance stay through many moves."""
    curvature = np.array([[400.0, 380.0, 0.0], [380.0, 400.0, 0.0], [0.0, 0.0, 0.0]])
    density = TruncatedGaussian(np.array([0.05, 0.5, 0.5]), np.zeros(3), curvature, np.zeros(3), np.ones(3))
    rng = np.random.default_rng(4)
    x = density.draw(4000, rng)
    moved = x
    for _ in range(30):
        moved = density.moved(moved, 2, rng)
    assert np.mean(np.abs(moved - x)) > 0.05
    np.testing.assert_allclose(moved.mean(axis=0), x.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(np.cov(moved.T), np.cov(x.T), atol=0.005)


@pytest.mark.parametrize("edge", [1.5, 2.3])
def test_where_few_draws_count_they_are_moved_to_where_the_posterior_is(edge: float) -> None:
    """Beyond an edge in the tail, where 7% or 1% of the draws are, the mean is phi(e) / (1 - Phi(e))."""
    size = 6
    density = TruncatedGaussian(np.zeros(size), np.zeros(size), np.eye(size), np.full(size, -7.0), np.full(size, 7.0))
    rng = np.random.default_rng(2)

    def log_ratio(x: np.ndarray, _owner: np.ndarray) -> np.ndarray:
        return np.minimum(60.0 * (x[:, 0] - edge), 0.0)

    draws, owner = density.draw(1024, rng), np.zeros(1024, dtype=np.int64)
    found, power = annealed(draws, log_ratio(draws, owner), owner, [density], log_ratio, rng)
    assert power == 1.0
    assert found[:, 0].mean() == pytest.approx(norm.pdf(edge) / norm.sf(edge), abs=0.08)
    np.testing.assert_allclose(found[:, 1:].std(axis=0), 1.0, atol=0.2)
    np.testing.assert_allclose(found[:, 1:].mean(axis=0), 0.0, atol=0.25)


def test_draws_within_the_bounds_have_the_covariance_of_the_gaussian() -> None:
    covariance = 1e-4 * np.array([[1.0, 0.99], [0.99, 1.0]])
    x = drawn([0.5, 0.5], [0.0, 0.0], np.linalg.inv(covariance).tolist())
    assert np.cov(x.T) == pytest.approx(covariance, rel=0.1)


def test_a_flat_direction_is_uniform_and_a_bound_cuts_the_gaussian_in_half() -> None:
    x = drawn([0.0, 0.5], [0.0, 0.0], [[1e4, 0.0], [0.0, 0.0]])
    assert kstest(x[:, 1], "uniform").pvalue > 0.01
    assert x[:, 0].mean() == pytest.approx(0.01 * np.sqrt(2.0 / np.pi), rel=0.05)


def test_a_ridge_of_two_parameters_is_filled_from_bound_to_bound() -> None:
    """Only the sum is known, to 0.01 about 1: each of the two alone is uniform."""
    x = drawn([0.5, 0.5], [0.0, 0.0], [[1e4, 1e4], [1e4, 1e4]])
    assert x.sum(axis=1).std() == pytest.approx(0.01, rel=0.1)
    assert kstest(x[:, 0], "uniform").pvalue > 0.01


def test_an_optimum_on_a_bound_that_the_data_want_beyond_decays_exponentially() -> None:
    x = drawn([0.0], [1e3], [[1e2]])
    assert x.mean() == pytest.approx(1e-3, rel=0.1)


def test_weights_are_tempered_until_enough_candidates_count() -> None:
    weights, exponent = tempered(np.array([0.0, -50.0, -100.0, -np.inf]), least=2.0)
    assert 1.0 / (weights**2).sum() == pytest.approx(2.0, rel=1e-6)
    assert 0.0 < exponent < 0.1
    assert weights[3] == 0.0
    assert tempered(np.zeros(8), least=4.0)[1] == 1.0


def test_systematic_resampling_keeps_candidates_of_equal_weight_apart() -> None:
    chosen = systematic(np.full(40, 1.0 / 40.0), 10, np.random.default_rng(0))
    assert np.diff(chosen).tolist() == [4] * 9


def test_what_the_tracks_cannot_show_is_drawn_from_its_bounds() -> None:
    _, _, sample = fitted_block(0.2, 1.1, np.random.default_rng(3))
    assert sample.from_bounds == ("block.restitution", "block.mass")  # it meets nothing
    values = sample.overrides(40)["objects.block.restitution"]
    assert values.min() < 0.2
    assert values.max() > 0.8
    speeds = sample.overrides(40)["objects.block.velocity.x"]
    assert abs(speeds.mean() - 1.1) < 3.0 * speeds.std()


def test_an_object_at_rest_is_placed_within_the_scatter_of_its_track() -> None:
    rng, sigma, count = np.random.default_rng(9), 0.004, 16
    start, places = two_discs(), np.zeros((count, 2, 3))
    places[:, 0, 0], places[:, 1, 0], places[:, :, 2] = np.arange(count) * 0.02, 1.0, 0.05
    places[:, :, :2] += sigma * rng.normal(size=(count, 2, 2))
    tracks = ObservedTracks(
        names=("striker", "target"),
        frames=np.arange(count),
        seconds_per_frame=0.02,
        positions=places,
        position_sigma=np.full((count, 2), sigma),
        orientations=np.full((count, 2, 4), np.nan),
        confidence=np.ones((count, 2)),
        orientation_confidence=np.zeros((count, 2)),
        symmetry=(0, 0),
    )
    problem = FitProblem(start, tracks, default_unknowns(start, tracks, shared=(), each=("friction",)))
    sample = sample_posterior(problem, [refine(problem)])
    assert sample is not None
    values = sample.overrides(64)
    for axis, where in (("x", 1.0), ("y", 0.0)):
        placed = values[f"objects.target.position.{axis}"]
        assert placed.mean() == pytest.approx(where, abs=0.001)
        assert placed.std() == pytest.approx(sigma / np.sqrt(count), rel=0.5)
    assert "objects.target.position.z" not in values


def test_noise_above_the_stated_widens_the_sample() -> None:
    widths = []
    for stated in (0.016, 0.004, 0.001):
        _, _, sample = fitted_block(0.2, 1.1, np.random.default_rng(5), stated=stated)
        widths.append(sample.overrides(40)["objects.block.friction"].std())
    as_large, as_stated, beyond = widths
    assert beyond == pytest.approx(as_stated, rel=0.3)  # the residuals say 0.004 where 0.001 was stated
    assert as_large > 2.0 * as_stated  # a stated noise is believed where the residuals lie below it


def test_the_best_fit_is_the_first_member() -> None:
    _, fitted, sample = fitted_block(0.2, 1.1, np.random.default_rng(3))
    for path, (value,) in sample.overrides(1).items():
        if ".rotation." not in path:  # a fitted world counts them from its own orientation
            assert value == pytest.approx(read_parameter(fitted, path), abs=1e-12)
