"""Posterior samples against distributions in closed form: Gaussian, truncated, half-normal, uniform."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import halfnorm, kstest, truncnorm

from polyworld.estimation.posterior import SamplingSettings, _weights, sample
from tests.polyworld.estimation.linear_problem import LinearProblem, flat, shared_unknown

COUNT = 1000
MANY = SamplingSettings(draws=4000)


def deaf(own: LinearProblem, column: int) -> LinearProblem:
    """The same problem, of which no residual depends on one shared unknown."""
    for law in (*own.laws.values(), *own.ends.values()):
        law.by_shared[:, column] = 0.0
    return own


def test_a_linear_model_has_its_gaussian_of_constants_and_states() -> None:
    own = LinearProblem([2, 1], [shared_unknown(0, prior=(0.0, 0.3)), shared_unknown(1)], rows=30)
    found = own.fit()
    matrix, _ = own.dense()
    covariance = np.linalg.inv(matrix.T @ matrix) * own.remainder(found)
    drawn = sample(own, found, COUNT, 0, MANY)
    every = np.concatenate([drawn.shared, *(y for run in drawn.states for y in run)], axis=1)
    error = np.sqrt(np.diag(covariance))
    assert every.mean(axis=0) == pytest.approx(flat(found.point), abs=5.0 * error.max() / np.sqrt(COUNT))
    assert every.std(axis=0) / error == pytest.approx(np.ones(len(error)), abs=0.12)
    correlation = covariance / np.outer(error, error)
    assert np.abs(np.corrcoef(every.T) - correlation).max() < 0.15
    assert drawn.effective > 0.5 * COUNT


def test_an_object_that_is_not_in_a_bent_collision_keeps_its_own_spread() -> None:
    """States of `b` cost far more than slopes at the minimum say, so that nearly no member takes all states at once."""
    own = LinearProblem([1], [shared_unknown(0)], rows=6)
    block = own.runs[0][0]
    block.states = replace(block.states, labels=tuple(f"{name}.{a}" for a in "xyz" for name in "ab"))

    def bent(_: NDArray[np.float64], states: NDArray[np.float64]) -> NDArray[np.float64]:
        found = states.copy()
        found[:, 1::2] += 300.0 * states[:, 1::2] ** 3
        return found

    own.laws[id(block)] = bent
    drawn = sample(own, own.fit(), COUNT, 0, MANY).states[0][0]
    assert drawn[:, ::2].std(axis=0) == pytest.approx(np.ones(3), abs=0.1)
    assert drawn[:, 1::2].std(axis=0).max() < 0.4
    at_once = sample(own, own.fit(), COUNT, 0, replace(MANY, turns=0)).states[0][0]
    assert at_once[:, ::2].std(axis=0).max() < 0.5


def test_a_rate_that_nothing_shows_is_absent_or_half_normal() -> None:
    """With even chances, as a coordinate that goes on below the bound has it."""
    rate = shared_unknown(1, start=0.05, lower=0.0, upper=3.0, typical=0.15, prior=(0.0, 0.15))
    own = deaf(LinearProblem([1], [shared_unknown(0), rate]), 1)
    drawn = sample(own, own.fit(), COUNT, 1, MANY).shared[:, 1]
    assert np.mean(drawn <= 0.0) == pytest.approx(0.5, abs=0.06)
    assert kstest(drawn[drawn > 0.0], halfnorm(scale=0.15).cdf).statistic < 0.08


def test_a_constant_without_prior_or_data_is_uniform_within_its_bounds() -> None:
    own = deaf(LinearProblem([1], [shared_unknown(0), shared_unknown(1, start=0.5, lower=0.0, upper=1.0)]), 1)
    drawn = sample(own, own.fit(), COUNT, 2, MANY).shared[:, 1]
    assert kstest(drawn, "uniform").statistic < 0.06


def test_a_minimum_on_a_bound_that_the_data_want_beyond_has_the_tail_inside() -> None:
    free = LinearProblem([1], [shared_unknown(0)], seed=4)
    at = free.fit()
    matrix, _ = free.dense()
    sd = float(np.sqrt(np.linalg.inv(matrix.T @ matrix)[0, 0]))
    edge = float(at.point.shared[0]) + 1.0 * sd
    own = LinearProblem([1], [shared_unknown(0, start=edge + 1.0, lower=edge)], seed=4)
    found = own.fit()
    assert found.point.shared[0] == pytest.approx(edge)
    drawn = sample(own, found, COUNT, 3, MANY).shared[:, 0]
    wide = sd * np.sqrt(own.remainder(found))
    exact = truncnorm((edge - float(at.point.shared[0])) / wide, np.inf, loc=at.point.shared[0], scale=wide)
    assert kstest(drawn, exact.cdf).statistic < 0.06


def test_residuals_above_the_noise_widen_the_sample_and_below_it_do_not_narrow_it() -> None:
    widths = []
    for scale in (0.3, 1.0, 3.0):
        own = LinearProblem([1], [shared_unknown(0)], rows=400, scale=scale, seed=6)
        widths.append(sample(own, own.fit(), COUNT, 0, MANY).shared.std())
    assert widths[0] == pytest.approx(widths[1], rel=0.12)
    assert widths[2] == pytest.approx(3.0 * widths[1], rel=0.12)


def test_a_minimum_in_the_corner_of_many_bounds_is_sampled() -> None:
    """Of draws about such a corner one in thousands is within all bounds; constants that nothing shows have priors, of
    which the part within the bound is left."""
    count = 14
    one = shared_unknown(0, prior=(-0.5, 1.0), lower=0.0, start=0.5, typical=0.5)
    own = LinearProblem([1], [one] * count)
    for column in range(count):
        own = deaf(own, column)
    found = own.fit()
    assert np.abs(found.point.shared).max() < 1e-6
    drawn = sample(own, found, COUNT, 5, MANY).shared
    assert drawn.min() >= 0.0
    exact = truncnorm(0.5, np.inf, loc=-0.5)
    assert np.median(drawn.mean(axis=0)) == pytest.approx(exact.mean(), abs=0.15)


def test_weights_are_flattened_until_enough_count_however_far_the_proposal_is() -> None:
    """Else rounds would end after the second one, with draws as broad as the first proposal."""
    logs = -1e6 * np.random.default_rng(5).random(500) ** 2
    weights, counted = _weights(logs, 64.0)
    assert counted < 3.0
    assert 1.0 / (weights**2).sum() == pytest.approx(64.0, rel=0.01)
    even, counted = _weights(np.zeros(500), 64.0)
    assert (counted, even[0]) == pytest.approx((500.0, 0.002))
