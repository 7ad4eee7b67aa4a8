"""What a world would be in size is predicted and refused before anything of it is made."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from atw_mcp.calls.jobs import Progress
from atw_mcp.calls.limits import Limits
from atw_mcp.worlds.sizes import check_sizes, sizes
from polyworld.core.interruption import Interrupted
from polyworld.model import mesh_of
from polyworld.world import World
from tests.atw_mcp.session import Session

BALL = {"part": "soft", "name": "jelly", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 1]}
SHEET = {"kind": "sheet", "corner": [0, 0, 1], "edge_u": [1, 0, 0], "edge_v": [0, 1, 0]}
ROPE = {"part": "rope", "points": [[0, 0, 2], [1, 0, 2]], "segments": 5000}
TANK = {"part": "fluid_grid", "lower": [0, 0, 0], "upper": [1, 1, 1]}
WATER = {
    "part": "fluid",
    "name": "water",
    "volumes": [{"shape": {"kind": "box", "half_extents": [0.4, 0.4, 0.4]}, "position": [0.5, 0.5, 0.5]}],
}
TAP = {"part": "emitter", "name": "tap", "fluid": "water", "position": [0.5, 0.5, 0.9], "radius": 0.02, "rate": 2e3}


@pytest.fixture
def case(session: Session, tmp_path: Path) -> str:
    (tmp_path / "t.csv").write_text("t,object,x,y\n0,a,0,0\n")
    return str(session("OpenCase", data=str(tmp_path / "t.csv"))["case"])


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ([{**BALL, "resolution": 1e-9}], "elements"),
        ([{**BALL, "resolution": 0.004}], "elements"),
        ([{**BALL, "name": f"jelly{i}", "resolution": 0.02} for i in range(6)], "with those before it"),
        (
            [{"part": "cloth", "name": "flag", "geometry": {**SHEET, "divisions": [400, 400]}}],
            "divisions=[316, 316]",
        ),
        ([{**ROPE, "name": f"cord{i}"} for i in range(5)], "segments"),
        ([{**TANK, "cell": 0.009}, WATER], "cells"),
        ([{**TANK, "cell": 0.012}, WATER], "particles"),
    ],
)
def test_a_world_that_is_too_large_is_refused_with_what_would_be_accepted(
    session: Session, case: str, parts: list[dict[str, Any]], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def meshed(*_: object) -> None:
        raise AssertionError("something was meshed before the refusal")

    for module in (
        "atw_mcp.worlds.warnings.carvings",
        "polyworld.model.soft.soft_form",
        "polyworld.model.cloth._sheet",
    ):
        monkeypatch.setattr(module, meshed)
    refused = session.refused("BuildWorld", case=case, parts=parts, only=[], representation="spatial")
    assert "more than the limit of" in refused
    assert any(word in refused for word in ("would be accepted", "give fewer segments"))
    assert says in refused


def test_what_the_refusal_names_as_acceptable_is_accepted() -> None:
    limits = Limits()
    item = {"name": "a", "representation": "soft", "shape": {"kind": "sphere", "radius": 0.1}, "position": (0, 0, 0)}
    world = World.model_validate({"deformables": [{**item, "resolution": 1e-9}]})
    with pytest.raises(ValueError, match="would be accepted") as refused:
        check_sizes(world, limits)
    fits = float(str(refused.value).split("resolution=")[1].split()[0])
    check_sizes(World.model_validate({"deformables": [{**item, "resolution": fits}]}), limits)
    assert fits == pytest.approx(0.0117, rel=0.1)


def test_an_owner_may_raise_a_limit() -> None:
    world = World.model_validate({"deformables": [{"name": "c", "representation": "rope", **_rope(5000)}]})
    check_sizes(world, Limits())
    with pytest.raises(ValueError, match=r"limit of 100 of this server"):
        check_sizes(world, Limits(segments=100))


def test_predicted_elements_and_particles_are_those_that_are_made() -> None:
    soft = {"name": "a", "representation": "soft", "shape": {"kind": "box", "half_extents": (0.1, 0.1, 0.1)}}
    world = World.model_validate({"deformables": [{**soft, "position": (0, 0, 0), "resolution": 0.05}]})
    made = len(mesh_of(world, world.deformables[0]).tetrahedra) / 8
    assert made == pytest.approx(sizes(world, Limits(), 0.0)[0].count, rel=0.5)
    grid = {key: value for key, value in TANK.items() if key != "part"}
    water = {key: value for key, value in WATER.items() if key != "part"}
    pond = World.model_validate(
        {"deformables": [{"representation": "fluid", **water}], "fluid_grid": {**grid, "cell": 0.1}}
    )
    found = {size.limit: size.count for size in sizes(pond, Limits(), 0.0)}
    assert found["cells"] == pytest.approx(1000)
    assert len(mesh_of(pond, pond.deformables[0]).nodes) <= found["particles"] <= 8000


def test_emitters_count_over_the_horizon_and_additions_before_they_are_made(session: Session, case: str) -> None:
    built = session("BuildWorld", case=case, parts=[{**TANK, "cell": 0.1}, WATER, TAP], only=[])
    session("CommitWorld", case=case, world=built["data"]["world"])
    refused = session.refused("Rollout", case=case, horizon_seconds=0.08)
    assert "emitter 'tap'" in refused
    assert "more than the limit of 1,000,000" in refused
    added = {"name": "jelly", "representation": "soft", "shape": BALL["shape"], "position": [0, 0, 1]}
    edits = [{"action": "add", "deformable": {**added, "resolution": 1e-9}}]
    assert "soft body 'jelly'" in session.refused("Rollout", case=case, horizon_seconds=0.2, edits=edits)


def test_dividing_a_soft_body_is_long_work_that_stops_when_cancelled(session: Session, case: str) -> None:
    shape = {"kind": "capsule", "radius": 0.1, "half_height": 0.1}
    parts = [{**BALL, "shape": shape, "resolution": 0.015}]
    started = session("BuildWorld", case=case, parts=parts, only=[], patience_seconds=0)
    assert started["status"] == "running"
    # The connection of the call is closed by now, and with it the server, which asks its work to stop.
    ended = session("ReadEvidence", evidence=started["evidence"])
    assert (ended["status"], "call BuildWorld again" in ended["summary"]) == ("failed", True)


def test_a_check_interrupts_the_division() -> None:
    shape = {"kind": "capsule", "radius": 0.1, "half_height": 0.1}
    item = {"name": "a", "representation": "soft", "shape": shape, "position": (0, 0, 0), "resolution": 0.021}
    world = World.model_validate({"deformables": [item]})
    progress = Progress()
    threading.Timer(0.1, progress.cancel).start()
    with pytest.raises(Interrupted), progress.interruption.active():
        mesh_of(world, world.deformables[0])


def _rope(segments: int) -> dict[str, Any]:
    return {"points": ((0, 0, 0), (1, 0, 0)), "segments": segments}
