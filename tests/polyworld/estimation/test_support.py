"""Which bodies a surface supports, and how they begin on it: known scenes with noise of the size of a track's."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.support import supports, with_supports
from polyworld.solver.rollout import simulator
from polyworld.world import Environment, MotionPlane, StaticObject, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder
from tests.polyworld.estimation.floor_scenes import (
    FLOOR,
    GRAVITY,
    RADIUS,
    ball,
    box,
    frames,
    scene,
    slowed,
    tracks_of,
    upright,
)
from tests.polyworld.synthetic import of_one

COUNT = 20
TILT = 0.3  # [rad] of a ramp
SEEDS = range(5)


def still(z: float = RADIUS, x: float = 0.0) -> np.ndarray:
    return np.tile([x, 0.0, z], (COUNT, 1))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_ball_on_the_floor_begins_in_contact_and_rolls_without_slip(seed: int) -> None:
    tracks = tracks_of({"ball": slowed(frames(COUNT), 0.8, 0.2)}, seed=seed)
    start = scene([ball()], tracks)
    assert start.object("ball").velocity[2] != 0.0  # noise
    placed = with_supports(start, tracks).object("ball")
    assert placed.position[2] == pytest.approx(RADIUS, abs=1e-12)
    assert placed.velocity[2] == pytest.approx(0.0, abs=1e-12)
    v = np.asarray(placed.velocity)
    at_contact = v + np.cross(placed.angular_velocity, [0.0, 0.0, -RADIUS])
    assert at_contact == pytest.approx(np.zeros(3), abs=1e-12)
    assert v[0] == pytest.approx(0.8, abs=0.05)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_box_lies_flat_and_turns_about_the_vertical_alone(seed: int) -> None:
    turns = geometry.rotation_quaternion(frames(COUNT)[:, None] * [0.0, 0.0, 2.0])
    tracks = tracks_of({"box": slowed(frames(COUNT), 1.5, 2.0)}, orientations={"box": turns}, seed=seed)
    placed = with_supports(scene([box()], tracks), tracks).object("box")
    up = geometry.quaternion_matrix(np.asarray(placed.orientation))[2]
    assert np.abs(up).max() == pytest.approx(1.0, abs=1e-12)
    assert placed.angular_velocity[:2] == (0.0, 0.0)
    assert placed.angular_velocity[2] == pytest.approx(2.0, abs=0.6)
    assert placed.velocity[2] == pytest.approx(0.0, abs=1e-12)


def test_bodies_seen_within_the_floor_of_a_side_view_stay_on_it() -> None:
    """They are nearer to the camera than the plane of motion, and nothing shows how fast they are vertically."""
    path = still(z=0.7 * RADIUS) + 0.3 * frames(COUNT)[:, None] * [1.0, 0.0, 0.0]
    rest = still(z=0.7 * RADIUS, x=-1.0)
    tracks = tracks_of({"ball": path, "box": rest}, orientations={"box": upright(COUNT)}, seed=1)
    side = MotionPlane(normal=(0.0, -1.0, 0.0))
    environment = Environment(gravity=(0.0, 0.0, -GRAVITY), motion_plane=side)
    planar = [body.model_copy(update={"representation": "rigid_planar"}) for body in (ball(), box())]
    found = fit(of_one(scene(planar, tracks, environment=environment), tracks), FitOptions(members=32)).runs[0]
    later = simulator(found.start, np.array([0.0, 1.0]), n_worlds=32).run(found.sample).positions[:, 1]
    assert later[:, :, 2] == pytest.approx(np.full((32, 2), RADIUS), abs=1e-3)
    assert np.abs(later[:, :, 0] - [0.3, -1.0]).max() < 0.1


def test_what_flies_falls_or_hovers_is_not_supported() -> None:
    t = frames(COUNT)
    up = still() + np.stack([0 * t, 0 * t, 2.0 * t - GRAVITY / 2 * t**2], axis=1)
    tracks = tracks_of({"up": up, "high": still(z=0.4, x=1.0), "down": still(0.9) - up * [0, 0, 1]})
    world = scene([ball("up"), ball("high"), ball("down")], tracks)
    assert supports(world, tracks) == {}


def test_a_slow_rise_from_the_floor_is_seen_before_the_body_has_left_it() -> None:
    """After 0.76 s at 20 mm/s it is 15 mm up, within the tolerance of a mean height."""
    t = frames(COUNT)
    tracks = tracks_of({"ball": still() + np.stack([0 * t, 0 * t, 0.02 * t], axis=1)}, sigma=0.001)
    assert supports(scene([ball()], tracks), tracks) == {}


def ramp() -> StaticObject:
    turn = geometry.rotation_quaternion(np.array([0.0, TILT, 0.0]))
    return StaticObject(name="ramp", shape=Box(half_extents=(2.0, 0.5, 0.05)), orientation=tuple(turn.tolist()))


def test_a_ball_on_a_ramp_begins_along_it() -> None:
    """From rest it rolls at 5/7 g sin(tilt)."""
    t, down = frames(COUNT), np.array([np.cos(TILT), 0.0, -np.sin(TILT)])
    normal = np.array([np.sin(TILT), 0.0, np.cos(TILT)])
    way = 5.0 / 14.0 * GRAVITY * np.sin(TILT) * t**2 + 0.3 * t
    tracks = tracks_of({"ball": (0.05 + RADIUS) * normal + way[:, None] * down})
    world = scene([ball()], tracks, statics=[ramp()])
    found = supports(world, tracks)["ball"]
    assert (found.static, found.rolls) == ("ramp", True)
    assert found.normal == pytest.approx(normal, abs=1e-12)
    placed = with_supports(world, tracks).object("ball")
    assert normal @ np.asarray(placed.velocity) == pytest.approx(0.0, abs=1e-12)
    assert down @ np.asarray(placed.velocity) == pytest.approx(0.3, abs=0.1)


def test_what_lies_on_a_box_is_supported_by_it_and_what_lies_beside_it_by_the_floor() -> None:
    table = StaticObject(name="table", shape=Box(half_extents=(0.3, 0.3, 0.2)), position=(0.0, 0.0, 0.2))
    tracks = tracks_of({"on": still(z=0.4 + RADIUS), "beside": still(x=0.6)})
    found = supports(scene([ball("on"), ball("beside")], tracks, statics=[FLOOR, table]), tracks)
    assert {name: support.static for name, support in found.items()} == {"on": "table", "beside": "floor"}


@pytest.mark.parametrize(("lies", "height", "rolls"), [(False, 0.08, False), (True, 0.05, True)])
def test_a_cylinder_stands_on_its_end_or_rolls_about_its_axis(lies: bool, height: float, rolls: bool) -> None:
    can = ball("can", shape=Cylinder(radius=0.05, half_height=0.08))
    turn = geometry.rotation_quaternion(np.array([np.pi / 2 if lies else 0.0, 0.0, 0.0]))
    tracks = tracks_of({"can": still(z=height)}, orientations={"can": np.tile(turn, (COUNT, 1))})
    found = supports(scene([can], tracks), tracks)["can"]
    assert found.rolls is rolls
    assert found.position[2] == pytest.approx(height, abs=1e-12)
    if lies:
        assert found.axis is not None
        assert abs(found.axis[1]) == pytest.approx(1.0, abs=0.01)
        assert found.axis[2] == pytest.approx(0.0, abs=1e-12)


def ramp_scene(shape: Cylinder | Box, turn: np.ndarray) -> tuple[World, ObservedTracks]:
    """A body that goes down a slope of TILT as a solid cylinder that rolls (2/3 g sin), turned by 0.1 rad of noise."""
    down = np.array([np.cos(TILT), 0.0, -np.sin(TILT)])
    normal = np.array([np.sin(TILT), 0.0, np.cos(TILT)])
    height = shape.radius if isinstance(shape, Cylinder) else shape.half_extents[2]
    slab = StaticObject(
        name="ramp",
        shape=Box(half_extents=(3.0, 1.0, 0.1)),
        position=tuple(-0.1 * normal),
        orientation=tuple(geometry.rotation_quaternion(np.array([0.0, TILT, 0.0]))),
    )
    way = 0.5 * frames(COUNT) + GRAVITY * np.sin(TILT) / 3.0 * frames(COUNT) ** 2
    places = height * normal + np.outer(way, down)
    turns = np.tile(turn, (COUNT, 1))
    if isinstance(shape, Cylinder):
        rolled = geometry.rotation_quaternion(np.outer(way / height, [0.0, 1.0, 0.0]))
        turns = geometry.quaternion_product(rolled, turns)
    tracks = tracks_of({"body": places}, orientations={"body": turns}, turn_sigma=0.1, seed=3)
    item = RigidObject(name="body", shape=shape, position=tuple(places[0]), orientation=tuple(turn))
    return scene([item], tracks, statics=(slab,)), tracks


LYING = geometry.quaternion_product(
    geometry.rotation_quaternion(np.array([0.0, TILT, 0.0])),
    geometry.rotation_quaternion(np.array([np.pi / 2, 0.0, 0.0])),
)
FLAT = geometry.rotation_quaternion(np.array([0.0, TILT, 0.0]))
"""Orientations on the slope: a cylinder's axis along y, a box on its face."""


