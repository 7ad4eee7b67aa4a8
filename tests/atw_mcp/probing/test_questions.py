"""Questions by themselves: from when on they can be asked, and how a list of numbers is read."""

from __future__ import annotations

from atw_mcp.probing.questions import Asked, Whether, scanned
from polyworld.probing.predicates import Collides, Holds
from tests.verification.planar_scenes import body, disc, top_view


def test_a_question_begins_when_the_last_of_its_objects_enters() -> None:
    world = top_view(body("one", disc(), (0.0, 0.0, 0.2)), body("late", disc(), (1.0, 0.0, 0.2), start_time=0.5))
    meet = (Collides(a="one", b="late"),)
    asked = [([0.0, 2.0], ("late", 0.5)), ([0.0, 0.4], None), ([0.5, 2.0], None), (None, None)]
    for interval, expected in asked:
        assert Asked(Whether(predicate={}, interval=interval), meet).enters(world) == expected
    nobody = (Holds(container="bowl", amount=0.1),)
    assert Asked(Whether(predicate={}, interval=[0.0, 2.0]), nobody).enters(world) is None


def test_a_list_of_numbers_makes_a_question_of_each_and_other_lists_none() -> None:
    move = {"action": "move", "object": "one", "position": [0.0, 0.0, 1.0]}
    slow = {"action": "scale_velocity", "object": "one", "factor": [0.5, 2.0]}
    plain = {"ask": "where", "object": "one", "edits": [move]}
    assert scanned(plain, "question 1") == [plain]
    read = scanned({**plain, "edits": [move, slow]}, "question 1")
    assert [question["edits"] for question in read] == [[move, {**slow, "factor": factor}] for factor in (0.5, 2.0)]
