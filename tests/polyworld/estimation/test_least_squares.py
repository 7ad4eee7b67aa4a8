"""Block-bordered least squares against dense solutions by NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from polyworld.estimation.least_squares import Point
from tests.polyworld.estimation.linear_problem import LinearProblem, flat, shared_unknown

PRIORS = [shared_unknown(0, prior=(0.5, 0.2)), shared_unknown(1), shared_unknown(2, prior=(-1.0, 2.0))]


def problem(**fields: float) -> LinearProblem:
    """Three runs, of which the second is of three stretches."""
    return LinearProblem([1, 3, 1], PRIORS, **fields)  # type: ignore[arg-type]


def elsewhere(own: LinearProblem) -> Point:
    rng, start = np.random.default_rng(7), own.start()
    return Point(rng.normal(size=3), tuple(tuple(y + rng.normal(size=6) for y in run) for run in start.states))


@pytest.mark.parametrize("damping", [0.0, 0.1, 30.0])
@pytest.mark.parametrize("state_prior", [np.inf, 0.7])
def test_a_damped_step_is_that_of_the_dense_system(damping: float, state_prior: float) -> None:
    own = problem(state_prior=state_prior)
    at = elsewhere(own)
    matrix, offset = own.dense()
    information, gradient = matrix.T @ matrix, matrix.T @ (matrix @ flat(at) + offset)
    expected = -np.linalg.solve(information + damping * np.diag(np.diag(information)), gradient)
    found = flat(own.step(own.normal(at, 1.0), at, damping)) - flat(at)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-8)


def test_the_minimum_and_its_cost_are_those_of_ordinary_least_squares() -> None:
    own = problem()
    matrix, offset = own.dense()
    expected = np.linalg.lstsq(matrix, -offset)[0]
    found = own.fit(elsewhere(own))
    assert found.converged
    assert flat(found.point) == pytest.approx(expected, abs=1e-5)
    assert found.cost == pytest.approx(float(((matrix @ expected + offset) ** 2).sum()), rel=1e-8)
    at = elsewhere(own)
    costs = own.costs([at, found.point], 1.0)
    assert costs[0] == pytest.approx(float(((matrix @ flat(at) + offset) ** 2).sum()))
    assert costs[1] == pytest.approx(found.cost)


def test_slopes_of_a_secant_explain_its_step_and_its_minimum_is_the_same() -> None:
    """From slopes that are off by a tenth, Broyden's update fits the last step; descents that seldom take differences
    end where ordinary least squares does."""
    own = problem(renewed=4)
    before = own.start()
    at = own.step(own.normal(before, 1.0), before, 0.1)
    wrong = own.normal(before, 1.0)
    for one in wrong.slopes:
        np.multiply(one.shared, 1.1, out=one.shared)
    found = own.secant(wrong, before, at, 1.0)
    steps = [y - x for a, b in zip(at.states, before.states, strict=True) for y, x in zip(a, b, strict=True)]
    for old, new, step in zip(wrong.slopes, found.slopes, steps, strict=True):
        change = new.shared @ (at.shared - before.shared) + new.states @ step
        assert change == pytest.approx(new.residuals - old.residuals, rel=1e-6, abs=1e-9)
    matrix, offset = own.dense()
    expected = np.linalg.lstsq(matrix, -offset)[0]
    assert flat(own.fit(elsewhere(own)).point) == pytest.approx(expected, abs=1e-5)


def test_a_minimum_beyond_bounds_is_that_of_the_bounded_problem() -> None:
    bounded = [shared_unknown(0, lower=-0.02, upper=0.02), shared_unknown(1), shared_unknown(2, lower=0.0)]
    own = LinearProblem([2, 1], bounded, seed=3)
    matrix, offset = own.dense()
    low, high = np.full(matrix.shape[1], -np.inf), np.full(matrix.shape[1], np.inf)
    low[[0, 2]], high[0] = (-0.02, 0.0), 0.02
    expected = lsq_linear(matrix, -offset, (low, high), tol=1e-14)
    assert np.any(np.abs(expected.x[:1]) > 0.0199)
    found = own.fit()
    assert found.point.shared == pytest.approx(expected.x[:3], abs=1e-5)
    assert found.cost == pytest.approx(2.0 * expected.cost, rel=1e-6)


def test_outliers_count_as_huber_has_it() -> None:
    """One residual in five is 40 standard deviations off: SciPy's robust minimum, which the plain one is far from."""
    own = problem(huber=4.0)
    rng = np.random.default_rng(1)
    for law in own.laws.values():
        law.offset[rng.uniform(size=len(law.offset)) < 0.2] += 40.0
    matrix, offset = own.dense()
    robust = least_squares(lambda z: matrix @ z + offset, np.zeros(matrix.shape[1]), loss="huber", f_scale=4.0,
                           xtol=1e-15, ftol=1e-15, gtol=1e-12)  # fmt: skip
    plain = np.linalg.lstsq(matrix, -offset)[0]
    found = own.descend(own.start(), 1.0)
    assert found.cost == pytest.approx(2.0 * robust.cost, rel=1e-5)
    assert np.abs(found.point.shared - robust.x[:3]).max() < 0.1 * np.abs(plain[:3] - robust.x[:3]).max()


def test_logarithms_are_varied_and_products_of_powers_set() -> None:
    """Friction of a contact is a square root of a product: an object's is f^2 / s, and clipped to what it may be."""
    pair = (
        shared_unknown(0, scale="log", start=0.3, lower=0.01, upper=2.0, powers=(2.0,)),
        shared_unknown(1, scale="log", start=0.6, lower=0.1, upper=1.0, powers=(-1.0,)),
    )
    tied = [pair[0], type(pair[1])(**{**vars(pair[1]), "paths": pair[0].paths})]
    own = LinearProblem([1], tied)
    values = own.runs[0][0].overrides(np.log([[0.3, 0.6], [0.4, 0.5]]), np.zeros((2, 6)))
    assert values["objects.ball.friction"] == pytest.approx([0.15, 0.32])


def test_what_a_link_leaves_is_its_slack() -> None:
    own = LinearProblem([2], PRIORS, seed=5)
    found = own.fit()
    matrix, offset = own.dense()
    expected = (matrix @ flat(found.point) + offset)[20:26]
    assert own.slacks(found.point, 0) == pytest.approx((float(np.sqrt((expected**2).mean())),), rel=1e-6)
