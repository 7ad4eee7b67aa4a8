"""Which worlds hinges make of what a camera sees from the side, or from above."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.atw_mcp.session import Session

SIDE_VIEW = {"point": [0, 0, 0], "normal": [0, -1, 0], "supports": False}
TABLE = {"point": [0, 0, 0], "normal": [0, 0, 1]}
BOB = {"name": "bob", "shape": {"kind": "sphere", "radius": 0.02}, "position": [0.3, 0, 0.6], "mass": 0.2}
PIVOT = {"part": "hinge", "name": "pivot", "object": "bob", "anchor": [0, 0, 1]}


@pytest.fixture
def case(session: Session, tmp_path: Path) -> str:
    path = tmp_path / "nothing.csv"
    path.write_text("t,object,x,y,z\n")
    opened: str = session("OpenCase", data=str(path))["case"]
    return opened


def built(session: Session, case: str, **arguments: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Build a world; return what BuildWorld reports of it, and its document."""
    report = session("BuildWorld", case=case, floor="none", **arguments)
    return report["data"], json.loads(session.store_document(report["source"]["world"]))


def test_what_swings_in_view_may_be_damped_and_turns_across_the_view(session: Session, case: str) -> None:
    report, world = built(session, case, motion_plane=SIDE_VIEW, objects=[BOB], parts=[{**PIVOT, "damping": 0.001}])
    assert report["representation"] == "spatial"
    assert [joint["axis"] for joint in world["joints"]] == [[0, -1, 0]]
    assert any("turn about the motion plane's normal" in note for note in report["assumed"])
    assert any("representation='planar'" in note for note in report["assumed"])


def test_an_axis_that_was_given_stays(session: Session, case: str) -> None:
    tilted = {**PIVOT, "axis": [0, 1, 0.5]}
    report, world = built(session, case, motion_plane=SIDE_VIEW, objects=[BOB], parts=[tilted])
    assert [joint["axis"] for joint in world["joints"]] == [[0, 1, 0.5]]
    assert not any("normal" in note for note in report["assumed"])


@pytest.mark.parametrize(
    "arguments",
    [
        {"motion_plane": SIDE_VIEW, "objects": [BOB, {**BOB, "name": "free", "position": [1, 0, 1]}]},
        {"motion_plane": SIDE_VIEW, "objects": [BOB], "representation": "planar"},
    ],
    ids=["beside-a-free-body", "as-asked"],
)
def test_hinges_beside_what_moves_freely_stay_in_the_plane(
    session: Session, case: str, arguments: dict[str, Any]
) -> None:
    assert built(session, case, parts=[PIVOT], **arguments)[0]["representation"] == "planar"


def test_bodies_on_joints_on_a_table_move_in_space_on_its_surface(session: Session, case: str) -> None:
    report, _ = built(session, case, motion_plane=TABLE, objects=[BOB], parts=[PIVOT])
    assert report["representation"] == "spatial"
    assert "do not rub on a plane of motion" in json.dumps(report)
