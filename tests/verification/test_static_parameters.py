"""Statics whose place differs from world to world of a batch: what hits them is reflected where they then stand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.parameters import read_parameter, with_parameters
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Box, Plane, Sphere, Wall

R = 0.1
SPEED = 2.0
KINDS = ("rigid_planar", "rigid_spatial")
SHAPES: dict[str, StaticObject] = {
    "plane": StaticObject(name="wall", shape=Plane(normal=(-1.0, 0.0, 0.0)), position=(1.0, 0.0, 0.0)),
    "tilted": StaticObject(name="wall", shape=Plane(normal=(-1.0, 0.5, 0.0), offset=-0.9), position=(0.1, 0.05, 0.0)),
    "box": StaticObject(name="wall", shape=Box(half_extents=(0.05, 2.0, 0.5)), position=(1.05, 0.2, 0.0)),
    "wall": StaticObject(name="wall", shape=Wall(start=(1.0, -1.5, -0.5), end=(1.1, 2.0, -0.5), height=1.0)),
}


def flight(wall: StaticObject, representation: Any, *, plane: MotionPlane | None = None) -> World:
    """A ball without friction or weight that flies at a wall along x."""
    ball = RigidObject(
        name="ball",
        representation=representation,
        shape=Sphere(radius=R),
        mass=1.0,
        friction=0.0,
        restitution=1.0,
        position=(0.0, 0.0, 0.0),
        velocity=(SPEED, 0.0, 0.0),
    )
    environment = Environment(gravity=(0.0, 0.0, 0.0), motion_plane=plane or MotionPlane())
    return World(objects=(ball,), statics=(wall,), environment=environment, time=TimeBase(substep=0.002))


def batch(world: World, overrides: dict[str, Any], end: float = 1.0) -> BatchTrajectory:
    values = {path: np.asarray(v, dtype=float) for path, v in overrides.items()}
    count = len(next(iter(values.values())))
    times = np.linspace(0.0, end, 41)
    return simulator(world, times, n_worlds=count, threads=2, record_events=True).run(values)


@pytest.mark.parametrize("representation", KINDS)
@pytest.mark.parametrize("shape", ["plane", "box"])
def test_a_ball_turns_back_where_each_worlds_wall_stands(representation: str, shape: str) -> None:
    shifts = np.array([-0.4, -0.1, 0.0, 0.25])
    wall = SHAPES[shape]
    found = batch(flight(wall, representation), {"statics.wall.position.x": wall.position[0] + shifts})
    for w, shift in enumerate(shifts):
        hit = (1.0 + shift - R) / SPEED
        assert found.events[w][0].time == pytest.approx(hit, abs=1e-5)
        expected = np.where(
            found.times[w] < hit, SPEED * found.times[w], 2.0 * (1.0 + shift - R) - SPEED * found.times[w]
        )
        np.testing.assert_allclose(found.positions[w, :, 0, 0], expected, atol=3e-5)


@pytest.mark.parametrize("representation", KINDS)
@pytest.mark.parametrize("shape", ["plane", "box", "wall"])
def test_a_turned_wall_reflects_about_its_turned_normal(representation: str, shape: str) -> None:
    angles = np.array([-0.3, 0.0, 0.2])
    found = batch(flight(SHAPES[shape], representation), {"statics.wall.rotation.z": angles})
    lean = np.arctan2(0.1, 3.5) if shape == "wall" else 0.0  # of the wall that runs from start to end
    for w, angle in enumerate(angles - lean):
        normal = np.array([-np.cos(angle), -np.sin(angle), 0.0])
        before = np.array([SPEED, 0.0, 0.0])
        np.testing.assert_allclose(found.velocities[w, -1, 0], before - 2.0 * (before @ normal) * normal, atol=1e-9)


@pytest.mark.parametrize("representation", KINDS)
@pytest.mark.parametrize("shape", list(SHAPES))
def test_a_pose_overridden_in_a_batch_is_that_of_a_world_so_described(representation: str, shape: str) -> None:
    world = flight(SHAPES[shape], representation)
    x = SHAPES[shape].position[0]
    edits = {"statics.wall.position.x": x - 0.2, "statics.wall.position.y": 0.3, "statics.wall.rotation.z": 0.15}
    found = batch(world, {path: [read_parameter(world, path), value] for path, value in edits.items()})
    described = with_parameters(world, edits)
    for w, alone in enumerate((world, described)):
        one = simulator(alone, np.linspace(0.0, 1.0, 41), threads=1).run()
        np.testing.assert_allclose(found.positions[w], one.positions[0], atol=1e-9)
        np.testing.assert_allclose(found.velocities[w], one.velocities[0], atol=1e-9)
    assert np.abs(found.positions[0] - found.positions[1]).max() > 0.1


def test_a_floor_seen_from_the_side_is_raised_and_tilted() -> None:
    plane = MotionPlane(normal=(0.0, -1.0, 0.0))  # x and z
    floor = StaticObject(name="wall", shape=Plane())
    ball = flight(floor, "rigid_planar", plane=plane).objects[0]
    ball = ball.model_copy(update={"position": (0.0, 0.0, 1.0), "velocity": (0.0, 0.0, -SPEED)})
    world = World(objects=(ball,), statics=(floor,), environment=Environment(gravity=(0, 0, 0), motion_plane=plane))
    found = batch(world, {"statics.wall.position.z": [0.0, 0.3], "statics.wall.rotation.y": [0.0, 0.2]})
    # Turned about +y, the normal leans towards +x, and the floor passes through its own position.
    assert found.events[1][0].time == pytest.approx((0.7 - R / np.cos(0.2)) / SPEED, abs=1e-5)
    np.testing.assert_allclose(found.velocities[1, -1, 0], [SPEED * np.sin(0.4), 0.0, SPEED * np.cos(0.4)], atol=1e-9)


def test_a_hidden_walls_place_and_turn_are_found_by_least_squares() -> None:
    from scipy.optimize import least_squares

    world = flight(SHAPES["plane"], "rigid_spatial")
    hidden = with_parameters(world, {"statics.wall.position.x": 0.83, "statics.wall.rotation.z": 0.07})
    times = np.linspace(0.0, 1.0, 41)
    data = simulator(hidden, times, threads=1).run().positions[0]
    runner = simulator(world, times, n_worlds=1, threads=1)

    def residual(values: Any) -> Any:
        given = {"statics.wall.position.x": values[:1], "statics.wall.rotation.z": values[1:]}
        return (runner.run(given).positions[0] - data).ravel()

    found = least_squares(residual, [1.0, 0.0], diff_step=1e-4)
    np.testing.assert_allclose(found.x, [0.83, 0.07], atol=1e-5)


def test_worlds_with_deformable_objects_refuse_statics_that_differ() -> None:
    rope = Rope(name="rope", points=((0.0, 0.0, 1.0), (0.5, 0.0, 1.0)), radius=0.01)
    world = World(deformables=(rope,), statics=(SHAPES["box"],))
    assert read_parameter(with_parameters(world, {"statics.wall.position.x": 2.0}), "statics.wall.position.x") == 2.0
    with pytest.raises(ValueError, match="set it with set_parameter"):
        batch(world, {"statics.wall.position.x": [2.0]}, end=0.1)


@pytest.mark.parametrize("representation", KINDS)
@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_a_ball_rebounds_from_a_dominant_wall_with_the_walls_restitution(representation: str, shape: str) -> None:
    wall = SHAPES[shape].model_copy(update={"restitution": 0.87})
    restitutions = {"statics.wall.restitution": [0.87, 0.0, 0.3, 1.0]}
    for dominant, expected in ((True, [0.87, 0.0, 0.3, 1.0]), (False, np.sqrt([0.6 * 0.87, 0.0, 0.6 * 0.3, 0.6]))):
        world = flight(wall.model_copy(update={"dominant": dominant}), representation)
        world = world.model_copy(update={"objects": (world.objects[0].model_copy(update={"restitution": 0.6}),)})
        motion = batch(world, restitutions)
        change = np.linalg.norm(motion.velocities[:, -1, 0] - motion.velocities[:, 0, 0], axis=1)
        approach = change[1]  # of no rebound
        np.testing.assert_allclose(change / approach - 1.0, expected, atol=1e-6)
        alone = simulator(world, np.linspace(0.0, 1.0, 41)).run()
        np.testing.assert_allclose(alone.velocities[0, -1], motion.velocities[0, -1], atol=1e-12)


@pytest.mark.parametrize("representation", KINDS)
def test_a_puck_slides_along_a_dominant_floor_by_the_floors_friction_or_its_own_where_that_has_none(
    representation: str,
) -> None:
    floor = StaticObject(name="floor", shape=Plane(normal=(0.0, 1.0, 0.0)), dominant=True, friction=0.3)
    for friction in (0.3, None):
        for own in (0.05, 0.8):
            puck = RigidObject(
                name="puck",
                representation=representation,  # type: ignore[arg-type]
                shape=Box(half_extents=(R, R, R)),
                friction=own,
                restitution=0.0,
                position=(0.0, R, 0.0),
                velocity=(4.0, 0.0, 0.0),
            )
            world = World(
                objects=(puck,),
                statics=(floor.model_copy(update={"friction": friction}),),
                environment=Environment(gravity=(0.0, -9.81, 0.0)),
                time=TimeBase(substep=0.002),
            )
            motion = simulator(world, np.array([0.0, 0.2])).run()
            lost = 4.0 - motion.velocities[0, -1, 0, 0]
            assert lost == pytest.approx((own if friction is None else friction) * 9.81 * 0.2, rel=5e-3)
