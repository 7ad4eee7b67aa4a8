"""What FitWorld says of its own minimum, and how it says what the data left open."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from atw_mcp.fitting.reading import ROWS, doubts, next_step, open_questions, verdict_in_words
from polyworld.world import World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box
from tests.atw_mcp.clips import write_tracks
from tests.atw_mcp.session import Session

BOX = {"kind": "box", "half_extents": [0.05, 0.05, 0.05]}


def document(losses: list[float], position: float, rotation: float) -> dict[str, Any]:
    return {
        "method": "cem",
        "loss": losses[0],
        "loss_start": 9.0,
        "starts": [{"loss": loss} for loss in losses],
        "accuracy": {"position_rmse": position, "rotation_rmse": rotation},
        "verdict": {"verdict": "good", "why": "", "bodies": []},
        "values": [],
        "undetermined": [],
        "widened": {},
        "outlying": [],
        "resistance": [],
    }


@pytest.fixture
def world() -> World:
    # Radius of gyration of a cube of half-width a about any axis: a sqrt(2/3) = 0.163 m.
    cube = RigidObject(name="cube", shape=Box(half_extents=(0.2, 0.2, 0.2)), position=(0.0, 0.0, 0.2))
    return World(objects=(cube,))


def test_the_deeper_of_two_basins_is_not_doubted_and_the_other_is(world: World) -> None:
    # Two minima of one video's fit, as they were met: 0.05 rad at loss 0.25, and 0.19 rad at loss 2.3.
    assert doubts(world, document([0.25, 0.26, 2.3], 0.008, 0.05)) == []
    (found,) = doubts(world, document([2.3, 2.31, 2.32], 0.015, 0.19))
    assert "local minimum" in found
    assert "another seed" in found
    (found,) = doubts(world, document([0.25, 2.3, 2.4], 0.008, 0.05))
    assert "only one of 3 searches" in found


def test_each_verdict_is_said_first_and_has_a_step_of_its_own(world: World) -> None:
    asked = document([1.0], 0.008, 0.05)
    assert verdict_in_words(asked) == "good fit:"
    assert "CommitWorld" in next_step("case", "world", asked)
    off = {"object": "cube", "verdict": "poor", "error_m": 0.03, "noise_m": 0.005, "of_radius": 0.12}
    value = {"name": "cube.friction", "paths": ["objects.cube.friction"], "value": 0.999, "bounds": [0.0, 1.0]}
    poor = {**asked, "verdict": {"verdict": "poor", "why": "cube is off", "bodies": [off]}, "values": [value]}
    assert verdict_in_words(poor) == "POOR fit (cube is off; searched cube.friction 0 to 1):"
    assert "FindDiscrepancy" in next_step("case", "world", poor)
    said = " ".join(doubts(world, poor))
    assert "cube by 0.03 m (12% of its radius)" in said
    assert "cube.friction = 0.999" in said  # on its bound
    failed = {**poor, "verdict": {**poor["verdict"], "verdict": "failed"}}
    assert "CommitWorld" not in next_step("case", "world", failed)


def test_frames_that_weigh_less_and_bounds_that_were_widened_are_named(world: World) -> None:
    asked = document([1.0], 0.008, 0.05)
    asked["outlying"] = [{"object": "cube", "frames": [4, 9], "worst": 31.0}]
    asked["widened"] = {"cube.friction": [0.0, 3.0]}
    said = doubts(world, asked)
    assert any("frames 4, 9" in item and "31" in item for item in said)
    assert any("cube.friction" in item and "0 to 3" in item for item in said)


def test_objects_that_never_move_are_said_to_be_still_once_and_rows_are_few() -> None:
    names = [f"b{n}" for n in range(20)]
    state = [{"name": f"{n}.rotation.z", "paths": [f"objects.{n}.rotation.z"]} for n in ("a", "post", *names)]
    still = {"parameters": ["objects.post.friction"], "reason": "not fitted: post never moves in the observed frames"}
    combined = {"parameters": ["a.rotation.z", "post.rotation.z"], "reason": "only combinations"}
    alone = {"parameters": ["post.rotation.z"], "reason": "narrowed by less than a third"}
    asked = {"values": state, "undetermined": [alone, still, combined]}
    rows, count = open_questions(asked)
    assert count == 2
    assert rows[0] == {"object": "post", "reason": "post does not move: its state is as observed"}
    assert "a.rotation.z + post.rotation.z" in rows[1]["reason"]
    many = [{"parameters": [f"{n}.rotation.z"], "reason": "narrowed by less than a third"} for n in names]
    rows, count = open_questions({"values": state, "undetermined": many})
    assert (len(rows), count) == (ROWS, len(names))


def test_a_refinement_that_finds_nothing_and_a_better_draft_are_named(session: Session, tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "slide.csv", speed=1.2, friction=0.23)
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path), position_sigma=0.001)
    draft = session("BuildWorld", case=case, default_shape=BOX)["source"]["world"]
    asked = {"case": case, "each": ["friction"], "shared": [], "patience_seconds": 300}
    good = session("FitWorld", **asked, world=draft, generations=20)
    assert good["data"]["best_draft"] is None
    assert len(good["data"]["starts"]) == 5
    crude = {"world": draft, "method": "random_search", "generations": 1, "population": 8}
    poor = session("FitWorld", **asked, **crude)
    tied = session("FitWorld", case=case, shared=["friction"], **crude)  # by default it is fitted for each
    assert [value["name"] for value in tied["data"]["values"] if "friction" in value["name"]] == ["friction"]
    assert poor["data"]["best_draft"]["world"] == good["data"]["world"]
    assert poor["data"]["loss"] > good["data"]["loss"]
    assert any(good["data"]["world"] in text for text in poor["data"]["warnings"])
    again = session("FitWorld", **asked, world=good["data"]["world"], method="refine")
    thrice = session("FitWorld", **asked, world=again["data"]["world"], method="refine")
    assert any("nothing better" in text for text in thrice["data"]["warnings"])
    assert "starting world" in good["summary"]
    assert "ReadEvidence(path" not in json.dumps(good)


def test_noise_that_is_stated_too_large_is_named(session: Session, tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "slide.csv", speed=1.2, friction=0.23)
    said = []
    for name, sigma in (("stated", {"position_sigma": 0.0005}), ("assumed", {})):
        case = session("OpenCase", data=str(path), name=name)["case"]
        session("ImportObservation", case=case, kind="tracks", path=str(path), **sigma)
        session("BuildWorld", case=case, default_shape=BOX)
        fitted = session("FitWorld", case=case, each=["friction"], shared=[], patience_seconds=300)
        said.append(any("noise of positions is overstated: puck 0.01" in text for text in fitted["data"]["warnings"]))
    assert said == [False, True]


def test_a_value_that_the_data_want_beyond_its_bound_is_at_the_bound(session: Session, tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "slide.csv", speed=1.2, friction=0.23)
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path), position_sigma=0.001)
    session("BuildWorld", case=case, default_shape=BOX)
    at_bound = []
    for upper in (0.15, 0.6):
        bounded = [{"paths": ["objects.puck.friction"], "lower": 0.0, "upper": upper}]
        fitted = session("FitWorld", case=case, each=[], shared=[], parameters=bounded, patience_seconds=300)
        (value,) = (value for value in fitted["data"]["values"] if "friction" in value["name"])
        at_bound.append(value["at_bound"])
        assert value["value"] == pytest.approx(min(0.23, upper), abs=0.01)
    assert at_bound == [True, False]


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(tmp_path / "atw.db")
