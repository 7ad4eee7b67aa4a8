"""The question programs on scenes made up here, with answers that a reader of the scene gives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks.clevrer_programs import Happening, Known, NotInScene, Thing, answer_choice, causes
from tests.scenes.clevrer_data import Collision, default_folder
from tests.scenes.clevrer_events import score_collisions

QUESTIONS = default_folder() / "questions_matched_scenes_00000_01000.json"
needs_questions = pytest.mark.skipif(not QUESTIONS.exists(), reason=f"no {QUESTIONS.name} beside the repository")


def met(frame: float, *names: str) -> Happening:
    return Happening("collision", frame, frozenset(names))


def enters(frame: float, name: str) -> Happening:
    return Happening("in", frame, frozenset({name}))


def test_causes_follow_the_participants_back_in_time() -> None:
    events = [
        enters(5, "a"),
        met(20, "a", "b"),
        enters(22, "c"),
        met(40, "b", "c"),
        met(50, "a", "d"),
        met(60, "c", "e"),
    ]
    # a met d only after the chain had gone on to b and c.
    assert causes(events[5], events) == [events[0], events[1], events[2], events[3]]
    assert causes(events[1], events) == [events[0]]
    assert causes(events[0], events) == []


def official(number: str) -> list[dict[str, Any]]:
    questions: list[dict[str, Any]] = json.loads(QUESTIONS.read_text())[number]["questions"]
    return questions


@needs_questions
def test_official_question_not_responsible() -> None:
    things = [
        Thing("can", "gray", "rubber", "cylinder"),
        Thing("ball", "red", "metal", "sphere"),
        Thing("dice", "brown", "metal", "cube"),
        Thing("late", "yellow", "rubber", "cube"),
    ]
    # The brown cube comes in and drives the ball into the cylinder; the yellow one comes in and hits nothing.
    events = [enters(3, "dice"), met(20, "dice", "ball"), enters(30, "late"), met(45, "ball", "can")]
    question = official("0")[0]
    for choice in question["choices"]:
        said = answer_choice(question["program"], choice["program"], Known(things, events))
        assert said == (choice["answer"] == "correct"), choice["choice"]


@needs_questions
def test_official_question_responsible() -> None:
    things = [
        Thing("rod", "red", "metal", "cylinder"),
        Thing("leaf", "green", "rubber", "sphere"),
        Thing("pot", "blue", "rubber", "cylinder"),
        Thing("dice", "gray", "metal", "cube"),
    ]
    events = [enters(2, "rod"), met(30, "rod", "pot"), enters(50, "dice"), met(70, "leaf", "rod")]
    question = official("1000")[0]
    for choice in question["choices"]:
        said = answer_choice(question["program"], choice["program"], Known(things, events))
        assert said == (choice["answer"] == "correct"), choice["choice"]


def test_a_question_about_something_absent_is_not_answered() -> None:
    things = [Thing("can", "gray", "rubber", "cylinder")]
    with pytest.raises(NotInScene, match="the scene has 0"):
        answer_choice(["negate"], ["objects", "brown", "filter_color", "unique"], Known(things, []))


def test_an_operation_that_is_not_the_languages_is_named() -> None:
    with pytest.raises(ValueError, match="'filter_size'"):
        answer_choice(["negate"], ["objects", "filter_size"], Known([], []))


def test_an_annotated_collision_matches_one_simulated_one_of_its_pair() -> None:
    truth = [Collision(("a", "b"), 20), Collision(("a", "c"), 60)]
    found = [Collision(("a", "b"), 22), Collision(("a", "b"), 18), Collision(("a", "c"), 64)]
    score = score_collisions(found, truth)
    assert (score.simulated, score.annotated, score.matched) == (3, 2, 1)
    assert score.precision == pytest.approx(1 / 3)
    assert score.recall == pytest.approx(1 / 2)


def test_data_folder_is_beside_the_repository() -> None:
    assert default_folder().parts[-3:] == ("shared", "data", "clevrer")
    assert default_folder().parents[2] == Path(__file__).resolve().parents[3]
