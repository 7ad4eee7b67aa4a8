"""The short forms of gap results have the form declared, also where single tool calls seldom lead."""

from __future__ import annotations

import pytest

from atw_mcp.gap.shown import next_step, shown_discrepancy, shown_proposals
from atw_mcp.results.discrepancy import DecidingExperiment, FoundDiscrepancy, ProposedEffects
from tests.atw_mcp.gap.outcomes import experiment, result

CONTEXT = {"recording": "o1", "sealed_data": "nothing sealed", "next": "an experiment"}


def test_an_ambiguous_verdict_has_the_form_declared() -> None:
    document = result("ambiguous", experiment=experiment(9.0))
    read = ProposedEffects.model_validate(shown_proposals(document) | CONTEXT)
    assert isinstance(read.experiment, DecidingExperiment)
    assert [p.effects[0].unknowns["c"].interval95 for p in read.proposals] == [[0.09, None], [0.09, 0.11]]
    assert all(p.effects[0].same_as == ["wind"] for p in read.proposals)
    assert read.proposals[1].behind is None
    assert read.runner_up == "tilt ball (c 0.1 kg/s), error 1.1, 12 nats behind"
    assert "experiment described" in next_step("c", document)


def test_a_residual_force_has_the_form_declared_and_can_be_added() -> None:
    number = {"value": 0.25, "unit": "1/m", "interval95": [0.2, 0.3]}
    force = {
        "explains": True,
        "summary": "the force left grows with the speed",
        "expression": "-k*speed*v",
        "written": "-0.25[1/m]*speed*v",
        "numbers": {"k": number},
        "direction": ["against the velocity"],
        "speed_exponent": [],
        "depends_on": ["speed"],
        "chi2_before": None,
        "chi2_after": 310.0,
        "data": 300,
        "complete": True,
        "beside": [],
        "alternatives": [{"expression": "-k*v", "behind": 14.0}],
    }
    document = result("unexplained", residual_force=force, proposals=[])
    read = ProposedEffects.model_validate(shown_proposals(document) | CONTEXT)
    assert read.residual_force is not None
    assert read.residual_force.alternatives[0].behind == 14.0
    assert "'expression': '-k*speed*v', 'parameters': {'k': 0.25}" in next_step("c", document)


@pytest.mark.parametrize("explained", [True, False])
def test_a_discrepancy_has_the_form_declared(explained: bool) -> None:
    levels = [{"level": r, "ratio": 9.0, "error": 0.1, "share": 0.5, "samples": 60} for r in ("r0", "r1")]
    document = {
        "explained": explained,
        "error": 3.4,
        "gap": 0.01,
        "noise": 0.001,
        "unit": "m",
        "worst": [{"run": "r0", "name": "ball", "kind": "position", "axis": "x", "error": 9.0}],
        "where": {"factors": {"run": levels, "object": levels[:1]}, "onsets": [], "summary": ""},
        "kinks": [{"run": "r0", "name": "ball", "time": 0.4, "change": 5.0, "sigmas": 30.0}],
        "base": [{"name": "g", "paths": ["environment.gravity.z"], "value": -9.8, "unit": "m/s^2"}],
        "cautions": [],
        "power": [{"effect": "wind", "seen": True, "summary": ""}, {"effect": "fan", "seen": False, "summary": "fan"}],
    }
    read = FoundDiscrepancy.model_validate(shown_discrepancy(document) | CONTEXT)
    assert read.share_of_gap == ({} if explained else {"run": {"r0": 0.5, "r1": 0.5}})
    assert read.kinks == ["ball in run r0 at 0.4 s by 5 m/s, 30 standard deviations"]
    assert (read.could_have_been_missed, read.would_have_been_seen) == (["fan"], ["wind"])
