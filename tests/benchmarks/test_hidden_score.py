"""The scorer's judgement of verdicts: what is right, wrong, covered."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.benchmarks.hidden_cases import SECTIONS
from tests.benchmarks.hidden_generate import generate
from tests.benchmarks.hidden_report import wilson
from tests.benchmarks.hidden_score import closed_shares, form_is_right, judge_names, place_overlaps


def verdict(kind: str, *sets: list[str]) -> dict[str, object]:
    """Return a verdict with a credible set."""
    return {"verdict": kind, "credible_set": list(sets), "effects": [{"name": n} for n in (sets[0] if sets else [])]}


def test_one_name_of_the_class_is_right() -> None:
    report = verdict("identified", ["observer_scale"])
    assert judge_names(report, [["buoyancy"]], "one_effect") == (True, False, True, 1)


def test_several_names_of_one_class_count_as_one() -> None:
    report = verdict("ambiguous", ["observer_scale"], ["gravity_error"])
    assert judge_names(report, [["buoyancy"]], "one_effect") == (True, False, True, 1)
    assert judge_names(report, [["tilt"]], "one_effect") == (False, True, False, 1)


def test_two_classes_cover_but_are_not_right() -> None:
    report = verdict("ambiguous", ["linear_drag"], ["quadratic_drag"])
    assert judge_names(report, [["quadratic_drag"]], "one_effect") == (False, False, True, 2)


def test_half_of_a_pair_is_decisively_wrong() -> None:
    assert judge_names(verdict("identified", ["tilt"]), [["tilt", "fan"]], "two_effects") == (False, True, False, 1)


def test_classes_depend_on_the_scene() -> None:
    report = verdict("identified", ["viscous_friction"])
    assert judge_names(report, [["linear_drag"]], "bodies")[0]
    assert not judge_names(report, [["linear_drag"]], "one_effect")[0]


def test_refusal_covers_nothing_and_is_not_wrong() -> None:
    assert judge_names(verdict("unexplained"), [["tilt"]], "one_effect") == (False, False, False, 0)
    assert judge_names(verdict("nothing_missing"), [], "nothing") == (True, False, False, 0)


def test_held_out_gap_is_reported_with_and_without_the_noise() -> None:
    report = {"sealed": {"gap_before": 0.04, "gap_after": 0.01, "noise_floor": 0.03}}
    assert closed_shares(report) == (pytest.approx(0.75), pytest.approx(1.0 - 0.001**0.5 / 0.05))
    assert closed_shares({"sealed": {"gap_before": 0.0, "gap_after": 0.0, "noise_floor": 0.03}}) == (None, None)


def test_form_needs_direction_and_exponent() -> None:
    form = {"exponent": 1.5, "direction": "along the velocity", "expression": ""}
    force = {"direction": ["along the velocity"], "speed_exponent": [{"value": 1.6, "interval95": [1.5, 1.7]}]}
    assert form_is_right(form, {"residual_force": force})
    assert not form_is_right(form | {"exponent": 3.0}, {"residual_force": force})
    assert not form_is_right(form | {"direction": "component"}, {"residual_force": force})


def test_wall_overlaps_where_it_stands_turned() -> None:
    place = {"normal_x": 0.0, "normal_y": 1.0, "offset": -1.0}
    half = 0.5**0.5
    static = {"name": "w", "shape": {"kind": "plane", "normal": [1.0, 0.0, 0.0], "offset": 0.0}}
    static |= {"position": [0.0, -1.05, 0.0], "orientation": [half, 0.0, 0.0, half]}
    report = {"effects": [{"name": "hidden_wall", "unknowns": {}}], "world": {"statics": [static]}}
    truth = [{"name": "hidden_wall", "place": place}]
    assert place_overlaps(truth, report) is True
    static["position"] = [0.0, -1.5, 0.0]
    assert place_overlaps(truth, report) is False


def test_wilson_interval_of_no_alarm_in_three_hundred() -> None:
    low, high = wilson(0, 300)
    assert low == 0.0
    assert high == pytest.approx(0.01264, abs=2e-5)


def test_generator_writes_the_same_case_again_and_keeps_the_truth_apart(tmp_path: Path) -> None:
    case = next(c for c in SECTIONS["one_effect"](1) if c.effects == ("tilt",) and c.noise == 0.01)
    for n in "ab":
        generate(case, 1, tmp_path / n, tmp_path / f"{n}truth")
    a, b = tmp_path / "a", tmp_path / "b"
    assert sorted(p.name for p in a.iterdir()) == ["data.csv", "sealed.csv", "world.json"]
    assert all((a / p.name).read_bytes() == p.read_bytes() for p in b.iterdir())
    truth = json.loads((tmp_path / "atruth" / "truth.json").read_text())
    assert truth["effects"][0]["name"] == "tilt"
    assert "tilt" not in (a / "world.json").read_text()
