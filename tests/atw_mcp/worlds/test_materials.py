"""Worlds with ropes, cloth, soft bodies, fluids, joints and compounds through the tools."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import pytest
from mcp import Client

from tests.atw_mcp.session import Session

ROPE = {"part": "rope", "name": "cord", "points": [[0, 0, 1.5], [0.6, 0, 1.5]], "segments": 12, "radius": 0.01}
HOOK = {"part": "attachment", "name": "hook", "object": "cord", "end": "start"}
SHEET = {
    "part": "cloth",
    "name": "flag",
    "geometry": {
        "kind": "sheet",
        "corner": [0, 0, 1],
        "edge_u": [0.4, 0, 0],
        "edge_v": [0, 0.4, 0],
        "divisions": [4, 4],
    },
}
JELLY = {"part": "soft", "name": "jelly", "shape": {"kind": "box", "half_extents": [0.1] * 3}, "position": [0, 0, 0.4]}
TANK = {"part": "fluid_grid", "lower": [-0.2, -0.1, 0], "upper": [0.2, 0.1, 0.3], "cell": 0.05}
WATER = {
    "part": "fluid",
    "name": "water",
    "color": "blue",
    "volumes": [{"shape": {"kind": "box", "half_extents": [0.1, 0.1, 0.1]}, "position": [-0.1, 0, 0.1]}],
}
BUCKET = {"name": "pail", "shape": {"kind": "open_box", "half_extents": [0.1, 0.1, 0.1], "thickness": 0.01}}


@pytest.fixture
def case(session: Session, tmp_path: Path) -> str:
    path = tmp_path / "nothing.csv"
    path.write_text("t,object,x,y,z\n")
    opened: str = session("OpenCase", data=str(path))["case"]
    return opened


def test_world_described_alone_has_every_part(session: Session, case: str) -> None:
    built = session(
        "BuildWorld",
        case=case,
        objects=[{"name": "weight", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0.6, 0, 1.4], "mass": 2}],
        parts=[
            ROPE,
            HOOK,
            {"part": "attachment", "name": "knot", "object": "cord", "end": "end", "to": "weight"},
            SHEET,
            JELLY,
            WATER,
            TANK,
            {"part": "container", "name": "left", "lower": [-0.2, -0.1, 0], "upper": [0, 0.1, 0.3]},
        ],
    )
    assert built["data"]["representation"] == "spatial"
    assert "cloth moves in space (flag)" in built["data"]["why"]
    assert built["objects"] == ["weight", "cord", "flag", "jelly", "water"]
    facts = {item["name"]: item for item in built["data"]["deformables"]}
    assert facts["cord"]["length"] == pytest.approx(0.6)
    assert facts["flag"]["area"] == pytest.approx(0.16)
    assert facts["jelly"]["mass"] == pytest.approx(8.0)
    assert facts["water"]["volume"] == pytest.approx(0.008)
    assert facts["cord"]["held_by"] == ["hook", "knot"]
    document = json.loads(session.store_document(built["source"]["world"]))
    assert document["deformables"][3]["appearance"]["color"] == "blue"


@pytest.mark.parametrize(
    ("arguments", "kind", "why"),
    [
        ({"parts": [ROPE]}, "rope", "give motion_plane"),
        ({"parts": [ROPE], "representation": "planar"}, "rope_planar", "the plane is y = 0"),
        (
            {"parts": [ROPE], "motion_plane": {"point": [0, 0, 0], "normal": [0, -1, 0]}},
            "rope_planar",
            "move in the given plane",
        ),
        (
            {"parts": [ROPE], "motion_plane": {"point": [0, 0, 0], "normal": [0, 0, 1], "supports": True}},
            "rope",
            "gravity pulls across",
        ),
        ({"parts": [{**ROPE, "twist_stiffness": 0.01}]}, "rope", "ropes that twist"),
    ],
)
def test_representation_is_chosen_and_explained(
    session: Session, case: str, arguments: dict[str, Any], kind: str, why: str
) -> None:
    built = session("BuildWorld", case=case, **arguments)
    assert built["data"]["deformables"][0]["representation"] == kind
    assert why in built["data"]["why"]


def test_open_boxes_are_buckets_and_tanks(session: Session, case: str) -> None:
    built = session(
        "BuildWorld",
        case=case,
        objects=[{**BUCKET, "position": [0, 0, 1]}],
        obstacles=[{**BUCKET, "name": "tank", "position": [1, 0, 0.1]}],
    )
    assert built["data"]["representation"] == "spatial"
    assert "compound" in built["data"]["why"]
    assert set(built["data"]["statics"]) == {
        "floor",
        *(f"tank_{s}" for s in ("bottom", "left", "right", "front", "back")),
    }
    world = json.loads(session.store_document(built["source"]["world"]))
    # Five walls 1 cm thick: the box's volume less that of its inside.
    parts = world["objects"][0]["shape"]["parts"]
    volume = sum(8 * np.prod(part["shape"]["half_extents"]) for part in parts)
    assert volume == pytest.approx(0.2**3 - 0.18 * 0.18 * 0.19)
    mass = session("ReadProperty", case=case, property="mass", objects=["pail"])["data"]["values"][0]["value"]
    assert mass == pytest.approx(1000.0 * volume)


@pytest.mark.parametrize(
    ("parts", "complaint"),
    [
        ([{"name": "cord"}], "part 1 needs 'part', one of rope, cloth"),
        ([{"part": "string"}], "no part 'string' (did you mean 'spring'?)"),
        ([{"part": "rope", "points": [[0, 0, 0], [1, 0, 0]]}], "part 1 (rope): name is missing"),
        ([{"part": "rope", "name": "a"}], "rope 'a': points is missing; rope(name, points, [segments"),
        ([{**ROPE, "lenght": 2}], "part 1 (rope) has no lenght (did you mean 'length'?)"),
        ([{**ROPE, "radius": -1}], "rope 'cord': radius: Input should be greater than 0 (got -1)"),
        ([{**HOOK, "object": "line"}], "attachment 'hook' holds 'line', which is no rope"),
        ([ROPE, {**HOOK, "nodes": [3]}], "attachment 'hook': give exactly one of end, nodes, region"),
        ([WATER], "fluids ['water'] need a fluid_grid"),
        ([WATER, TANK, TANK], "give one fluid_grid"),
        ([{**TANK, "cell": 1.0}], "less than one cell"),
        ([{"part": "pulley", "name": "p", "rope": "cord", "centre": [0, 0, 0], "radius": 1, "after": 0}], "no rope is"),
        ([{"part": "hinge", "name": "h", "object": "door", "anchor": [0, 0, 0]}], "unknown objects ['door']"),
        ([ROPE, ROPE], "repeated: ['cord']"),
    ],
)
def test_parts_that_are_wrong_are_refused_with_what_is_right(
    session: Session, case: str, parts: list[Any], complaint: str
) -> None:
    assert complaint in session.refused(
        "BuildWorld", case=case, objects=[{**BUCKET, "position": [5, 0, 1]}], parts=parts
    )


def test_object_that_was_not_observed_needs_a_place(session: Session, case: str) -> None:
    complaint = session.refused("BuildWorld", case=case, objects=[BUCKET], parts=[ROPE])
    assert "needs a shape and a position" in complaint


def test_kinds_of_parts_are_described_one_by_one(session: Session) -> None:
    data = session("DescribeTool", tool="BuildWorld", argument="parts.rope")["data"]
    lines = {line["argument"]: line for line in data["fields"]}
    assert lines["points"]["required"]
    assert lines["linear_density"]["default"] == 0.05
    assert "[kg/m]" in lines["linear_density"]["description"]
    assert "no part 'string'" in session.refused("DescribeTool", tool="BuildWorld", argument="parts.string")


def test_inspection_lists_nodes_parameters_and_what_can_be_asked(session: Session, case: str) -> None:
    session("BuildWorld", case=case, parts=[ROPE, HOOK, JELLY])
    data = session("InspectWorld", case=case, fields=["shape", "parameters", "nodes"])["data"]
    cord, jelly = data["objects"]
    assert cord["nodes"]["of"] == 13
    assert cord["nodes"]["place"][-1] == pytest.approx([0.6, 0.0, 1.5])
    assert jelly["parameters"]["youngs_modulus"]["unit"] == "Pa"
    assert {"taut", "slack", "deformed", "occupies"} <= set(data["capabilities"]["predicates"])
    assert not {"folded", "holds"} & set(data["capabilities"]["predicates"])
    assert "release" in data["capabilities"]["edits"]
    assert "youngs_modulus" in data["capabilities"]["parameters"]["objects.jelly"]
    assert data["attachments"][0]["name"] == "hook"


def test_properties_of_materials_are_read_by_their_names(session: Session, case: str) -> None:
    session("BuildWorld", case=case, parts=[{**ROPE, "linear_density": 0.1}, JELLY])

    def value(property: str, **more: Any) -> Any:
        return [row["value"] for row in session("ReadProperty", case=case, property=property, **more)["data"]["values"]]

    assert value("mass") == pytest.approx([0.06, 8.0])
    assert value("length") == pytest.approx([0.6])
    assert value("poisson_ratio") == [0.4]
    assert value("objects.cord.stretch_stiffness") == [1e4]
    refusal = session.refused("ReadProperty", case=case, property="viscosity", objects=["cord"])
    assert "'cord' (rope) has no property 'viscosity'; its properties: length, mass" in refusal
    assert "no object has a 'viscosity'" in session.refused("ReadProperty", case=case, property="viscosity")


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, str, str]:
    """A committed world of a rope on a hook above jelly, and its rollout."""
    folder = tmp_path_factory.mktemp("pendulum")
    session = Session(folder / "atw.db")
    (folder / "nothing.csv").write_text("t,object,x,y,z\n")
    case = session("OpenCase", data=str(folder / "nothing.csv"))["case"]
    built = session("BuildWorld", case=case, parts=[{**ROPE, "bending_stiffness": 1e-4}, HOOK])
    session("CommitWorld", case=case, world=built["source"]["world"])
    rollout: str = session("Rollout", case=case, horizon_seconds=0.4)["data"]["rollout"]
    return session, case, rollout


def test_rope_is_read_along_its_line_and_by_its_nodes(pendulum: tuple[Session, str, str]) -> None:
    session, _, rollout = pendulum
    line = session("ReadTrajectory", rollout=rollout, object="cord", readout={"kind": "centreline", "count": 5})["data"]
    first = np.array(line["rows"][0][2])
    assert first == pytest.approx(np.linspace([0, 0, 1.5], [0.6, 0, 1.5], 5), abs=1e-6)
    nodes = session("ReadTrajectory", rollout=rollout, object="cord", nodes=[0, 12])["data"]
    held, free = np.array(nodes["rows"][-1][2])
    assert held == pytest.approx([0.0, 0.0, 1.5], abs=1e-6)
    assert free[2] < 1.3
    refusal = session.refused("ReadTrajectory", rollout=rollout, object="cord", nodes=[13])
    assert "'cord' has nodes 0..12, not [13]" in refusal
    refusal = session.refused("ReadTrajectory", rollout=rollout, object="cord", readout={"kind": "stretch"})
    assert "is read off cloth or soft" in refusal


def test_released_rope_falls_freely_and_the_comparison_says_so(pendulum: tuple[Session, str, str]) -> None:
    session, case, rollout = pendulum
    edits = [{"action": "release", "attachment": "hook"}]
    other = session("Rollout", case=case, horizon_seconds=0.4, edits=edits)
    end = session("ReadTrajectory", rollout=other["data"]["rollout"], object="cord")["data"]["rows"][-1]
    assert end[4] == pytest.approx(1.5 - 0.5 * 9.81 * 0.4**2, abs=0.005)
    data = session("CompareWorlds", base=rollout, edited=other["data"]["rollout"])["data"]["objects"][0]
    assert data["moves_differently"]
    assert data["largest_shape_distance"] > data["final_distance"]


def test_edits_of_what_is_not_there_are_refused(pendulum: tuple[Session, str, str]) -> None:
    session, case, _ = pendulum
    for edit, complaint in (
        ({"action": "release", "attachment": "nail"}, "attachments of this world: ['hook']"),
        ({"action": "set_parameter", "path": "objects.cord.viscosity", "value": 1}, "unknown parameter"),
        ({"action": "remove", "object": "hok"}, "did you mean"),
        ({"action": "set_velocity", "object": "cord", "angular_velocity": [0, 0, 1]}, "starts without turning"),
    ):
        refusal = session.refused("Rollout", case=case, edits=[edit], horizon_seconds=0.4)
        assert complaint in refusal


def test_pictures_show_the_rope_and_its_fastening(pendulum: tuple[Session, str, str]) -> None:
    session, case, rollout = pendulum

    async def look() -> Any:
        async with Client(session.server) as client:
            return await client.call_tool("InspectRollout", {"case": case, "rollout": rollout, "pictures": 2})

    shown = anyio.run(look)
    kinds = [part.type for part in shown.content]
    assert kinds.count("image") == 2
    data = json.loads(shown.content[0].text)["data"]
    assert "fastenings" in data["legend"]
    assert data["objects"][0]["name"] == "cord"


SIDE_VIEW = {"point": [0, 0, 0], "normal": [0, -1, 0]}
BASIN = {"part": "fluid_grid", "lower": [-0.25, -0.05, -0.05], "upper": [0.25, 0.05, 0.4], "cell": 0.02}
POOL = {
    "part": "fluid",
    "name": "water",
    "volumes": [{"shape": {"kind": "box", "half_extents": [0.2, 0.05, 0.075]}, "position": [0, 0, 0.075]}],
}
OPEN_TANK = {
    "name": "tank",
    "shape": {"kind": "open_box", "half_extents": [0.22, 0.1, 0.25], "thickness": 0.02},
    "position": [0, 0, 0.23],
}


def test_walls_ahead_of_and_behind_the_plane_leave_the_water_in_a_planar_tank(session: Session, case: str) -> None:
    built = session(
        "BuildWorld", case=case, motion_plane=SIDE_VIEW, parts=[POOL, BASIN], obstacles=[OPEN_TANK], floor="none"
    )
    assert built["data"]["deformables"][0]["area"] == pytest.approx(0.4 * 0.15, rel=0.02)
    assert built["data"]["statics"] == ["tank_bottom", "tank_left", "tank_right"]
    assert any("tank_front, tank_back left out" in note for note in built["data"]["assumed"])


def test_water_that_solids_or_grid_sides_take_is_reported_and_none_left_is_refused(session: Session, case: str) -> None:
    rock = {"name": "rock", "shape": {"kind": "box", "half_extents": [0.05, 0.1, 0.2]}, "position": [0, 0, 0.1]}
    built = session("BuildWorld", case=case, motion_plane=SIDE_VIEW, parts=[POOL, BASIN], obstacles=[rock])
    assert any("25% of its volume 1 is left out, covered by rock" in note for note in built["data"]["assumed"])
    rock["shape"] = {"kind": "box", "half_extents": [0.3, 0.3, 0.3]}
    refusal = session.refused("BuildWorld", case=case, motion_plane=SIDE_VIEW, parts=[POOL, BASIN], obstacles=[rock])
    assert "volume 1 is empty, covered by rock" in refusal


def test_a_body_over_a_closed_grid_without_a_bottom_is_warned_of(session: Session, case: str) -> None:
    stone = {"name": "stone", "shape": {"kind": "sphere", "radius": 0.03}, "position": [0, 0, 0.3]}
    wanted = "nothing solid is under stone"
    common = {"case": case, "motion_plane": SIDE_VIEW, "objects": [stone], "parts": [POOL, BASIN], "floor": "none"}
    alone = session("BuildWorld", **common)
    assert any(wanted in note for note in alone["data"]["assumed"])
    held = session("BuildWorld", **common, obstacles=[OPEN_TANK])
    assert not any(wanted in note for note in held["data"]["assumed"])


def test_a_body_far_from_the_rope_that_it_is_attached_to_is_named(session: Session, case: str) -> None:
    rope = {"part": "rope", "name": "rope", "points": [[0, 0, 1.5], [0, 0, 0.7]], "linear_density": 0.1}
    knot = {"part": "attachment", "name": "knot", "object": "rope", "end": "end", "to": "bead"}
    bead = {"name": "bead", "shape": {"kind": "sphere", "radius": 0.03}}
    for place, warned in (([0, 0, 0.67], False), ([1.2, 1.1, 0.03], True)):
        built = session("BuildWorld", case=case, objects=[{**bead, "position": place}], parts=[rope, knot])
        assert any("1.8 m from where rope is attached to it" in n for n in built["data"]["assumed"]) == warned


def test_the_box_a_rope_starts_in_holds_the_top_of_the_wheel_it_hangs_over(session: Session, case: str) -> None:
    rope = {**ROPE, "points": [[-0.1, 0, 0], [0.1, 0, 0]], "segments": 20}
    wheel = {"part": "pulley", "name": "w", "rope": "cord", "centre": [0, 0, 1], "radius": 0.1, "after": 0}
    built = session("BuildWorld", case=case, parts=[rope, wheel], floor="none")
    cord = built["data"]["deformables"][0]
    assert cord["wraps_deg"]["w"] == pytest.approx(180.0)
    assert cord["starts_in"][1] == pytest.approx([0.1, 0.0, 1.1], abs=1e-3)


def test_density_of_a_body_points_at_its_mass(session: Session, case: str) -> None:
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 1]}
    built = session("BuildWorld", case=case, objects=[ball])
    session("CommitWorld", case=case, world=built["source"]["world"])
    edit = {"action": "set_parameter", "path": "objects.ball.density", "value": 500}
    assert "did you mean 'objects.ball.mass'" in session.refused("Rollout", case=case, edits=[edit])


def test_the_shape_of_cloth_says_that_results_depend_on_its_resolution(session: Session) -> None:
    answer = session("DescribeTool", tool="BuildWorld", argument="parts.cloth.geometry")
    assert "resolution" in json.dumps(answer["data"])


def test_a_compound_in_a_planar_world_is_refused_in_words_of_the_tool(session: Session, case: str) -> None:
    pail = {**BUCKET, "position": [0, 0, 0.3]}
    refusal = session.refused("BuildWorld", case=case, representation="planar", motion_plane=SIDE_VIEW, objects=[pail])
    assert "compound shapes move in space only" in refusal
    assert "Value error" not in refusal
