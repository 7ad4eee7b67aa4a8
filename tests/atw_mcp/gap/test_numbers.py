"""Numbers behind the pictures of a gap: what they are of turns, and that a record gives them back."""

from dataclasses import fields, replace

import numpy as np

from atw_mcp.gap.numbers import GapNumbers, Residuals, compared_trial, residuals_of
from atw_mcp.gap.pictures import residual_picture
from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.gap.examine import fitted_base
from polyworld.gap.segment_jumps import SegmentJump
from tests.polyworld.gap_scenes import puck_world

COUNT, STEP, NOISE = 60, 0.02, 0.01  # samples, [s], [rad]


def test_residuals_of_turns_are_those_of_a_steady_spin() -> None:
    times = np.arange(COUNT) * STEP
    angle = 1.5 * times + np.random.default_rng(3).normal(scale=NOISE, size=COUNT)
    turned = np.zeros((COUNT, 1, 4))
    turned[:, 0, 0], turned[:, 0, 3] = np.cos(angle / 2), np.sin(angle / 2)
    places = np.random.default_rng(4).normal(scale=1e-3, size=(COUNT, 1, 3))
    run = Run("r", ("puck",), 7.0 + times, places, turned)
    trial = fitted_base(design(puck_world(friction=0.0), Recording((run,))), ())
    seen = compared_trial(trial)
    position, rotation = residuals_of(trial, seen, None, {"r": ("r", 7.0)})
    assert (position.kind, rotation.kind) == ("position", "rotation")
    np.testing.assert_allclose(rotation.times, times, atol=1e-9)
    assert np.isnan(rotation.residual_before[:, :2]).all()  # a disc on a table turns about z alone
    (sigma,) = {level["sigma"] for level in trial.context.noise.to_json()["levels"] if level["kind"] == "rotation"}
    simulated = rotation.residual_before[:, 2] * sigma + angle
    np.testing.assert_allclose(np.diff(simulated, 2), 0.0, atol=1e-6)  # nothing brakes it
    assert residual_picture(seen) != residual_picture([replace(item, turning={}) for item in seen])


def test_a_record_gives_back_what_was_kept() -> None:
    rng = np.random.default_rng(0)
    series = tuple(
        Residuals(run, "puck", kind, held_out, rng.normal(size=n), *(rng.normal(size=(n, 3)) for _ in range(5)))
        for run, kind, held_out, n in (
            ("a", "position", False, 20),
            ("a", "rotation", False, 20),
            ("b", "spin", True, 3),
        )
    )
    series[0].observed[4] = np.nan
    jump = SegmentJump("b", "puck", 0.2, np.array([1.0, 2.0, np.nan]), np.array([0.5, 0.0, np.nan]), 0.1)
    for kept in (GapNumbers(series, (jump,)), GapNumbers(series, ()), GapNumbers(series), GapNumbers(())):
        again = GapNumbers.of_record(*kept.to_record())
        assert (again.jumps is None) == (kept.jumps is None)
        found, expected = [*again.residuals, *(again.jumps or ())], [*kept.residuals, *(kept.jumps or ())]
        for one, other in zip(found, expected, strict=True):
            for item in fields(one):
                value, was = getattr(one, item.name), getattr(other, item.name)
                if isinstance(was, str | bool):
                    assert value == was
                else:
                    np.testing.assert_allclose(value, was, rtol=1e-6)
