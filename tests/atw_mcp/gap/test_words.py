"""Verdicts in words, and the experiment that would decide: only one that can is described."""

from typing import Any

import pytest

from atw_mcp.gap.words import experiment_text, sealed_text, verdict_text
from tests.atw_mcp.gap.outcomes import experiment, result


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


def test_a_verdict_is_put_in_words_with_its_evidence() -> None:
    text = verdict_text(result("identified"))
    assert text.startswith(
        "identified: linear_drag ball (c 0.1 kg/s, 95% 0.09 to unbounded; indistinguishable from wind)"
    )
    for sentence in (
        "unknown standard deviations of the noise without an effect, 1.1 with it.",
        "Chosen in bootstraps over runs: linear_drag 60%, viscous_friction 40%.",
        "Next best: tilt ball (c 0.1 kg/s), error 1.1, 12 nats behind.",
        "ended after 60 s",
        "run r2 was set aside",
        "CAUTION: z was never measured",
    ):
        assert sentence in text


@pytest.mark.parametrize(
    ("kind", "parts", "expected"),
    [
        ("ambiguous", {"experiment": experiment(9.0)}, "linear_drag; viscous_friction. Nearest: linear_drag ball"),
        ("unexplained", {"reasons": ["too little"]}, "no effect may be named; nearest: linear_drag ball"),
        ("unexplained", {"reasons": ["too little"]}, "Why: too little."),
        ("unexplained", {"effects": []}, "unexplained: no effect may be named. Error of predicting"),
        ("nothing_missing", {"effects": []}, "data left out: 1.1 standard deviations of the noise."),
    ],
)
def test_a_verdict_that_names_nothing_says_so(kind: str, parts: dict[str, Any], expected: str) -> None:
    assert expected in verdict_text(result(kind, **parts))


def test_sealed_data_without_an_effect_are_judged_by_themselves() -> None:
    gap = {"before": 1.02, "gap_before": 0.01, "gap_after": 0.001, "noise_floor": 0.002, "unit": "m", "closed": 0.9}
    document = result("nothing_missing", effects=[], sealed=gap, sealed_data="sealed runs ['r3']")
    assert sealed_text(document) == "sealed runs ['r3']: predicted to 1.02 standard deviations of the noise"
    document = result("identified", sealed=gap, sealed_data="sealed runs ['r3']")
    assert sealed_text(document).endswith("gap 0.01 m before, 0.001 after, 90% closed; noise 0.002 m")
    assert sealed_text(result("identified", sealed=None, sealed_data="nothing sealed")) == "nothing sealed"
