"""Every observation of a case stays addressable: corrected, looked at and modelled by its id."""

from __future__ import annotations

import pytest

from tests.atw_mcp.clips import write_clip
from tests.atw_mcp.session import Session

CASE = "table"
GONE, OTHER = "red_sphere", "blue_sphere"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    folder = tmp_path_factory.mktemp("store")
    session = Session(folder / "atw.db")
    session("OpenCase", video=str(write_clip(folder / "discs.mp4")), name=CASE)
    length = {"first_pixel": [20, 60], "second_pixel": [120, 60], "length": 1.0, "view": "top"}
    session("CalibrateCamera", case=CASE, known_length=length)
    return session


@pytest.fixture(scope="module")
def observations(session: Session) -> tuple[str, str]:
    """Both discs as observed, and then all but the first."""
    first = session("ObserveObjects", case=CASE, patience_seconds=300)
    assert set(first["objects"]) == {GONE, OTHER}
    second = session("ObserveObjects", case=CASE, corrections=[{"kind": "drop", "object": GONE}], patience_seconds=300)
    return first["source"]["observation"], second["source"]["observation"]


def test_worlds_are_built_of_any_observation(session: Session, observations: tuple[str, str]) -> None:
    earlier, latest = observations
    of_latest = session("BuildWorld", case=CASE, patience_seconds=300)
    of_earlier = session("BuildWorld", case=CASE, observation=earlier, patience_seconds=300)
    assert GONE not in of_latest["objects"]
    assert GONE in of_earlier["objects"]
    message = session.refused("BuildWorld", case=CASE, observation="obs_nothing")
    assert earlier in message
    assert latest in message
    message = session.refused("BuildWorld", case=CASE, observation=earlier, tracks="x")
    assert "not both" in message


def test_corrections_and_pictures_take_any_observation(session: Session, observations: tuple[str, str]) -> None:
    earlier, latest = observations
    renamed = {"kind": "rename", "object": GONE, "name": "first"}
    third = session("ObserveObjects", case=CASE, observation=earlier, corrections=[renamed], patience_seconds=300)
    assert "first" in third["objects"]
    failed = session._call("ObserveObjects", {"case": CASE, "observation": latest, "corrections": [renamed]})
    assert failed.is_error
    assert GONE in failed.content[0].text  # the correction failed on record: it has evidence of its own
    shown = session("InspectFrames", case=CASE, observation=latest, frames=[3])
    assert set(shown["objects"]) == {OTHER}
    seen = session("InspectObservedMotion", case=CASE, object=GONE, observation=earlier)
    assert seen["source"]["observation"]
    message = session.refused("InspectFrames", case=CASE, observation="obs_nothing")
    assert earlier in message
    back = session("ObserveObjects", case=CASE, observation=latest)
    assert back["source"]["observation"] == latest
    assert set(session("InspectFrames", case=CASE, frames=[3])["objects"]) == {OTHER}


def test_residual_shows_what_no_object_explains(session: Session, observations: tuple[str, str]) -> None:
    """With one body dropped, about its area is left over where it is."""
    earlier, latest = observations
    with_all = session("InspectFrames", case=CASE, observation=earlier, frames=[3], residual=True)
    without = session("InspectFrames", case=CASE, observation=latest, frames=[3], residual=True)
    areas = {o["name"]: o["area"][0] for o in with_all["data"]["objects"]}
    extra = without["data"]["unexplained_px"][0] - with_all["data"]["unexplained_px"][0]
    assert extra == pytest.approx(areas[GONE], rel=0.3)
    assert with_all["data"]["unexplained_px"][0] < 0.3 * areas[GONE]


def test_part_of_a_frame_is_shown_larger(session: Session, observations: tuple[str, str]) -> None:
    assert observations
    session("InspectFrames", case=CASE, frames=[3], crop=[10, 10, 60, 40], zoom=6)
    message = session.refused("InspectFrames", case=CASE, frames=[3], crop=[10, 10, 60, 40], zoom=32)
    assert "zoom at most" in message
    assert "outside the frame" in session.refused("InspectFrames", case=CASE, frames=[3], crop=[9000, 10, 60, 40])
