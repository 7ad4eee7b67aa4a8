"""Overlaps at the start: depths against closed forms, and which pairs count."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.edits.interventions import Move, branch
from polyworld.probing.overlaps import overlaps
from polyworld.solver.rollout import rollout
from polyworld.world import Environment, MotionPlane, StaticObject, World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere
from tests.verification.coupled_world import FLOOR, VACUUM, sheet
from tests.verification.spatial_world import body, make_world


def depths(world: World) -> dict[tuple[str, str], float]:
    return {(o.a, o.b): o.depth for o in overlaps(world, rollout(world, 0.01))}


def test_a_ball_moved_into_another_is_reported_with_the_depth() -> None:
    world = make_world(body("a", Sphere(radius=0.1), (0, 0, 0.1)), body("b", Sphere(radius=0.1), (1, 0, 0.1)))
    assert depths(world) == {}
    (found,) = overlaps(edited := branch(world, [Move(object="b", position=(0.16, 0, 0.1))]), rollout(edited, 0.01))
    assert found.depth == pytest.approx(0.04, abs=1e-9)
    assert found.in_words() == "'a' and 'b' overlap by 0.04 m at 0 s"


def test_depths_of_turned_boxes_and_cylinders_are_the_shortest_way_out() -> None:
    """A box on its edge above a box; a can that leans on the floor; a box across a wall's corner."""
    half = 0.1 / np.sqrt(2.0)
    turned = (np.cos(np.pi / 8), 0.0, np.sin(np.pi / 8), 0.0)
    lean = (np.cos(0.15), np.sin(0.15), 0.0, 0.0)
    world = make_world(
        body("low", Box(half_extents=(0.3, 0.3, 0.1)), (0, 0, 0.1)),
        body("edge", Box(half_extents=(half, 0.1, half)), (0.05, 0.02, 0.27), orientation=turned),
        body("can", Cylinder(radius=0.1, half_height=0.2), (2, 0, 0.2), orientation=lean),
    )
    found = depths(world)
    assert found["low", "edge"] == pytest.approx(0.03, rel=0.01)
    assert found["can", "floor"] == pytest.approx(0.1 * np.sin(0.3) + 0.2 * np.cos(0.3) - 0.2, rel=1e-6)
    assert len(found) == 2


def test_what_touches_joined_bodies_and_planar_ones_at_other_heights_do_not_overlap() -> None:
    resting = body("resting", Box(half_extents=(0.1, 0.1, 0.1)), (0, 0, 0.0995))
    arm = body("arm", Box(half_extents=(0.2, 0.05, 0.05)), (1.1, 0, 1))
    base = body("base", Box(half_extents=(0.1, 0.1, 0.1)), (1, 0, 1))
    hinge = Hinge(name="hinge", object="arm", other="base", anchor=(1, 0, 1), axis=(0, 1, 0))
    world = make_world(resting, arm, base).model_copy(update={"joints": (hinge,)})
    assert depths(world) == {}
    cans = [
        RigidObject(
            name=name,
            representation="rigid_planar",
            shape=Cylinder(radius=0.1, half_height=0.05),
            position=(x, 0.0, z),
        )
        for name, x, z in (("a", 0.0, 0.05), ("b", 0.15, 0.05), ("above", 0.0, 0.2))
    ]
    flat = World(objects=tuple(cans), environment=Environment(motion_plane=MotionPlane()))
    assert depths(flat) == {("a", "b"): pytest.approx(0.05, abs=1e-9)}


def test_a_sheet_that_starts_in_a_ball_is_as_deep_as_its_deepest_node() -> None:
    cloth = sheet("cloth", (-0.2, -0.2, 0.5), 0.4, 0.4, (4, 4), thickness=0.002)
    ball = body("ball", Sphere(radius=0.2), (0, 0, 0.45))
    post = StaticObject(name="side", shape=Plane(normal=(1.0, 0.0, 0.0)), position=(-0.5, 0.0, 0.0))
    world = World(objects=(ball,), statics=(FLOOR, post), deformables=(cloth,), environment=VACUUM)
    (found,) = overlaps(world, rollout(world, 0.004))
    assert (found.a, found.b) == ("cloth", "ball")
    assert found.depth == pytest.approx(0.15, abs=0.02)
