"""What is right, honest, missed, uncovered and wrong; places; cases that come again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.world import World
from tests.benchmarks.first_generator.cases import alike
from tests.benchmarks.gaps import hidden
from tests.benchmarks.gaps.case import NEEDED, NOTHING, Case, Names, ball, noncentrality, one_body
from tests.benchmarks.gaps.place import overlap
from tests.benchmarks.gaps.score import outcome, table

Recorded = tuple[str, ...]


def case(*truths: Recorded, section: str = "one_effect", **more: Any) -> Case:
    """Return a case of which the key alone matters."""
    world, sets = ball(0.05, 0.1, 60.0, None), tuple(Names(t) for t in truths)
    recording = Recording((one_body("run", np.arange(2.0), np.zeros((2, 3))),))
    return Case("case", world, recording, sets, alike=alike(section), **more)


def scored(kind: str, of: Case, *answers: Recorded, equivalent: tuple[Recorded, ...] = ()) -> str:
    """Return the outcome of a verdict."""
    return outcome(of, kind, [Names(a) for a in answers], [Names(e) for e in equivalent])


def test_one_name_of_the_class_is_right_whether_or_not_others_of_it_compete() -> None:
    buoyancy, tilt = case(("buoyancy",)), case(("tilt",))
    assert scored("identified", buoyancy, ("observer_scale",)) == "right"
    assert scored("ambiguous", buoyancy, ("observer_scale",), ("gravity_error",)) == "right"
    assert scored("ambiguous", tilt, ("observer_scale",), ("gravity_error",)) == "wrong"


def test_classes_depend_on_the_scene() -> None:
    drag = ("linear_drag",)
    assert scored("identified", case(drag, section="bodies"), ("viscous_friction",)) == "right"
    assert scored("identified", case(drag), ("viscous_friction",)) == "wrong"


def test_half_of_a_pair_is_wrong_with_a_remainder_too() -> None:
    pair = case(("tilt", "fan"))
    assert scored("identified", pair, ("tilt",)) == "wrong"
    assert scored("identified_with_remainder", pair, ("tilt",)) == "wrong"
    assert scored("identified_with_remainder", pair, ("tilt", "fan")) == "right"
    faint = case(("tilt", "fan"), noncentrality=0.5 * NEEDED)
    assert scored("identified", faint, ("tilt",)) == "honest"
    assert scored("identified", faint, ("spring",)) == "wrong"


def test_truth_among_several_answers_is_honest_and_none_of_them_uncovered() -> None:
    answers = ("linear_drag",), ("quadratic_drag",)
    assert scored("ambiguous", case(("quadratic_drag",)), *answers) == "honest"
    assert scored("ambiguous", case(("fan",)), *answers) == "uncovered"
    assert scored("identified", case(("spring",)), ("tilt",), equivalent=(("spring",),)) == "honest"


def test_alarms_about_nothing_are_not_honest() -> None:
    nothing = case(())
    assert nothing.truths == NOTHING
    assert scored("nothing_missing", nothing, ()) == "right"
    assert scored("unexplained", nothing, ()) == "uncovered"
    assert scored("identified", nothing, ("tilt",)) == "wrong"
    assert scored("ambiguous", nothing, ("tilt",), ("fan",)) == "uncovered"


def test_refusal_is_honest_and_right_of_a_law_outside_the_catalogue() -> None:
    assert scored("unexplained", case(("tilt",)), ("fan",)) == "honest"
    unknown = case(("magnus_lift",), outside=True)
    assert scored("unexplained", unknown, ()) == "right"
    assert scored("identified", unknown, ("magnus_lift",)) == "right"
    assert scored("identified", unknown, ("quadratic_drag",)) == "wrong"


def test_nothing_missing_is_a_miss_from_where_an_effect_stands_out_of_the_noise() -> None:
    weak, seen = (case(("tilt",), noncentrality=f * NEEDED) for f in (0.5, 1.0))
    assert scored("nothing_missing", weak, ()) == "honest"
    assert scored("nothing_missing", seen, ()) == "missed"
    assert scored("identified", weak, ("fan",)) == "wrong"


def test_noncentrality_is_the_squared_length_of_white_displacements() -> None:
    moved = np.random.default_rng(0).normal(size=(50, 3))
    size = np.sqrt(np.mean((moved**2).sum(axis=1)))
    assert noncentrality(size, 50) == pytest.approx((moved**2).sum())
    assert noncentrality(size, 50, 0.5) == pytest.approx((moved**2).sum() / 3.0)


def test_a_wall_overlaps_the_true_one_where_it_stands_turned() -> None:
    true = {"hidden_wall": {"normal_x": 0.0, "normal_y": 1.0, "offset": -1.0}}
    found = [{"name": "hidden_wall", "unknowns": {}}]
    for y, near in ((-1.05, True), (-1.5, False)):
        static = {"name": "w", "shape": {"kind": "plane", "normal": [1.0, 0.0, 0.0]}, "position": [0.0, y, 0.0]}
        static["orientation"] = [0.5**0.5, 0.0, 0.0, 0.5**0.5]
        fields = ball(0.05, 0.1, 60.0, None).model_dump() | {"statics": [static]}
        assert overlap(true, found, World.model_validate(fields)) == {"hidden_wall": near}


def test_counts_are_by_set_and_level() -> None:
    row = {"set": "third", "asked": 0.01, "outcome": "right", "seconds": 3.0, "inside": {"a": True, "b": False}}
    (line,) = table([row, row | {"outcome": "wrong", "inside": {}, "detectable": False}])
    assert (line["cases"], line["right"], line["wrong"], line["undetectable"], line["inside"]) == (2, 1, 1, 1, "1/2")


def test_hidden_cases_come_again_and_their_worlds_do_not_hold_the_truth() -> None:
    index = hidden.listed().index("one_effect tilt")
    a, b = (hidden.drawn(index, 0.01, 1) for _ in range(2))
    assert a.truths == (Names(("tilt",)),)
    assert a.detectable
    assert np.array_equal(a.recording.runs[0].positions, b.recording.runs[0].positions, equal_nan=True)
    assert "tilt" not in a.world.model_dump_json()
