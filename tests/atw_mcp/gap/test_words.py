"""The experiment that would decide, in words: only one that can is described."""

from typing import Any

import pytest

from atw_mcp.gap.words import experiment_text


def experiment(sigmas: float) -> dict[str, Any]:
    return {
        "object": "ball",
        "position": [0.0, 0.0, 0.1],
        "velocity": [2.0, 0.0, 0.0],
        "angular_velocity": [0.0, 0.0, 0.0],
        "duration": 1.0,
        "interval": 0.01,
        "watch": "ball.x at 1 s",
        "forecasts": {"linear_drag": 1.2, "viscous_friction": 1.4},
        "separations": [{"first": ["linear_drag"], "second": ["viscous_friction"], "sigmas": sigmas}],
        "decides": sigmas >= 5.0,
    }


def test_an_experiment_that_decides_is_described_with_what_to_expect() -> None:
    text = experiment_text(experiment(9.0))
    assert text.startswith("To decide: start ball")
    assert "1.4 if viscous_friction" in text


@pytest.mark.parametrize("sigmas", [0.0, 0.4])
def test_laws_that_are_the_same_motion_get_no_experiment(sigmas: float) -> None:
    text = experiment_text(experiment(sigmas))
    assert "No start of one object was found" in text
    assert "linear_drag from viscous_friction" in text
    assert "start ball" not in text


def test_one_that_may_not_decide_is_described_as_such() -> None:
    assert "may not decide" in experiment_text(experiment(2.0))
