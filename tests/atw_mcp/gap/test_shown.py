"""The short forms of gap results have the form declared, also where single tool calls seldom lead."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from atw_mcp.gap.shown import shown_proposals
from atw_mcp.results.discrepancy import DecidingExperiment, ProposedEffects, StabilityOverRuns
from polyworld.estimation.criteria import held_out_gain
from polyworld.gap.decide import Stability
from polyworld.gap.model_error import ModelError
from polyworld.gap.report import _stability, finite


@pytest.fixture
def stability() -> dict[str, Any]:
    """The comparison over the subsets of one run, whose standard error is unknown."""
    error = ModelError(None, None, {"position": np.full(12, 26.0)}, {"position": 2.0})  # type: ignore[arg-type]
    gain = held_out_gain(np.array([1.0]), np.array([5.0]))
    found = Stability(None, error, {"drag": 0.9}, (("wind",),), gain, 12.0, ("too few runs",))  # type: ignore[arg-type]
    plain: dict[str, Any] = finite(_stability(found))
    return plain


def test_a_comparison_with_model_error_has_the_form_declared(stability: dict[str, Any]) -> None:
    shown = StabilityOverRuns.model_validate(stability)
    assert shown.model_error == {"position": 5.0}
    assert shown.held_out_error is None


def test_an_ambiguous_verdict_has_the_form_declared(stability: dict[str, Any]) -> None:
    experiment = {
        "object": "ball",
        "position": [0.0, 0.0, 0.1],
        "velocity": [2.0, 0.0, 0.0],
        "angular_velocity": [0.0, 0.0, 0.0],
        "duration": 1.0,
        "interval": 0.01,
        "watch": "ball.x at 1 s",
        "forecasts": {"linear_drag": 1.2, "viscous_friction": 1.4},
        "separations": [{"first": ["linear_drag"], "second": ["viscous_friction"], "sigmas": 9.0}],
        "decides": True,
    }
    number = {"value": 0.1, "unit": "kg/s", "interval95": [0.09, None], "paths": ["effects.linear_drag.coefficient"]}
    effect = {"name": "linear_drag", "label": "ball", "law": "F = -c v", "same_as": ["viscous_friction"]}
    document = {
        "verdict": "ambiguous",
        "proposals": [
            {"title": t, "passes": True, "ebic_behind": 0.0, "effects": [effect | {"unknowns": {"c": n}}]}
            for t, n in (("linear_drag", number), ("viscous_friction", number | {"interval95": None}))
        ],
        "runner_up": None,
        "goodness": {"summary": "the fit explains the data."},
        "noise": {"summary": "noise: ball position 0.001 m."},
        "base": {"unknowns": {}},
        "null_control": {"verdict": "nothing_missing"},
        "set_aside": [],
        "plain_laws": [],
        "remainder": {"summary": "nothing"},
        "checks": [{"check": "runner_up", "found": "another comes near"}],
        "stability": stability,
        "time_limit": 60.0,
        "other_forms": ["linear_drag of ball"],
        "near_misses": [],
        "experiment": experiment,
        "residual_force": None,
    }
    shown = shown_proposals(document) | {"recording": "o1", "sealed_data": "nothing sealed", "next": "an experiment"}
    read = ProposedEffects.model_validate(shown)
    assert isinstance(read.experiment, DecidingExperiment)
    numbers = [p.effects[0].unknowns["c"] for p in read.proposals]
    assert [n.interval95 for n in numbers] == [[0.09, None], None]
    assert all(p.effects[0].same_as == ["viscous_friction"] for p in read.proposals)
