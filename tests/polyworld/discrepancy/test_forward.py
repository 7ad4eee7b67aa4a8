"""The forward model on runs that are seen to turn late."""

from dataclasses import replace

import numpy as np

from polyworld.discrepancy.design import design
from polyworld.discrepancy.forward import Forward, Settings
from polyworld.recording import Recording
from tests.polyworld.discrepancy.scenes import Bouncing, ball_recording, ball_world, launches


def test_turns_that_are_seen_late_are_none_before() -> None:
    rng = np.random.default_rng(8)
    late = []
    for run in ball_recording(Bouncing(), launches(rng, 4), rng, 0.001).runs:
        turns = np.full_like(run.orientations, np.nan)
        turns[len(run.times) // 2 :] = (1.0, 0.0, 0.0, 0.0)
        late.append(replace(run, orientations=turns))
    plan = design(ball_world(), Recording(tuple(late)))
    settings = [Settings(r.index, np.zeros((3, 0)), np.repeat(r.start[None], 3, axis=0)) for r in plan.runs]
    forward = Forward(plan, plan.world, ())
    for early, whole in zip(forward.residuals(settings, 0.35), forward.residuals(settings), strict=True):
        assert early.shape == whole.shape
        assert np.isfinite(early).all()
