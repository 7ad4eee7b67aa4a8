"""Answers of an ensemble through the tools, on a block that slides to rest: what it does is known in closed form."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.atw_mcp.clips import write_tracks
from tests.atw_mcp.session import Session
from tests.polyworld.estimation.floor_scenes import frames, thrown, tracks_of
from tests.polyworld.sliding_block import block_places, stopping_distance

FRICTION, SPEED, SIGMA = 0.2, 1.0, 0.003


def beyond(x: float) -> dict[str, Any]:
    return {"predicate": "inside_region", "object": "block", "lower": [x, -1, -1], "upper": [9, 1, 1]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ensembles")


@pytest.fixture(scope="module")
def fit(folder: Path) -> dict[str, Any]:
    """A committed case: 10 frames of the block, which stops long after them, with noise of SIGMA."""
    session, path, rng = Session(folder / "atw.db"), folder / "slide.csv", np.random.default_rng(8)
    places = block_places(FRICTION, SPEED, 10)
    places[:, :2] += SIGMA * rng.normal(size=(10, 2))
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "object", "x", "y", "z"])
        writer.writerows([0.04 * k, "block", *place] for k, place in enumerate(places.tolist()))
    session("OpenCase", data=str(path), name="slide")
    session("ImportObservation", case="slide", kind="tracks", path=str(path), position_sigma=SIGMA)
    session("BuildWorld", case="slide", default_shape={"kind": "box", "half_extents": [0.05, 0.05, 0.05]})
    fitted = session("FitWorld", case="slide", patience_seconds=300)
    session("CommitWorld", case="slide", world=fitted["data"]["world"])
    return fitted


@pytest.fixture
def session(folder: Path, fit: dict[str, Any]) -> Session:
    """Another server on the same store: the sample is not in the memory of the one that fitted."""
    assert fit["data"]["ensemble"]["members"] == 64
    return Session(folder / "atw.db")


@pytest.fixture
def rollout(session: Session) -> str:
    return str(session("Rollout", case="slide", horizon_seconds=2.0)["source"]["rollout"])


def test_what_was_fitted_says_what_the_sample_draws_from_priors(fit: dict[str, Any]) -> None:
    prior = {value["name"] for value in fit["data"]["values"] if value["from_prior"]}
    assert "restitution of block" in prior
    assert "friction of block" not in prior


def asked(session: Session, *statements: dict[str, Any], **fields: Any) -> list[dict[str, Any]]:
    """The whole answers of Ask to whether statements hold by 2 s."""
    questions = [{"ask": "whether", "predicate": statement, **fields} for statement in statements]
    made = session("Ask", case="slide", questions=questions, horizon_seconds=2.0)
    rows: list[dict[str, Any]] = session("ReadEvidence", evidence=made["evidence"], detail="full")["data"]["answers"]
    return rows


def test_a_line_far_ahead_and_one_far_behind_are_certain_and_one_at_the_stop_is_not(session: Session) -> None:
    stop = stopping_distance(FRICTION, SPEED)
    shares = [row["probability"] for row in asked(session, *(beyond(x) for x in (0.6 * stop, stop, 1.6 * stop)))]
    assert shares[0] > 0.99
    assert 0.02 < shares[1] < 0.98
    assert shares[2] < 0.01


def test_the_answer_names_what_decides_it(session: Session) -> None:
    """All members start at 0 with 1 m/s in this branch: which of them pass x is a matter of friction, 1 / (2 g x)."""
    edits = [
        {"action": "set_velocity", "object": "block", "velocity": [1.0, 0.0, 0.0]},
        {"action": "move", "object": "block", "position": [0.0, 0.0, 0.05]},
    ]
    branch = session("Rollout", case="slide", horizon_seconds=2.0, edits=edits, ensemble=64)
    median = branch["data"]["ensemble"]["ends"][0]["position_90%"]["median"][0]
    (about,) = asked(session, beyond(median), edits=edits)
    assert about["probability"] == pytest.approx(0.5, abs=0.1)
    assert about["decided_by"]["parameter"] == "friction of block"
    assert about["decided_by"]["true_where"] == "below"
    assert about["decided_by"]["threshold"] == pytest.approx(
        1.0 / (2.0 * 9.81 * median), rel=0.15
    )  # dampings slow it too
    assert about["decided_by"]["agree"] >= 55
    assert "decided by friction of block: true below" in about["answer"]


def test_the_interval_of_the_stop_holds_the_law(session: Session) -> None:
    about = session("Rollout", case="slide", horizon_seconds=2.0, ensemble=64)["data"]["ensemble"]
    (rest,) = (row for row in about["timeline"] if row["what"] == "comes to rest")
    assert rest["true"] == 64
    spread, place = rest["time_90%"], rest["place_90%"]
    assert spread["from"] - 0.04 <= SPEED / (FRICTION * 9.81) <= spread["to"] + 0.04  # sampled every 0.04 s
    assert place["from"][0] - SIGMA <= stopping_distance(FRICTION, SPEED) <= place["to"][0] + SIGMA


def test_a_branch_inherits_the_sample_and_its_edits_act_on_every_member(session: Session) -> None:
    """At half the speed each member stops at a quarter of its way."""
    ends = []
    for edits in ([], [{"action": "scale_velocity", "object": "block", "factor": 0.5}]):
        answer = session("Rollout", case="slide", horizon_seconds=2.0, edits=edits, ensemble=40)
        spread = answer["data"]["ensemble"]["ends"][0]["position_90%"]
        ends.append([spread[key][0] for key in ("from", "median", "to")])
    assert ends[1] == pytest.approx([x / 4.0 for x in ends[0]], abs=0.012)  # it starts some millimetres from 0
    again = [{"action": "scale_parameter", "path": "objects.block.friction", "factor": 0.25}]
    further = session(
        "Rollout", case="slide", horizon_seconds=4.0, world=answer["source"]["world"], edits=again, ensemble=40
    )
    back = further["data"]["ensemble"]["ends"][0]["position_90%"]["median"][0]
    assert back == pytest.approx(ends[0][1], abs=0.012)


def test_several_predicates_are_answered_in_one_call(session: Session, rollout: str) -> None:
    stop = stopping_distance(FRICTION, SPEED)
    statements = [
        beyond(1.6 * stop),
        {"predicate": "moved_by_more_than", "object": "block", "distance": 0.5 * stop},
        {"predicate": "comes_to_rest", "object": "block"},
        {"predicate": "within_distance", "a": "block", "place": [0.0, 0.0, 0.05], "distance": 0.1},
    ]
    alone = session("QueryWorld", rollout=rollout, predicates=statements)
    assert [row["verdict"] for row in alone["data"]["answers"]] == ["false", "true", "true", "true"]


def test_worlds_are_compared_member_by_member(session: Session, rollout: str) -> None:
    edits = [{"action": "scale_velocity", "object": "block", "factor": 0.5}]
    slow = session("Rollout", case="slide", horizon_seconds=2.0, edits=edits)["source"]["rollout"]
    answer = session("CompareWorlds", base=rollout, edited=slow, ensemble=40)
    (row,) = answer["data"]["ensemble"]["objects"]
    assert row["displaced"]["true"] == 40
    far = row["final_distance"]
    assert far["from"] < 0.75 * stopping_distance(FRICTION, SPEED) < far["to"]
    assert "block displaced in 40 of 40" in answer["summary"]


def test_energy_and_momentum_come_with_intervals(session: Session, rollout: str) -> None:
    """Without a rotation the block has m v^2 / 2, and friction decelerates it by mu g."""
    columns = ["time", "vx", "px", "ax", "kinetic_energy"]
    answer = session("ReadTrajectory", rollout=rollout, object="block", fields=columns, ensemble=40)
    about = answer["data"]["ensemble"]
    assert about["columns"] == ["time", "frame", "vx", "px", "ax", "kinetic_energy"]
    mass = session("ReadProperty", case="slide", objects=["block"], property="mass")["data"]["values"][0]["value"]
    _, _, speed, _, slowing, energy = about["rows"][1]
    assert speed[1] < speed[0] < speed[2]
    width = slowing[2] - slowing[1]  # of an interval of 80%: 2.6 standard deviations
    assert slowing[1] - width < -FRICTION * 9.81 < slowing[2] + width
    assert answer["data"]["rows"][1][4] == pytest.approx(0.5 * mass * answer["data"]["rows"][1][1] ** 2, rel=0.01)
    assert energy[1] < energy[2]
    assert about["rows"][-1][2] == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)
    assert about["motion"]["displacement"]["from"] < stopping_distance(FRICTION, SPEED)
    assert "Of the ensemble, block ends" in answer["summary"]


def test_the_same_question_is_not_computed_twice(session: Session) -> None:
    answers = [asked(session, beyond(0.25))[0]["probability"] for _ in range(2)]
    assert answers[0] == answers[1]
    ensembles = session.store_rows("SELECT count(*) FROM rollouts WHERE kind = 'ensemble'")
    asked(session, beyond(0.26))
    assert session.store_rows("SELECT count(*) FROM rollouts WHERE kind = 'ensemble'") == ensembles


def test_a_world_that_was_never_fitted_is_refused_with_what_to_do(tmp_path: Path) -> None:
    session = Session(tmp_path / "atw.db")
    path = write_tracks(tmp_path / "slide.csv")
    session("OpenCase", data=str(path), name="plain")
    session("ImportObservation", case="plain", kind="tracks", path=str(path))
    built = session("BuildWorld", case="plain", default_shape={"kind": "sphere", "radius": 0.05})
    session("CommitWorld", case="plain", world=built["source"]["world"])
    refusal = session.refused("Rollout", case="plain", ensemble=40)
    assert "no posterior sample" in refusal
    assert "FitWorld(case='plain', world=...)" in refusal
    made = session("Rollout", case="plain")["source"]["rollout"]
    question = {"ask": "where", "object": "puck"}
    assert "no posterior sample" in session.refused("Ask", case="plain", questions=[question])
    assert "no posterior sample" in session.refused("CompareWorlds", base=made, edited=made, ensemble=40)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({}, "give predicate, or predicates"),
        ({"predicate": beyond(0.1), "predicates": [beyond(0.2)]}, "give predicate, or predicates"),
        ({"predicates": [beyond(0.1), {"predicate": "within_distance", "a": "block", "distance": 1}]}, "predicate 2: "),
        ({"predicate": {"predicate": "comes_to_rest", "object": "block"}, "aggregation": "all"}, "any, first, last"),
    ],
)
def test_refusals_say_what_to_give(session: Session, rollout: str, arguments: dict[str, Any], complaint: str) -> None:
    assert complaint in session.refused("QueryWorld", rollout=rollout, **arguments), json.dumps(arguments)


def test_the_members_of_a_world_that_got_a_law_of_resistance_have_it(tmp_path: Path) -> None:
    """A ball thrown in a drag of 0.3 v^2: where it is after twice the clip, within what the members say."""
    times = frames(60)
    places = thrown(times, (6.0, 1.0, 5.0), 0.0, 0.3)
    session, path = Session(tmp_path / "atw.db"), tmp_path / "tracks.json"
    path.write_text(json.dumps(tracks_of({"ball": places[:30]}).to_dict()))
    session("OpenCase", data=str(path), name="throw")
    session("ImportObservation", case="throw", kind="tracks", path=str(path))
    session("BuildWorld", case="throw", objects=[{"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}}])
    fitted = session("FitWorld", case="throw", patience_seconds=300)
    (law,) = [value for value in fitted["data"]["values"] if value["name"] == "quadratic_damping"]
    assert law["interval80"][0] > 0.2
    assert not law["from_prior"]
    assert session("InspectWorld", case="throw")["data"]["world"] == fitted["data"]["world"]  # the latest draft
    session("CommitWorld", case="throw", world=fitted["data"]["world"])
    end = float(times[-1])
    x = float(places[-1, 0])
    for border, truth in ((x + 0.6, 1.0), (x - 0.6, 0.0)):
        inside = {"predicate": "inside_region", "object": "ball", "lower": [-99, -99, -99], "upper": [border, 99, 99]}
        question = {"ask": "whether", "predicate": inside, "interval": [end - 0.01, end]}
        (row,) = session("Ask", case="throw", questions=[question])["data"]["answers"]
        assert row["probability"] == pytest.approx(truth, abs=0.1)
