"""Every observation of a case stays addressable: corrected, looked at and modelled by its id."""

from __future__ import annotations

import json
from typing import Any

import pytest

from atw_mcp.demo.truth import FOLDER
from tests.atw_mcp.session import Session

CASE = "table"


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((FOLDER / "collision.json").read_text())
    return loaded


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory, truth: dict[str, Any]) -> Session:
    session = Session(tmp_path_factory.mktemp("store") / "atw.db")
    session("OpenCase", video=str(FOLDER / "collision.mp4"), name=CASE)
    camera = {key: truth["camera"][key] for key in ("intrinsics", "rotation", "translation")}
    session("CalibrateCamera", case=CASE, camera=camera)
    return session


@pytest.fixture(scope="module")
def observations(session: Session, truth: dict[str, Any]) -> tuple[str, str]:
    """All objects as observed, and then all but the first."""
    names = [name.replace("_", " ") for name in truth["names"]]
    first = session("ObserveObjects", case=CASE, expected=names, patience_seconds=300)
    dropped = {"kind": "drop", "object": truth["names"][0]}
    second = session("ObserveObjects", case=CASE, corrections=[dropped], patience_seconds=300)
    return first["source"]["observation"], second["source"]["observation"]


def test_worlds_are_built_of_any_observation(
    session: Session, observations: tuple[str, str], truth: dict[str, Any]
) -> None:
    earlier, latest = observations
    gone = truth["names"][0]
    of_latest = session("BuildWorld", case=CASE, seconds_per_frame=truth["seconds_per_frame"], patience_seconds=300)
    of_earlier = session(
        "BuildWorld",
        case=CASE,
        observation=earlier,
        seconds_per_frame=truth["seconds_per_frame"],
        patience_seconds=300,
    )
    assert gone not in of_latest["objects"]
    assert gone in of_earlier["objects"]
    message = session.refused("BuildWorld", case=CASE, observation="obs_nothing")
    assert earlier in message
    assert latest in message
    message = session.refused("BuildWorld", case=CASE, observation=earlier, tracks="x")
    assert "not both" in message


def test_corrections_and_pictures_take_any_observation(
    session: Session, observations: tuple[str, str], truth: dict[str, Any]
) -> None:
    earlier, latest = observations
    gone, other = truth["names"][0], truth["names"][1]
    renamed = {"kind": "rename", "object": gone, "name": "first"}
    third = session("ObserveObjects", case=CASE, observation=earlier, corrections=[renamed], patience_seconds=300)
    assert "first" in third["objects"]
    failed = session._call("ObserveObjects", {"case": CASE, "observation": latest, "corrections": [renamed]})
    assert failed.is_error
    assert gone in failed.content[0].text  # the correction failed on record: it has evidence of its own
    shown = session("InspectFrames", case=CASE, observation=latest, frames=[3])
    assert set(shown["objects"]) == set(truth["names"]) - {gone}
    seen = session("InspectObservedMotion", case=CASE, object=gone, observation=earlier)
    assert seen["source"]["observation"]
    message = session.refused("InspectFrames", case=CASE, observation="obs_nothing")
    assert earlier in message
    back = session("ObserveObjects", case=CASE, observation=latest)
    assert back["source"]["observation"] == latest
    assert set(session("InspectFrames", case=CASE, frames=[3])["objects"]) == set(truth["names"]) - {gone}
    assert other in session("InspectFrames", case=CASE, frames=[3])["objects"]


def test_residual_shows_what_no_object_explains(
    session: Session, observations: tuple[str, str], truth: dict[str, Any]
) -> None:
    """With one body dropped, about its area is left over where it is."""
    earlier, latest = observations
    gone = truth["names"][0]
    with_all = session("InspectFrames", case=CASE, observation=earlier, frames=[3], residual=True)
    without = session("InspectFrames", case=CASE, observation=latest, frames=[3], residual=True)
    areas = {o["name"]: o["area"][0] for o in with_all["data"]["objects"]}
    extra = without["data"]["unexplained_px"][0] - with_all["data"]["unexplained_px"][0]
    assert extra == pytest.approx(areas[gone], rel=0.3)
    assert with_all["data"]["unexplained_px"][0] < 0.3 * areas[gone]


def test_part_of_a_frame_is_shown_larger(session: Session, observations: tuple[str, str]) -> None:
    assert observations
    session("InspectFrames", case=CASE, frames=[3], crop=[10, 10, 60, 40], zoom=6)
    message = session.refused("InspectFrames", case=CASE, frames=[3], crop=[10, 10, 60, 40], zoom=32)
    assert "zoom at most" in message
    assert "outside the frame" in session.refused("InspectFrames", case=CASE, frames=[3], crop=[9000, 10, 60, 40])