@pytest.mark.parametrize(
    ("shape", "turn"), [(Cylinder(radius=0.05, half_height=0.05), LYING), (Box(half_extents=(0.05,) * 3), FLAT)]
)
def test_a_body_on_a_slope_is_fitted_without_what_the_slope_forbids(shape: Cylinder | Box, turn: np.ndarray) -> None:
    """Its orientation is known to 0.1 rad a frame: neither hops nor wobbles are fitted to that noise."""
    world, tracks = ramp_scene(shape, turn)
    found = fit(of_one(world, tracks), FitOptions(share=0.0)).runs[0].world.object("body")
    normal, down = np.array([np.sin(TILT), 0.0, np.cos(TILT)]), np.array([np.cos(TILT), 0.0, -np.sin(TILT)])
    height = shape.radius if isinstance(shape, Cylinder) else shape.half_extents[2]
    assert normal @ np.asarray(found.position) == pytest.approx(height, abs=1e-9)
    assert normal @ np.asarray(found.velocity) == pytest.approx(0.0, abs=1e-9)
    assert down @ np.asarray(found.velocity) == pytest.approx(0.5, abs=0.1)
    axes = geometry.quaternion_matrix(np.asarray(found.orientation))
    assert np.abs(axes.T @ normal).max() == pytest.approx(1.0, abs=1e-9) or abs(axes[:, 2] @ normal) < 1e-9
    if isinstance(shape, Cylinder):
        assert abs(np.cross(normal, axes[:, 2]) @ np.asarray(found.angular_velocity)) < 0.1
