"""The page states how well a world follows its data, and what an ensemble says of the statements of an answer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from atw_mcp.viewer.following import chances, followings
from evidence_store import Evidence, EvidenceStore


def test_worse_of_two_verdicts_and_probabilities_of_members(tmp_path: Path) -> None:
    store = EvidenceStore(tmp_path / "atw.db")
    store.cases.add("ball", content="described", kind="data", path="", facts={})

    def add(tool: str, **data: Any) -> str:
        return store.evidence.add(Evidence(tool, {}, case="ball", payload={"data": data})).id

    add("FitWorld", world="a", verdict="good", why="", warnings=[], accuracy={"position_rmse": 0.01}, held_out=None)
    fit = add("FitWorld", world="b", verdict="poor", why="off", warnings=[], accuracy=None, held_out=None)
    video = add("ModelVideo", world="a", verdict="poor", doubts=["the ball is 0.13 m off"])
    add("ModelVideo", world="b", verdict="doubtful", doubts=[])
    found = followings(store, "ball")
    assert (found["a"].verdict, found["a"].rms, found["a"].evidence) == ("poor", 0.01, video)
    assert found["a"].doubts == ["the ball is 0.13 m off"]
    assert (found["b"].verdict, found["b"].rms, found["b"].evidence) == ("poor", None, fit)
    store.close()


def test_answers_of_ask_are_shown_with_their_probability(tmp_path: Path) -> None:
    """Ask keeps a record of each answer and one of all; places have no probability."""
    store = EvidenceStore(tmp_path / "atw.db")
    store.cases.add("c", content="x", kind="data", path="", facts={})
    yes = {"question": "whether collides red_cube blue", "answer": "probability 0.8", "probability": 0.8}
    place = {"question": "where red_cube at 2 s", "answer": "x 1 m", "place": {"x": {"median": 1.0}}}
    one = store.evidence.add(Evidence("Ask", {}, case="c", payload={"data": yes})).id
    both = store.evidence.add(Evidence("Ask", {}, case="c", payload={"data": {"answers": [yes, place]}})).id
    found = chances(store, [one, both])
    assert [(c.evidence, c.statement, c.probability) for c in found] == [
        (one, "collides red cube blue", 0.8),
        (both, "collides red cube blue", 0.8),
    ]
