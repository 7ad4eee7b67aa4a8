"""The stepper beside the simulators it must agree with: in space, and locked to a plane."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from polyworld.model import model_of
from polyworld.solver.rollout import simulator
from polyworld.solver.spatial.simulator import SpatialSimulator
from polyworld.solver.spatial.stepper import RigidStepper
from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World, geometry
from polyworld.world.representations.joint import Fixed, Hinge, Slider
from polyworld.world.shapes import Box, Capsule, Plane, Sphere
from tests.scenes.six_bodies import six_body_world
from tests.verification.joint_scenes import body, turned

Array = NDArray[np.float64]

STEP = 0.002
SIDE = MotionPlane(normal=(0.0, -1.0, 0.0), supports=False)


def step_through(world: World, steps: int, n_worlds: int = 1, overrides: Any = None) -> tuple[RigidStepper, Array]:
    """A stepper after `steps` steps, and the objects' positions (steps + 1, W, n, 3)."""
    stepper = RigidStepper(model_of(world), n_worlds, record_events=True)
    if overrides:
        stepper.write(model_of(world).arrays(overrides))
    stepper.reset()
    time = wp.zeros(n_worlds, dtype=wp.float64, device="cpu")
    h = wp.full(n_worlds, STEP, dtype=wp.float64, device="cpu")
    with wp.ScopedCapture(device="cpu") as capture:
        stepper.launch_step(time, h)
    seen = []
    for _ in range(steps + 1):
        seen.append(stepper.bodies.numpy()["x"][:, : len(world.objects)].copy())
        wp.capture_launch(capture.graph)
        time.numpy()[:] += STEP
    return stepper, np.array(seen)


def test_steps_one_by_one_make_the_run_of_the_simulator() -> None:
    """Six bodies for a second, three variants: to rounding, with the same contacts."""
    world = six_body_world(planar=False)
    name = world.objects[0].name
    overrides = {f"objects.{name}.mass": np.array([0.5, 1.0, 2.0])}
    stepper, found = step_through(world, 500, 3, overrides)
    run = SpatialSimulator(model_of(world), np.arange(51) * 0.02, n_worlds=3, record_events=True, threads=1).run(
        overrides
    )
    np.testing.assert_allclose(found[::10].swapaxes(0, 1), run.positions, atol=1e-9)
    assert np.all(stepper.diverged() == -1)
    for w in range(3):
        assert [e.participants for e in stepper.events(w, 1.0)] == [e.participants for e in run.events[w]]


def side_view(*objects: Any, joints: tuple[Hinge, ...] = (), statics: tuple[StaticObject, ...] = ()) -> World:
    planar = tuple(o.model_copy(update={"representation": "rigid_planar"}) for o in objects)
    return World(
        objects=planar,
        joints=joints,
        statics=statics,
        environment=Environment(motion_plane=SIDE),
        time=TimeBase(substep=STEP),
    )


def planar_run(world: World, steps: int) -> Array:
    motion = simulator(world, np.arange(steps + 1) * STEP, threads=1).run()
    return motion.positions[0]


def test_locked_bodies_bounce_and_roll_as_in_the_planar_solver() -> None:
    """A box, a ball and a lying capsule dropped on an incline, in the x-z plane: 0.4 s, within 2e-3 m, no y at all."""
    slope = StaticObject(name="slope", shape=Plane(normal=(np.sin(0.2), 0.0, np.cos(0.2))))
    world = side_view(
        body("box", Box(half_extents=(0.1, 0.3, 0.1)), (0, 0, 0.3), orientation=turned((0, 1, 0), 0.4)),
        body("ball", Sphere(radius=0.1), (1.0, 0, 0.1), angular_velocity=(0, 3.0, 0)),
        body("rod", Capsule(radius=0.05, half_height=0.2), (2.0, 0, 0.2)),
        statics=(slope,),
    )
    _, found = step_through(world, 200)
    np.testing.assert_array_equal(found[:, 0, :, 1], 0.0)
    np.testing.assert_allclose(found[:, 0], planar_run(world, 200), atol=2e-3)


def test_a_locked_pendulum_swings_as_in_the_planar_solver() -> None:
    """Hinged far from its centre, whatever the hinge's axis says: two seconds within 1e-4 m."""
    rod = body("rod", Box(half_extents=(0.5, 0.1, 0.03)), (0.45, 0, 0))
    world = side_view(rod, joints=(Hinge(name="pivot", object="rod", anchor=(0, 0, 0)),))
    _, found = step_through(world, 1000)
    np.testing.assert_allclose(found[:, 0], planar_run(world, 1000), atol=1e-4)


def test_a_locked_body_turns_with_the_inertia_about_the_normal_only() -> None:
    """A tilted brick pushed off its centre: dw = r p / (n I n); no other turning, whatever its products of inertia."""
    shape = Box(half_extents=(0.3, 0.1, 0.05))
    tilt = turned((0.6, 0.0, 0.8), 0.7)
    stepper = RigidStepper(model_of(side_view(body("brick", shape, (0, 0, 0), orientation=tilt))), 1)
    stepper.reset()
    row = stepper.bodies.numpy()[0, 0]
    turn = geometry.quaternion_matrix(np.asarray(tilt))
    solid = geometry.mass_properties(shape)
    normal = np.array([0.0, -1.0, 0.0])
    moment = normal @ turn @ (solid.inertia / solid.volume) @ turn.T @ normal
    np.testing.assert_allclose(row["inverse_inertia"], np.outer(normal, normal) / moment, rtol=1e-12)
    stepper.bodies.numpy()["push_torque"][0, 0] = (1.0, 2.0, 3.0)
    stepper.bodies.numpy()["push"][0, 0] = (0.0, 5.0, 0.0)
    stepper.launch_step(*(wp.full(1, value, dtype=wp.float64, device="cpu") for value in (0.0, STEP)))
    after = stepper.bodies.numpy()[0, 0]
    np.testing.assert_allclose(after["w"], (0.0, 2.0 * STEP / moment, 0.0), rtol=1e-12)
    assert after["v"][1] == 0.0
    assert after["v"][2] == pytest.approx(-9.81 * STEP)


def test_a_locked_slider_runs_along_its_axis_and_a_fixed_part_goes_with_it() -> None:
    """45 degrees down in the plane, with a brick fixed to the side of the one that slides: a = g sin 45, no turning."""
    cube = Box(half_extents=(0.1, 0.1, 0.1))
    slope = (float(np.sqrt(0.5)), 0.0, -float(np.sqrt(0.5)))
    a, b = (
        body(name, cube, (x, 0, 0)).model_copy(update={"representation": "rigid_planar"})
        for name, x in (("a", 0.0), ("b", 0.2))
    )
    world = World(
        objects=(a, b),
        joints=(
            Slider(name="rail", object="a", anchor=(0, 0, 0), axis=slope),
            Fixed(name="weld", object="b", other="a", anchor=(0.1, 0, 0)),
        ),
        environment=Environment(motion_plane=SIDE),
    )
    _, found = step_through(world, 200)
    t = np.arange(201) * STEP
    path = 0.25 * 9.81 * t**2
    np.testing.assert_allclose(found[:, 0, 0], np.stack([path, 0 * t, -path], axis=1), atol=1e-10)
    np.testing.assert_allclose(found[:, 0, 1] - found[:, 0, 0], np.tile((0.2, 0, 0), (201, 1)), atol=1e-10)
