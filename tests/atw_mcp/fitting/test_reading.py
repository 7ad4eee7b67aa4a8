"""What FitWorld says of its own minimum, and how it says what the data left open."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from atw_mcp.fitting.reading import ROWS, doubts, next_step, open_questions, prediction_in_words, verdict_in_words
from polyworld.world import World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box
from tests.atw_mcp.clips import write_tracks
from tests.atw_mcp.session import Session

BOX = {"kind": "box", "half_extents": [0.05, 0.05, 0.05]}


def document(position: float, rotation: float) -> dict[str, Any]:
    return {
        "method": "least_squares",
        "loss": 1.0,
        "accuracy": {"position_rmse": position, "rotation_rmse": rotation},
        "verdict": {"verdict": "good", "why": "", "bodies": []},
        "prediction": None,
        "slack": [],
        "values": [],
        "undetermined": [],
    }


@pytest.fixture
def world() -> World:
    # Radius of gyration of a cube of half-width a about any axis: a sqrt(2/3) = 0.163 m.
    cube = RigidObject(name="cube", shape=Box(half_extents=(0.2, 0.2, 0.2)), position=(0.0, 0.0, 0.2))
    return World(objects=(cube,))


def test_a_turn_that_is_off_by_more_than_the_places_is_doubted(world: World) -> None:
    # Two minima of one video's fit, as they were met: 0.05 rad, and 0.19 rad.
    assert doubts(world, document(0.008, 0.05)) == []
    (found,) = doubts(world, document(0.015, 0.19))
    assert "rotation_rmse 0.19 rad" in found


def test_each_verdict_is_said_first_and_has_a_step_of_its_own(world: World) -> None:
    asked = document(0.008, 0.05)
    assert verdict_in_words(asked) == "good fit:"
    assert "CommitWorld" in next_step("case", "world", asked)
    off = {
        "object": "cube",
        "verdict": "poor",
        "error_m": 0.03,
        "noise_m": 0.005,
        "of_radius": 0.12,
        "predicted_m": 0.2,
    }
    value = {"name": "cube.friction", "paths": ["objects.cube.friction"], "value": 0.999,
             "bounds": [0.0, 1.0], "at_bound": True}  # fmt: skip
    near = {
        **asked,
        "verdict": {"verdict": "doubtful", "why": "cube is off", "bodies": [off]},
        "values": [value],
    }
    assert verdict_in_words(near) == "DOUBTFUL fit (cube is off):"
    assert "FindDiscrepancy" in next_step("case", "world", near)
    said = " ".join(doubts(world, near))
    assert "cube by 0.03 m (12% of its radius) and 0.2 m where it was predicted" in said
    assert "cube.friction = 0.999" in said  # on its bound
    poor = {**near, "verdict": {**near["verdict"], "verdict": "poor"}}
    assert "CommitWorld" not in next_step("case", "world", poor)


def test_collisions_that_depart_from_their_law_are_named_by_number(world: World) -> None:
    asked = {**document(0.008, 0.05), "slack": [0.4, 3.1]}
    (said,) = doubts(world, asked)
    assert "collision 2" in said


def test_open_values_come_first_where_they_decide_what_happens_next() -> None:
    decided = {
        "object": "cube",
        "error": 0.01,
        "half_width80": {"cut": 0.0, "0.5_s_after": 0.1, "1_s_after": 0.3},
        "decided_by": [{"constant": "b", "share_of_variance": 0.8}],
    }
    asked = document(0.008, 0.05)
    asked["undetermined"] = [{"parameters": [name], "reason": "prior"} for name in ("a", "b")]
    asked["prediction"] = {"first_frame_left_out": 40, "bodies": [decided]}
    rows, count = open_questions(asked)
    assert count == 2
    assert rows[0]["object"] == "b"
    assert "decides where cube goes" in rows[0]["reason"]
    assert "predicts the frames from 40 on" in prediction_in_words(asked)
    assert "+-0.3 m 1 s after" in prediction_in_words(asked)
    asked["undetermined"] = [{"parameters": [f"c{k}"], "reason": "prior"} for k in range(20)]
    assert len(open_questions(asked)[0]) == ROWS


def test_a_better_draft_is_named(session: Session, tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "slide.csv", speed=1.2, friction=0.23)
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path), position_sigma=0.001)
    draft = session("BuildWorld", case=case, default_shape=BOX)["source"]["world"]
    asked = {"case": case, "world": draft, "patience_seconds": 300}
    good = session("FitWorld", **asked)
    assert good["data"]["best_draft"] is None
    assert good["data"]["verdict"] == "good"
    poor = session("FitWorld", **asked, method="random_search", generations=1, population=8)
    assert poor["data"]["best_draft"]["world"] == good["data"]["world"]
    assert poor["data"]["loss"] > good["data"]["loss"]
    assert good["data"]["world"] in poor["summary"]
    assert not any(good["data"]["world"] in text for text in poor["data"]["warnings"])
    assert "starting world" in good["summary"]
    assert "predicts the frames from" in good["summary"]
    again = session("FitWorld", **asked)
    assert not again["data"]["computed_now"]
    assert again["data"]["world"] == good["data"]["world"]


def test_noise_that_is_stated_too_large_is_named(session: Session, tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "slide.csv", speed=1.2, friction=0.23)
    said = []
    for name, sigma in (("stated", {"position_sigma": 0.0005}), ("assumed", {})):
        case = session("OpenCase", data=str(path), name=name)["case"]
        session("ImportObservation", case=case, kind="tracks", path=str(path), **sigma)
        session("BuildWorld", case=case, default_shape=BOX)
        fitted = session("FitWorld", case=case, patience_seconds=300)
        said.append(any("noise of positions is overstated: puck 0.01" in text for text in fitted["data"]["notes"]))
    assert said == [False, True]


def test_a_value_that_the_data_want_beyond_its_bound_is_at_the_bound(session: Session, tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "slide.csv", speed=1.2, friction=0.23)
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path), position_sigma=0.001)
    session("BuildWorld", case=case, default_shape=BOX)
    at_bound = []
    for upper in (0.15, 0.6):
        bounded = [{"paths": ["objects.puck.friction"], "lower": 0.0, "upper": upper}]
        fitted = session("FitWorld", case=case, parameters=bounded, patience_seconds=300)
        (value,) = (value for value in fitted["data"]["values"] if value["name"] == "puck.friction")
        at_bound.append(value["at_bound"])
        assert value["value"] == pytest.approx(min(0.23, upper), abs=0.01)
    assert at_bound == [True, False]
