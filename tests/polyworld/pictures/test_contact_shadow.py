"""Footprints on the floor: under what stands on it, with the object's shape, gone under what is in the air."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.pictures.contact_shadow import with_contact_shadows
from polyworld.pictures.render import look_at, render
from polyworld.world import StaticObject, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Plane, Sphere

CAMERA = look_at(np.array([0.0, -4.0, 2.5]), np.array([0.0, 0.0, 0.2]), focal=300.0, width=320, height=240)
FLOOR = StaticObject(name="floor", shape=Plane(normal=(0.0, 0.0, 1.0), offset=0.0))


def darkening(shape: Sphere | Box, height: float, statics: tuple[StaticObject, ...] = (FLOOR,)) -> np.ndarray:
    """Return the share of a pixel's light (H, W) that one object's shadow takes; check that only the floor darkens."""
    world = World(objects=(RigidObject(name="it", shape=shape, position=(0.0, 0.0, height)),), statics=statics)
    at, turn = np.array([[0.0, 0.0, height]]), np.array([[1.0, 0.0, 0.0, 0.0]])
    picture = render(world, at, turn, CAMERA)
    color = with_contact_shadows(world, at, turn, CAMERA, picture)
    assert np.array_equal(color[picture.labels != 1], picture.color[picture.labels != 1])
    taken: np.ndarray = 1.0 - color.max(axis=2) / np.maximum(picture.color.max(axis=2), 1)
    return taken


def at(taken: np.ndarray, x: float, y: float) -> float:
    """The value where the floor's point (x, y) [m] is seen."""
    u, v = CAMERA.project(np.array([x, y, 0.0]))
    return float(taken[round(float(v)), round(float(u))])


def test_standing_object_has_a_dark_foot_that_ends_a_little_way_off() -> None:
    taken = darkening(Box(half_extents=(0.3, 0.2, 0.2)), 0.2)
    assert at(taken, 0.31, -0.19) > 0.3  # beside the foot
    assert at(taken, 0.0, -0.21) > 0.3  # before it
    assert at(taken, 0.6, 0.0) == 0.0
    assert at(taken, 0.0, -0.5) == 0.0


def test_shadow_fades_with_height_and_is_gone_one_size_up() -> None:
    # Seen under a ball of 0.3 m from the side: more light the higher it is.
    seen = [at(darkening(Sphere(radius=0.3), 0.3 + gap), 0.0, -0.29) for gap in (0.0, 0.1, 0.2, 0.31)]
    assert seen[0] > seen[1] > seen[2] > 0.0
    assert seen[3] == 0.0


def test_box_shadow_follows_its_edges_not_a_circle() -> None:
    taken = darkening(Box(half_extents=(0.5, 0.1, 0.1)), 0.1)
    assert at(taken, 0.52, -0.05) > 0.3
    assert at(taken, 0.0, -0.4) == 0.0  # within the circle about it


@pytest.mark.parametrize(
    "statics", [(), (StaticObject(name="wall", shape=Plane(normal=(0.0, -1.0, 0.0), offset=-1.0)),)]
)
def test_without_a_floor_there_is_no_shadow(statics: tuple[StaticObject, ...]) -> None:
    assert not darkening(Sphere(radius=0.3), 0.3, statics).any()
