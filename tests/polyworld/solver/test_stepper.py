"""Worlds stepped under control, saved, and gone on with: the same motion to the bit, and Newton's laws for control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polyworld import Control, SavedState, World, rollout, state_at, stepper
from polyworld.world import Environment, StaticObject
from polyworld.world.representations.joint import Hinge, Motor
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Box, Plane, Sphere
from tests.scenes.six_bodies import six_body_world
from tests.verification.joint_scenes import body, linked

MOTION = ("times", "positions", "orientations", "velocities", "angular_velocities")
FRAME = 0.04


def pendulum(motor: Motor | None = None) -> World:
    """Two rods in a row on hinges about y, the second damped, held by a motor."""
    rod = Box(half_extents=(0.2, 0.05, 0.05))
    upper, lower = body("upper", rod, (0.2, 0, 0)), body("lower", rod, (0.6, 0, 0))
    first = Hinge(name="shoulder", object="upper", anchor=(0, 0, 0), axis=(0, 1, 0), motor=motor)
    second = Hinge(name="elbow", object="lower", other="upper", anchor=(0.4, 0, 0), axis=(0, 1, 0), damping=0.01)
    return linked(upper, lower, joints=(first, second))


def late_world() -> World:
    """A ball that joins at 0.5 s, between two samples, over one that lies on the floor."""
    floor = StaticObject(name="floor", shape=Plane())
    low, high = body("low", Sphere(radius=0.1), (0, 0, 0.1)), body("high", Sphere(radius=0.1), (0.01, 0, 0.5))
    return linked(low, high.model_copy(update={"start_time": 0.5}), joints=()).model_copy(update={"statics": (floor,)})


WORLDS = {
    "planar": six_body_world(planar=True),
    "spatial": six_body_world(planar=False),
    "joints": pendulum(),
    "late": late_world(),
}


@pytest.mark.parametrize("name", WORLDS)
def test_a_saved_run_goes_on_as_if_it_had_not_stopped(name: str) -> None:
    """To the bit, motion and contact events, through bytes, wherever it was stopped: before, in and after contacts."""
    world = WORLDS[name]
    whole = rollout(world, 2.0)
    contacts = [e for e in whole.events if e.kind.startswith("contact")]
    for frame in (0, 7, 12, 15, 30):
        saved = SavedState.from_bytes(state_at(world, frame * FRAME).to_bytes())
        rest = rollout(world, 2.0, start=saved)
        for field in MOTION:
            np.testing.assert_array_equal(getattr(rest.trajectory, field), getattr(whole.trajectory, field)[frame:])
        after = [e for e in contacts if e.time >= saved.time]
        assert [e for e in rest.events if e.kind.startswith("contact")] == after


@pytest.mark.parametrize("name", WORLDS)
def test_steps_are_those_of_the_rollout(name: str) -> None:
    world = WORLDS[name]
    whole = rollout(world, 2.0)
    run = stepper(world)
    states = [run.state, *(run.step() for _ in range(50))]
    np.testing.assert_array_equal([s.positions for s in states], whole.trajectory.positions)
    np.testing.assert_array_equal([s.angular_velocities for s in states], whole.trajectory.angular_velocities)
    assert list(run.events()) == [e for e in whole.events if e.kind.startswith("contact")]


def test_a_stepper_returns_to_a_state_and_repeats_what_followed() -> None:
    """Also under control, whose last values do not outlast their interval."""
    run = stepper(pendulum(Motor(limit=0.0)), interval=0.01)
    push = lambda state: Control(efforts={"shoulder": np.sin(state.time)}, forces={"lower": (0, 1.0, 2.0)})  # noqa: E731
    run.step(10, control=push)
    saved = run.save()
    first = run.step(10, control=push)
    run.step(5)
    run.reset(saved)
    np.testing.assert_array_equal(run.step(10, control=push).positions, first.positions)
    run.reset(saved)
    alone = run.step(10).positions
    assert np.abs(alone - first.positions).max() > 1e-3
    np.testing.assert_array_equal(stepper(run.world, interval=0.01, start=saved).step(10).positions, alone)


@pytest.mark.parametrize("planar", [True, False])
def test_a_force_and_a_torque_accelerate_a_body_by_newtons_law(planar: bool) -> None:
    """One interval of each, exact to rounding: x = F t^2 / 2 m, then uniform motion; the turn likewise."""
    ball = body("ball", Sphere(radius=0.1), (0, 0, 0)).model_copy(update={"mass": 2.0})
    world = World(
        objects=(ball.model_copy(update={"representation": "rigid_planar" if planar else "rigid_spatial"}),),
        environment=Environment(gravity=(0, 0, 0)),
    )
    run = stepper(world, interval=0.1)
    run.step(control=lambda _: Control(forces={"ball": (3.0, 4.0, 0)}, torques={"ball": (0, 0, 0.05)}))
    np.testing.assert_allclose(run.state.velocities[0], (0.15, 0.2, 0), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(run.state.positions[0], (0.0075, 0.01, 0), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(run.state.angular_velocities[0], (0, 0, 0.05 * 0.1 / (0.4 * 2.0 * 0.01)), rtol=1e-12)
    run.step(control=lambda _: None)
    np.testing.assert_allclose(run.state.positions[0], (0.0225, 0.03, 0), rtol=1e-12, atol=1e-15)


def test_a_force_on_jointed_bodies_is_like_weight() -> None:
    """Gravity turned off and replaced by forces m g on both rods of a pendulum: the same swing within 1e-6 m."""
    world = pendulum()
    still = world.model_copy(update={"environment": Environment(gravity=(0, 0, 0))})
    weights = {o.name: (0.0, 0.0, -9.81) for o in world.objects}  # of 1 kg each
    run = stepper(still, interval=0.02)
    run.step(40, control=lambda _: Control(forces=weights))
    np.testing.assert_allclose(run.state.positions, rollout(world, 0.8).trajectory.positions[-1], atol=1e-6)


def test_a_motor_under_control_acts_as_one_that_the_world_describes() -> None:
    """A constant effort given as control, and as the motor's limit: the same swing within 1e-9 m; likewise a speed."""
    for described, left, control in (
        (Motor(limit=12.0, reverse=True), Motor(limit=0.0), Control(efforts={"shoulder": -12.0})),
        (
            Motor(limit=60.0, target_speed=1.0),
            Motor(limit=60.0, target_speed=0.0),
            Control(speeds={"shoulder": 1.0}),
        ),
    ):
        run = stepper(pendulum(left), interval=0.04)
        run.step(15, control=lambda _, control=control: control)
        expected = rollout(pendulum(described), 0.6).trajectory.positions[-1]
        np.testing.assert_allclose(run.state.positions, expected, atol=1e-9)


