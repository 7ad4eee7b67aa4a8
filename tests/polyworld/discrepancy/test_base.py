"""The base fit: far off at first and not in the end, far off and left, and runs that are seen to turn late."""

from dataclasses import replace

import numpy as np

from polyworld.discrepancy.candidate import Unknown
from polyworld.discrepancy.design import design
from polyworld.discrepancy.examine import FAR_OFF, fitted_base
from polyworld.discrepancy.forward import Forward, Settings
from polyworld.recording import Recording
from tests.polyworld.discrepancy.scenes import Bouncing, ball_recording, ball_world, launches

GRAVITY = Unknown("gravity_z", ("environment.gravity.z",), "m/s^2", -4.0, -30.0, -1.0, 1.0)


def seen(sigma: float) -> Recording:
    rng = np.random.default_rng(8)
    return ball_recording(Bouncing(), launches(rng, 4), rng, sigma)


def test_a_base_that_begins_far_off_is_fitted_to_the_end() -> None:
    plan = design(ball_world(), seen(2e-5))
    found = fitted_base(plan, (GRAVITY,))
    assert abs(found.values[0] + 9.81) < 1e-3


def test_a_base_that_stays_far_off_is_left_there() -> None:
    plan = design(ball_world(restitution=0.5), seen(2e-5))
    found = fitted_base(plan, ())
    assert found.chi2 > FAR_OFF * found.bench.observations
    assert not found.passes


def test_turns_that_are_seen_late_are_none_before() -> None:
    recording = seen(0.001)
    late = []
    for run in recording.runs:
        turns = run.orientations.copy()
        turns[: len(run.times) // 2] = np.nan
        late.append(replace(run, orientations=turns))
    plan = design(ball_world(), Recording(tuple(late)))
    settings = [Settings(r.index, np.zeros((3, 0)), np.repeat(r.start[None], 3, axis=0)) for r in plan.runs]
    forward = Forward(plan, plan.world, ())
    for early, whole in zip(forward.residuals(settings, 0.35), forward.residuals(settings), strict=True):
        assert early.shape == whole.shape
        assert np.isfinite(early).all()
