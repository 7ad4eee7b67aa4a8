"""Fits with steps as short as they have to be, on flights through air that long steps get a little wrong."""

import numpy as np

from polyworld.estimation import profile
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FitContext, FittedHypothesis, refined, step_error
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.noise import measured_noise
from polyworld.world import World
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches

COARSE, OWN = 0.016, 0.002
NOISE = 2e-6  # [m]


def drag(_t: float, _x: np.ndarray, v: np.ndarray, _w: np.ndarray) -> np.ndarray:
    return -0.3 * np.linalg.norm(v) * v


def fitted(ball: Bouncing, *effects: dict[str, object]) -> FittedHypothesis:
    """The complete model, with these effects, fitted with long steps."""
    rng = np.random.default_rng(5)
    data = ball_recording(ball, launches(rng, 3), rng, NOISE, duration=1.0, rate=60.0)
    world = World.model_validate(ball_world().model_dump(mode="json") | {"effects": effects})
    plan = design(world.with_substep(COARSE), data)
    context = FitContext(plan, measured_noise(plan), 1)
    nothing = Hypothesis(plan.world, ())
    return context.fit(nothing, np.zeros(0), profile.start_states(plan), horizons=profile.HORIZONS)


def test_steps_whose_errors_show_are_shortened_until_they_do_not() -> None:
    law = {"name": "drag", "kind": "quadratic_drag", "parameters": {"coefficient": 0.3 * MASS}}
    trial = fitted(Bouncing(acceleration=drag), law)
    assert step_error(trial, OWN) > 20.0
    fine = refined(trial, OWN, OWN)
    assert OWN <= fine.hypothesis.world.time.substep < COARSE
    assert fine.chi2 < trial.chi2
    assert step_error(fine, OWN) < 1.0


def test_steps_that_leave_no_error_are_kept() -> None:
    trial = fitted(Bouncing())  # free flight and its bounces are exact whatever the step
    assert refined(trial, OWN, OWN / 16.0) is trial
