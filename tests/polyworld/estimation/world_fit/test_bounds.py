"""Bounds that exclude the minimum are widened, but not those that were given, nor those that physics sets."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.estimation.world_fit import FitProblem, Start, Unknown, refine, refit_with_wider_bounds
from polyworld.world import World
from tests.polyworld.estimation.world_fit.closed_form import ClosedForm, observe, thrown_ball

VISCOUS = "objects.ball.linear_damping"
SIGMA = 0.002  # [m]
GYRATION = 0.1 * np.sqrt(0.4)  # [m] of the ball: rotations are compared as displacements of its substance


def unknown(path: str, lower: float, upper: float, start: float, scale: str = "linear") -> Unknown:
    return Unknown(path.removeprefix("objects."), (path,), "", start, lower, upper, 0.2 * (upper - lower), scale=scale)


def problem_with(
    *unknowns: Unknown, world: World | None = None, truth: World | None = None
) -> tuple[FitProblem, Start]:
    """A fit to a ball thrown with a damping of 0.5 1/s."""
    problem = FitProblem(
        world or thrown_ball(),
        observe(truth or thrown_ball(), sigma=SIGMA, turn_sigma=SIGMA / GYRATION),
        unknowns,
        make_simulator=ClosedForm,
    )
    return problem, Start(refine(problem))


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_a_range_below_the_truth_is_widened_until_it_holds_it(scale: str) -> None:
    problem, start = problem_with(unknown(VISCOUS, 0.01, 0.1, 0.05, scale))
    assert start.best.by_name["ball.linear_damping"] == pytest.approx(0.1)
    wider, refitted, widened = refit_with_wider_bounds(problem, start)
    (value,) = refitted.best.values
    assert value.value == pytest.approx(0.5, abs=0.01)
    assert not value.at_bound
    assert list(widened) == ["ball.linear_damping"]
    assert widened["ball.linear_damping"][1] == wider.space.unknowns[0].upper > 0.5


def test_a_range_above_the_truth_is_widened_downwards() -> None:
    problem, start = problem_with(unknown(VISCOUS, 0.7, 0.9, 0.8))
    _, refitted, widened = refit_with_wider_bounds(problem, start)
    assert refitted.best.by_name["ball.linear_damping"] == pytest.approx(0.5, abs=0.01)
    assert widened["ball.linear_damping"][0] < 0.5


def test_bounds_that_were_given_stay() -> None:
    problem, start = problem_with(unknown(VISCOUS, 0.0, 0.1, 0.05))
    same, kept, widened = refit_with_wider_bounds(problem, start, keep={VISCOUS})
    assert (same, kept, widened) == (problem, start, {})


def test_a_minimum_inside_its_bounds_leaves_them() -> None:
    problem, start = problem_with(unknown(VISCOUS, 0.0, 1.0, 0.2))
    assert refit_with_wider_bounds(problem, start)[2] == {}


def test_a_rate_of_damping_is_not_widened_below_zero() -> None:
    """Nothing slows the ball, and the thrown one that is fitted has more speed than its track: it wants a thrust."""
    truth = thrown_ball(linear_damping=0.0, velocity=(2.2, 1.1, 3.0))
    problem, start = problem_with(unknown(VISCOUS, 0.0, 1.0, 0.5), truth=truth)
    assert start.best.by_name["ball.linear_damping"] == pytest.approx(0.0, abs=1e-6)
    assert refit_with_wider_bounds(problem, start)[2] == {}


def test_two_ranges_are_widened_together_and_named() -> None:
    problem, start = problem_with(
        unknown(VISCOUS, 0.0, 0.1, 0.05),
        unknown("objects.ball.velocity.x", 0.0, 1.5, 1.0),
        unknown("objects.ball.velocity.y", 0.0, 3.0, 1.0),
    )
    _, refitted, widened = refit_with_wider_bounds(problem, start)
    assert set(widened) == {"ball.linear_damping", "ball.velocity.x"}
    found = refitted.best.by_name
    assert np.array([found["ball.linear_damping"], found["ball.velocity.x"]]) == pytest.approx([0.5, 2.0], abs=0.02)
    assert refitted.best.loss == pytest.approx(1.0, abs=0.3)  # noise alone


def test_a_cancelled_fit_keeps_its_bounds() -> None:
    problem, start = problem_with(unknown(VISCOUS, 0.0, 0.1, 0.05))
    assert refit_with_wider_bounds(problem, start, cancelled=lambda: True) == (problem, start, {})