def test_feedback_balances_a_rod_on_its_end() -> None:
    """An inverted pendulum under a torque of its angle and rate comes to rest upright; without control it falls."""
    rod = body("rod", Box(half_extents=(0.05, 0.05, 0.5)), (0.0, 0, 0.5)).model_copy(
        update={"mass": 1.0, "angular_velocity": (0, 0.5, 0), "velocity": (0.25, 0, 0)}
    )
    hinge = Hinge(name="foot", object="rod", anchor=(0, 0, 0), axis=(0, 1, 0), motor=Motor(limit=0.0))
    run = stepper(linked(rod, joints=(hinge,)), interval=0.01)

    def hold(state: SavedState) -> Control:
        angle = np.arctan2(state.positions[0, 0], state.positions[0, 2])
        return Control(efforts={"foot": float(-20.0 * angle - 5.0 * state.angular_velocities[0, 1])})

    run.step(300, control=hold)
    np.testing.assert_allclose(run.state.positions[0], (0, 0, 0.5), atol=1e-3)
    run.reset()
    run.step(100)
    assert run.state.positions[0, 2] < 0.3


def test_what_cannot_be_done_is_refused() -> None:
    world = pendulum()
    saved = state_at(world, 0.2)
    with pytest.raises(ValueError, match="this world is"):
        rollout(late_world(), 1.0, start=saved)
    with pytest.raises(ValueError, match="must lie beyond"):
        rollout(world, 0.2, start=saved)
    with pytest.raises(ValueError, match="or damaged"):
        SavedState.from_bytes(saved.to_bytes()[:100])
    with pytest.raises(ValueError, match="does not fit this engine"):
        stepper(world, start=replace(saved, memory={k: v for k, v in saved.memory.items() if k != "state.half"}))
    rope = Rope(name="rope", points=((0, 0, 0), (1, 0, 0)), segments=4)
    with pytest.raises(ValueError, match="from the start only"):
        stepper(World(deformables=(rope,)))
    run = stepper(world)
    with pytest.raises(ValueError, match="has no motor"):
        run.step(control=lambda _: Control(efforts={"elbow": 1.0}))
    with pytest.raises(KeyError, match="unknown object"):
        run.step(control=lambda _: Control(forces={"arm": (1.0, 0, 0)}))
    flat = stepper(six_body_world(planar=True))
    with pytest.raises(ValueError, match="rigid_planar"):
        flat.step(control=lambda _: Control(forces={flat.world.objects[0].name: (0, 0, 1.0)}))


def test_wrong_input_is_refused_with_what_would_be_right() -> None:
    world = pendulum()
    for time in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="time must be 0 or more"):
            state_at(world, time)
    for patience in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="patience must be positive"):
            rollout(world, 0.1, patience=patience)
    with pytest.raises(TypeError, match="horizon must be a number"):
        rollout(world, "1")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="start must be a SavedState"):
        rollout(world, 1.0, start=b"state")  # type: ignore[arg-type]
    run = stepper(world)
    with pytest.raises(ValueError, match="count must be at least 1"):
        run.step(-1)
    with pytest.raises(TypeError, match="control must be a function"):
        run.step(control=Control())  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="control must return a Control"):
        run.step(control=lambda _: {"forces": {}})  # type: ignore[arg-type, return-value]
    with pytest.raises(ValueError, match=r"not what SavedState\.to_bytes returned"):
        SavedState.from_bytes(b"xx")
