"""Known objects and tracks: which is which, how surely, and what is left over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import CSS4_COLORS, to_rgb

from atw_mcp.observation.matching import Known, Matching, apparent_radius, matched
from atw_mcp.perception.known_scene import Sized as Solid
from atw_mcp.perception.observation import Cue, ObservedObject
from atw_mcp.perception.sizes import SolidEstimate
from polyworld.world.shapes import Box, Cylinder, Sphere

ELEVATION = np.deg2rad(35)
BALL, CAN, CUBE = Sphere(radius=0.1), Cylinder(radius=0.1, half_height=0.1), Box(half_extents=(0.1, 0.1, 0.1))
KINDS = {Sphere: "sphere", Cylinder: "cylinder", Box: "cube"}


def track(name: str, colour: str, kind: str, material: str = "rubber", left: float = 10.0) -> ObservedObject:
    return ObservedObject(
        name=name,
        colour=Cue(colour, 0.9, dict(zip("rgb", (255 * c for c in to_rgb(CSS4_COLORS[colour])), strict=True))),
        material=Cue(material, 0.6, {}),
        shape=Cue(kind, 0.9, {}),
        status=("visible",) * 3,
        confidence=np.ones(3),
        centroid=np.tile([left + 5.0, 15.0], (3, 1)),
        box=np.tile([left, 10.0, 10.0, 10.0], (3, 1)),
        area=np.full(3, 80),
        masks=(None,) * 3,
        entry_frame=0,
        exit_frame=2,
        enters=False,
        exits=False,
    )


def estimate(solid: Solid) -> SolidEstimate:
    misfits = {kind: 0.3 if kind == KINDS[type(solid)] else 0.8 for kind in KINDS.values()}
    return SolidEstimate(solid, (0.001,), 0.3, misfits, 0.95, 14)


def pairs(found: Matching) -> dict[str, str]:
    return {match.known: match.track for match in found.matches}


def match(known: list[Known], seen: dict[str, tuple[ObservedObject, Any]]) -> Matching:
    solids = {name: estimate(solid) for name, (_, solid) in seen.items()}
    return matched(known, [item for item, _ in seen.values()], solids, float(ELEVATION))


def test_colour_decides_between_equal_shapes_whatever_the_tracks_are_called() -> None:
    known = [Known("a", BALL, "red"), Known("b", BALL, "blue")]
    seen = {"a": (track("a", "blue", "sphere"), BALL), "b": (track("b", "red", "sphere"), BALL)}
    found = match(known, seen)
    assert pairs(found) == {"a": "b", "b": "a"}
    assert all(item.confidence > 0.95 for item in found.matches)
    assert found.doubts == []


def test_shape_size_and_material_decide_between_equal_colours() -> None:
    small = Sphere(radius=0.05)
    known = [
        Known("can", CAN, "gray"),
        Known("ball", BALL, "gray"),
        Known("marble", small, "gray"),
        Known("shot", BALL, "gray", "metal"),
    ]
    seen: dict[str, tuple[ObservedObject, Any]] = {
        "t1": (track("t1", "gray", "sphere"), small),
        "t2": (track("t2", "gray", "sphere", "metal"), BALL),
        "t3": (track("t3", "gray", "cylinder"), CAN),
        "t4": (track("t4", "gray", "sphere"), BALL),
    }
    assert pairs(match(known, seen)) == {"can": "t3", "ball": "t4", "marble": "t1", "shot": "t2"}


def test_hints_are_read_from_names() -> None:
    item = Known("shiny_grey_ball")
    assert (item.colour, item.stuff, item.kind) == ("grey", "metal", "sphere")
    assert Known("teal_thing", CAN).colour == "cyan"


def test_equal_objects_are_doubted_until_a_pixel_distinguishes_them() -> None:
    seen = {"t1": (track("t1", "red", "sphere", left=10), BALL), "t2": (track("t2", "red", "sphere", left=90), BALL)}
    known = [Known("a", BALL, "red"), Known("b", BALL, "red")]
    doubted = match(known, seen)
    assert [item.confidence for item in doubted.matches] == pytest.approx([0.5, 0.5])
    assert len(doubted.doubts) == 2
    sure = match([replace(known[0], pixel=(95.0, 15.0)), known[1]], seen)
    assert pairs(sure) == {"a": "t2", "b": "t1"}
    assert sure.doubts == []


def test_what_has_no_counterpart_is_said_and_not_forced() -> None:
    known = [Known("ball", BALL, "red"), Known("ghost", Sphere(radius=0.5), "purple")]
    seen = {"t1": (track("t1", "red", "sphere"), BALL), "t2": (track("t2", "yellow", "cube"), CUBE)}
    found = match(known, seen)
    assert pairs(found) == {"ball": "t1"}
    assert (found.unseen, found.unlisted) == (("ghost",), ("t2",))
    assert any("no track fits ghost" in doubt for doubt in found.doubts)
    assert matched(known, [], {}, 0.5).unseen == ("ball", "ghost")


def test_sizes_that_are_all_off_by_one_factor_point_at_the_camera() -> None:
    seen = {
        "t1": (track("t1", "red", "sphere"), Sphere(radius=0.2)),
        "t2": (track("t2", "blue", "sphere"), Sphere(radius=0.2)),
    }
    found = match([Known("a", BALL, "red"), Known("b", BALL, "blue")], seen)
    assert pairs(found) == {"a": "t1", "b": "t2"}
    assert any("check the camera" in doubt for doubt in found.doubts)


def test_apparent_radius_is_that_of_the_projected_area() -> None:
    # Seen from above a can is its base, from the side its rectangle.
    assert apparent_radius(CAN, np.pi / 2) == pytest.approx(0.1)
    assert apparent_radius(CAN, 0.0) == pytest.approx(np.sqrt(0.04 / np.pi))
    turns = np.linspace(0, np.pi / 2, 1001)
    width = np.mean(0.2 * (np.cos(turns) + np.sin(turns)))  # of a cube turned about the vertical
    assert apparent_radius(CUBE, 0.0) == pytest.approx(np.sqrt(width * 0.2 / np.pi), rel=1e-3)
