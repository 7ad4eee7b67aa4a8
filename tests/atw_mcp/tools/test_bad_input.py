"""Bad input gets an error that names the valid choice, and loses nothing."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from tests.atw_mcp.clips import write_clip, write_tracks
from tests.atw_mcp.session import Session


@pytest.fixture
def sliding(session: Session, tmp_path: Path) -> tuple[Session, str, str]:
    """A session with a case of imported tracks and a draft world: (session, case, world)."""
    case = session("OpenCase", data=str(write_tracks(tmp_path / "slide.csv")), name="slide")["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(tmp_path / "slide.csv"))
    built = session("BuildWorld", case=case, default_shape={"kind": "box", "half_extents": [0.05, 0.05, 0.05]})
    return session, case, built["source"]["world"]


def test_no_such_file_names_the_files_there_are(session: Session, tmp_path: Path) -> None:
    write_clip(tmp_path / "marbles.mp4")
    assert "marbles.mp4" in session.refused("OpenCase", video=str(tmp_path / "marble.mp4"))


def test_unknown_case_names_the_cases(session: Session, tmp_path: Path) -> None:
    case = session("OpenCase", video=str(write_clip(tmp_path / "marbles.mp4")))["case"]
    for tool in ("ObserveObjects", "BuildWorld", "FitWorld", "InspectWorld", "Rollout"):
        assert case in session.refused(tool, case="nope"), tool


def test_unknown_argument_names_the_arguments(session: Session) -> None:
    text = session.refused("OpenCase", vide="x")
    assert "did you mean 'video'" in text
    assert "questions" in text


def test_missing_and_wrongly_typed_arguments_are_named(session: Session) -> None:
    assert "case: is required" in session.refused("BuildWorld")
    assert "max_objects" in session.refused("ObserveObjects", case="x", max_objects="many")
    assert "max_objects" in session.refused("ObserveObjects", case="x", max_objects=0)


def test_building_before_observing_names_the_next_tool(session: Session, tmp_path: Path) -> None:
    case = session("OpenCase", video=str(write_clip(tmp_path / "marbles.mp4")))["case"]
    assert "ObserveObjects" in session.refused("BuildWorld", case=case)
    assert "BuildWorld" in session.refused("FitWorld", case=case)
    assert "BuildWorld" in session.refused("Rollout", case=case)


def test_unknown_objects_name_the_tracks(sliding: tuple[Session, str, str]) -> None:
    session, case, world = sliding
    text = session.refused("BuildWorld", case=case, objects=[{"name": "marble", "mass": 1.0}])
    assert "puck" in text
    assert "puck" in session.refused("BuildWorld", case=case, only=["marble"])
    assert "puck" in session.refused("InspectWorld", case=case, world=world, objects=["marble"])
    assert "puck" in session.refused(
        "UpdateBindings", case=case, reason="seen", corrections=[{"name": "it", "track": "marble"}]
    )


def test_a_shape_neither_seen_nor_given_is_asked_for(sliding: tuple[Session, str, str]) -> None:
    session, case, _ = sliding
    text = session.refused("BuildWorld", case=case)
    assert "default_shape" in text
    assert "radius" in session.refused("BuildWorld", case=case, default_shape={"kind": "sphere"})


def test_parameters_out_of_bounds_are_refused_with_the_bounds(sliding: tuple[Session, str, str]) -> None:
    session, case, world = sliding
    box = {"kind": "box", "half_extents": [0.05, 0.05, 0.05]}
    objects = [{"name": "puck", "restitution": 1.5}]
    assert "less than or equal to 1" in session.refused("BuildWorld", case=case, default_shape=box, objects=objects)
    wide = [{"paths": ["objects.puck.restitution"], "lower": 0.0, "upper": 3.0}]
    assert "0..1" in session.refused("FitWorld", case=case, world=world, parameters=wide)
    odd = [{"paths": ["objects.puck.colour"], "lower": 0.0, "upper": 3.0}]
    assert "objects.puck.friction" in session.refused("FitWorld", case=case, world=world, parameters=odd)


def test_frames_outside_the_tracks_are_refused_with_the_range(sliding: tuple[Session, str, str]) -> None:
    session, case, world = sliding
    assert "0..29" in session.refused("FitWorld", case=case, world=world, first_frame=5, last_frame=99)
    assert "1..29" in session.refused("FitWorld", case=case, world=world, holdout_from=400)
    assert "0..29" in session.refused("BuildWorld", case=case, first_frame=70)


def test_a_world_that_is_no_world_is_refused(sliding: tuple[Session, str, str]) -> None:
    session, case, _ = sliding
    text = session.refused("BuildWorld", case=case, world={"objects": [{"name": "a"}], "colour": "red"})
    assert "colour" in text
    assert "objects.0.shape" in text
    assert "DescribeTool" in text


def test_unknown_worlds_are_refused_and_so_is_probing_before_a_commit(sliding: tuple[Session, str, str]) -> None:
    session, case, world = sliding
    assert world in session.refused("CommitWorld", case=case, world="world-0123456789abcdef")
    assert "CommitWorld" in session.refused("Rollout", case=case, horizon_seconds=1.0)


def test_a_horizon_too_long_is_refused(sliding: tuple[Session, str, str]) -> None:
    session, case, world = sliding
    session("CommitWorld", case=case, world=world)
    assert "horizon" in session.refused("Rollout", case=case, horizon_seconds=1e5)
    assert "horizon" in session.refused("Rollout", case=case, horizon_seconds=-1.0)


def test_finishing_needs_evidence_of_this_case(sliding: tuple[Session, str, str], tmp_path: Path) -> None:
    session, case, _ = sliding
    other = session("OpenCase", video=str(write_clip(tmp_path / "other.mp4")))
    asked = {"case": case, "question": "does it stop?"}
    assert "at least one" in session.refused("Finish", **asked, answer="yes", evidence=[])
    assert "ev-999" in session.refused("Finish", **asked, answer="yes", evidence=["ev-999"])
    assert "evidence" in session.refused("Finish", **asked, answer="yes", evidence=["twelve"])
    assert other["case"] in session.refused("Finish", **asked, answer="yes", evidence=[other["evidence"]])
    assert "missing" in session.refused("Finish", **asked, evidence=["ev-1"])
    assert "confidence" in session.refused("Finish", **asked, answer="yes", evidence=["ev-1"], confidence=2.0)
    unresolved = session("Finish", **asked, evidence=[], missing="it leaves the image first")
    assert unresolved["data"]["resolved"] is False


def test_unknown_evidence_and_parts_are_named(session: Session, tmp_path: Path) -> None:
    opened = session("OpenCase", video=str(write_clip(tmp_path / "marbles.mp4")))
    assert "ReadEvidence(case=" in session.refused("ReadEvidence", evidence="ev-99")
    assert "facts" in session.refused("ReadEvidence", evidence=opened["evidence"], path="nothing")
    assert "either" in session.refused("ReadEvidence")
    assert "OpenCase" in session.refused("DescribeTool", tool="OpneCase")


def test_a_video_that_changed_or_vanished_is_noticed(session: Session, tmp_path: Path) -> None:
    path = write_clip(tmp_path / "marbles.mp4")
    case = session("OpenCase", video=str(path))["case"]
    moved = path.rename(tmp_path / "moved.mp4")
    assert "OpenCase" in session.refused("ObserveObjects", case=case)
    assert session("OpenCase", video=str(moved))["case"] == case
    write_clip(moved, frames=5)
    assert "changed" in session.refused("ObserveObjects", case=case)


def test_a_store_locked_for_a_while_is_reported_and_nothing_is_lost(tmp_path: Path) -> None:
    session = Session(tmp_path / "atw.db")
    opened = session("OpenCase", video=str(write_clip(tmp_path / "marbles.mp4")))
    impatient = Session(tmp_path / "atw.db")
    locker = sqlite3.connect(tmp_path / "atw.db")
    locker.execute("BEGIN IMMEDIATE")
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("evidence_store.connection.BUSY_TIMEOUT", 0.2)
            impatient = Session(tmp_path / "atw.db")
            assert "locked by another process" in impatient.refused("OpenCase", case=opened["case"])
    finally:
        locker.rollback()
        locker.close()
    assert impatient("ReadEvidence", evidence=opened["evidence"])["evidence"] == opened["evidence"]
