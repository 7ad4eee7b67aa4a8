"""Friction, damping, motors, stops and springs of joints in space, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.world import geometry
from polyworld.world.representations.joint import Ball, Hinge, Motor, Slider, Spring
from polyworld.world.shapes import Box, Cylinder, Sphere
from tests.verification.joint_scenes import G, body, energy, linked, momentum, moved, turned, upward_crossings

Y = (0.0, 1.0, 0.0)
CUBE = Box(half_extents=(0.05, 0.05, 0.05))
WHEEL = Cylinder(radius=0.1, half_height=0.02)
WHEEL_INERTIA = 0.005  # about its axis, of 1 kg [kg m^2]
BALL = Sphere(radius=0.05)


@pytest.mark.parametrize("friction", [0.0, 2.0, 4.9])
def test_slider_on_an_incline_slides_by_weight_less_friction(friction: float) -> None:
    """30 degrees, 1 kg: s = (g sin a - F) t^2 / 2 to 1e-9 m, along the axis and without turning."""
    axis = np.array([np.cos(np.pi / 6), 0.0, -np.sin(np.pi / 6)])
    slider = Slider(name="s", object="cube", anchor=(0, 0, 0.3), axis=tuple(map(float, axis)), friction=friction)
    motion = moved(linked(body("cube", CUBE, (0, 0, 0)), joints=(slider,)), 2.0)
    x = motion.positions[0, :, 0]
    np.testing.assert_allclose(x @ axis, 0.5 * (G / 2 - friction) * motion.times[0] ** 2, atol=1e-9)
    np.testing.assert_allclose(x - np.outer(x @ axis, axis), 0.0, atol=1e-12)
    np.testing.assert_allclose(motion.orientations[0, :, 0], [(1.0, 0, 0, 0)] * 201, atol=1e-12)


def test_slider_held_by_friction_does_not_creep() -> None:
    axis = (float(np.cos(np.pi / 6)), 0.0, -0.5)
    slider = Slider(name="s", object="cube", anchor=(0, 0, 0), axis=axis, friction=4.906)
    motion = moved(linked(body("cube", CUBE, (0, 0, 0)), joints=(slider,)), 20.0, step=0.1)
    assert np.abs(motion.positions[0]).max() < 1e-12


@pytest.mark.parametrize(("friction", "held"), [(9.80, False), (9.82, True)])
@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_a_level_arm_falls_or_holds_as_its_joint_rubs(kind: str, friction: float, held: bool) -> None:
    """m g l = 9.81 N m; a held arm stays where it is for 10 s to 1e-9 m."""
    joint: Hinge | Ball
    if kind == "hinge":
        joint = Hinge(name="j", object="arm", anchor=(0, 0, 0), axis=Y, friction=friction)
    else:
        joint = Ball(name="j", object="arm", anchor=(0, 0, 0), friction=friction)
    motion = moved(linked(body("arm", BALL, (1.0, 0, 0)), joints=(joint,)), 10.0, step=0.1)
    fallen = -motion.positions[0, -1, 0, 2]
    assert fallen < 1e-9 if held else fallen > 0.01


@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_dry_friction_stops_a_turning_arm_at_a_constant_rate(kind: str) -> None:
    """w = w0 - F t / I about the joint, then rest; no gravity."""
    joint: Hinge | Ball
    if kind == "hinge":
        joint = Hinge(name="j", object="arm", anchor=(0, 0, 0), friction=0.5)
    else:
        joint = Ball(name="j", object="arm", anchor=(0, 0, 0), friction=0.5)
    arm = body("arm", BALL, (1.0, 0, 0), velocity=(0, 3.0, 0), angular_velocity=(0, 0, 3.0))
    motion = moved(linked(arm, joints=(joint,), gravity=0.0), 8.0)
    expected = np.maximum(3.0 - 0.5 * motion.times[0] / (1.0 + 0.4 * 0.05**2), 0.0)
    np.testing.assert_allclose(motion.angular_velocities[0, :, 0, 2], expected, atol=1e-9)


@pytest.mark.parametrize("damping", [0.01, 1.0, 1000.0])
def test_viscous_damping_slows_exponentially_however_strong(damping: float) -> None:
    """w = w0 exp(-c t / I): to 3e-8, also where c h / I is 400."""
    wheel = body("wheel", WHEEL, (0, 0, 0), angular_velocity=(0, 0, 3.0))
    hinge = Hinge(name="axle", object="wheel", anchor=(0, 0, 0), damping=damping)
    motion = moved(linked(wheel, joints=(hinge,)), 1.0)
    expected = 3.0 * np.exp(-damping / WHEEL_INERTIA * motion.times[0])
    np.testing.assert_allclose(motion.angular_velocities[0, :, 0, 2], expected, atol=3e-8)


def test_motor_reaches_its_target_at_its_limit_and_switches_off() -> None:
    """0.05 N m from 0.5 s to 3 s against 0.01 N m of friction: 8 rad/s^2 up to 10 rad/s, then 2 rad/s^2 down."""
    motor = Motor(target_speed=10.0, limit=0.05, start=0.5, end=3.0)
    hinge = Hinge(name="axle", object="wheel", anchor=(0, 0, 0), friction=0.01, motor=motor)
    motion = moved(linked(body("wheel", WHEEL, (0, 0, 0)), joints=(hinge,)), 9.0)
    t = motion.times[0]
    expected = np.clip(8.0 * (t - 0.5), 0.0, 10.0) - np.clip(2.0 * (t - 3.0), 0.0, 10.0)
    np.testing.assert_allclose(motion.angular_velocities[0, :, 0, 2], expected, atol=1e-9)


def test_motor_too_weak_for_its_target_stalls_where_damping_takes_its_limit() -> None:
    """w = (L / c) (1 - exp(-c t / I)) towards 5 rad/s of the 10 aimed at; second order, 1e-6 at 2 ms."""
    hinge = Hinge(
        name="axle", object="wheel", anchor=(0, 0, 0), damping=0.01, motor=Motor(target_speed=10.0, limit=0.05)
    )
    motion = moved(linked(body("wheel", WHEEL, (0, 0, 0)), joints=(hinge,)), 5.0)
    expected = 5.0 * (1.0 - np.exp(-2.0 * motion.times[0]))
    np.testing.assert_allclose(motion.angular_velocities[0, :, 0, 2], expected, atol=1e-6)


def test_constant_effort_of_a_slider_accelerates_and_reacts_on_the_other_body() -> None:
    """2 N between 1 kg and 3 kg: -2 and 2/3 m/s^2, total momentum nil."""
    slider = Slider(
        name="s", object="a", other="b", anchor=(0, 0, 0), axis=(1.0, 0, 0), motor=Motor(limit=2.0, reverse=True)
    )
    world = linked(body("a", CUBE, (0, 0, 0)), body("b", CUBE, (0, 0, 0), mass=3.0), joints=(slider,), gravity=0.0)
    motion = moved(world, 1.0)
    assert motion.velocities[0, -1, 0, 0] == pytest.approx(-2.0, rel=1e-9)
    assert motion.velocities[0, -1, 1, 0] == pytest.approx(2.0 / 3.0, rel=1e-9)


def test_an_arm_falls_onto_its_stop_and_stays_there() -> None:
    """Upper stop at 0.7 rad: never passed by more than 1e-5 rad, at rest there afterwards."""
    hinge = Hinge(name="j", object="arm", anchor=(0, 0, 0), axis=Y, lower=-0.1, upper=0.7)
    motion = moved(linked(body("arm", BALL, (1.0, 0, 0)), joints=(hinge,)), 3.0)
    x = motion.positions[0, :, 0]
    angle = np.arctan2(-x[:, 2], x[:, 0])
    assert angle.max() < 0.7 + 1e-5
    assert np.all(angle[100:] > 0.7 - 1e-5)
    np.testing.assert_allclose(motion.velocities[0, 100:], 0.0, atol=1e-9)


def test_a_stop_beyond_a_full_turn_counts_the_turns() -> None:
    """A free wheel at 4 rad/s with its upper stop at 3 turns is stopped there, after 3 pi / 2 seconds."""
    wheel = body("wheel", WHEEL, (0, 0, 0), angular_velocity=(0, 0, 4.0))
    hinge = Hinge(name="axle", object="wheel", anchor=(0, 0, 0), upper=6.0 * np.pi)
    motion = moved(linked(wheel, joints=(hinge,)), 6.0)
    running = motion.times[0] < 1.5 * np.pi
    np.testing.assert_allclose(motion.angular_velocities[0, running, 0, 2], 4.0, rtol=1e-10)
    np.testing.assert_allclose(motion.angular_velocities[0, ~running, 0, 2], 0.0, atol=1e-12)


def test_a_slider_stops_at_its_end() -> None:
    slider = Slider(name="s", object="cube", anchor=(0, 0, 0), lower=-0.4)
    motion = moved(linked(body("cube", CUBE, (0, 0, 0)), joints=(slider,)), 1.0)
    z = motion.positions[0, :, 0, 2]
    fallen = np.maximum(-0.5 * G * motion.times[0] ** 2, -0.4)
    np.testing.assert_allclose(z, fallen, atol=1e-6)


@pytest.mark.parametrize("stiffness", [10.0, 400.0])
def test_mass_on_a_spring_keeps_its_period_and_amplitude(stiffness: float) -> None:
    """T = 2 pi sqrt(m / k) to 1e-6 at 2 ms; no loss in twenty swings."""
    spring = Spring(
        name="s", object="mass", anchor=(0, 0, -1.0), other_anchor=(0, 0, 0), stiffness=stiffness, rest_length=0.9
    )
    omega = np.sqrt(stiffness)
    world = linked(body("mass", BALL, (0, 0, -1.0)), joints=(spring,), gravity=0.0)
    motion = moved(world, 20 * 2 * np.pi / omega, step=0.002)
    z = motion.positions[0, :, 0, 2] + 0.9
    periods = np.diff(upward_crossings(motion.times[0], z, motion.velocities[0, :, 0, 2]))
    assert np.mean(periods) == pytest.approx(2 * np.pi / omega, rel=1e-6)
    half = 0.5 * (motion.velocities[0, :, 0, 2] ** 2 + stiffness * z**2)
    np.testing.assert_allclose(half, half[0], rtol=1e-6)


def test_a_spring_far_too_stiff_for_the_step_neither_blows_up_nor_dies_down() -> None:
    """omega h = 20: the extension keeps within its first amplitude, the energy its value, over 3,000 vibrations."""
    spring = Spring(
        name="s", object="mass", anchor=(0, 0, -1.0), other_anchor=(0, 0, 0), stiffness=1e8, rest_length=0.9
    )
    motion = moved(linked(body("mass", BALL, (0, 0, -1.0)), joints=(spring,), gravity=0.0), 2.0)
    z = motion.positions[0, :, 0, 2] + 0.9
    assert np.abs(z).max() <= 0.1 + 1e-9
    kept = 0.5 * motion.velocities[0, :, 0, 2] ** 2 + 0.5e8 * z**2
    np.testing.assert_allclose(kept, kept[0], rtol=1e-3)


def test_a_damped_spring_settles_where_it_carries_the_weight() -> None:
    spring = Spring(name="s", object="mass", anchor=(0, 0, -1.0), other_anchor=(0, 0, 0), stiffness=200.0, damping=20.0)
    motion = moved(linked(body("mass", BALL, (0, 0, -1.0)), joints=(spring,)), 5.0)
    assert motion.positions[0, -1, 0, 2] == pytest.approx(-1.0 - G / 200.0, abs=1e-9)


def test_two_bodies_on_a_spring_keep_momentum_angular_momentum_and_energy() -> None:
    """Held off-centre, turning about each other for 10 s; energy within 1e-6 at 2 ms, angular momentum within 1e-9."""
    spring = Spring(
        name="s", object="a", other="b", anchor=(0, 0.1, 0), other_anchor=(1.0, 0, 0.1), stiffness=50.0, rest_length=0.8
    )
    world = linked(
        body("a", Sphere(radius=0.1), (0, 0, 0), velocity=(0, 1.0, 0)),
        body("b", Sphere(radius=0.1), (1.0, 0, 0), mass=2.0),
        joints=(spring,),
        gravity=0.0,
    )
    motion = moved(world, 10.0)
    linear, angular = momentum(world, motion)
    np.testing.assert_allclose(linear, np.broadcast_to(linear[0], linear.shape), atol=1e-12)
    np.testing.assert_allclose(angular, np.broadcast_to(angular[0], angular.shape), atol=1e-9)
    turns = geometry.quaternion_matrix(motion.orientations[0])
    ends = motion.positions[0] + np.einsum("tnij,nj->tni", turns, np.array([[0, 0.1, 0], [0, 0, 0.1]]))
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    total = energy(world, motion) + 25.0 * (length - 0.8) ** 2
    np.testing.assert_allclose(total, total[0], rtol=1e-6)


@pytest.mark.parametrize(("share", "held"), [(1.02, True), (0.98, False)])
def test_a_level_chain_of_twenty_links_holds_or_breaks_where_its_first_hinge_must(share: float, held: bool) -> None:
    """The first hinge carries m g l n^2 / 2 = 392 N m; a chain that holds stays to 1e-8 m for 2 s."""
    link = Box(half_extents=(0.1, 0.02, 0.02))
    links = [body(f"b{i}", link, (0.1 + 0.2 * i, 0, 0)) for i in range(20)]
    joints = tuple(
        Hinge(
            name=f"j{i}",
            object=f"b{i}",
            other=None if i == 0 else f"b{i - 1}",
            anchor=(0.2 * i, 0, 0),
            axis=Y,
            friction=share * G * 0.2 * 20**2 / 2,
        )
        for i in range(20)
    )
    motion = moved(linked(*links, joints=joints), 2.0, step=0.1)
    fallen = -motion.positions[0, -1, -1, 2]
    assert fallen < 1e-8 if held else fallen > 0.1


def test_a_chain_of_stiff_springs_hangs_as_each_carries_what_is_below() -> None:
    """Ten masses on springs of omega h = 6, damped: extension n m g / k below the first, to 1e-9 m."""
    balls = [body(f"b{i}", BALL, (0, 0, -0.2 * (i + 1))) for i in range(10)]
    springs = tuple(
        Spring(
            name=f"s{i}",
            object=f"b{i}",
            other=None if i == 0 else f"b{i - 1}",
            anchor=(0, 0, -0.2 * (i + 1)),
            other_anchor=(0, 0, -0.2 * i),
            stiffness=1e7,
            damping=2000.0,
        )
        for i in range(10)
    )
    motion = moved(linked(*balls, joints=springs), 2.0, step=0.1)
    sag = np.cumsum([(10 - i) * G / 1e7 for i in range(10)])
    np.testing.assert_allclose(motion.positions[0, -1, :, 2], -0.2 * np.arange(1, 11) - sag, atol=1e-9)


def test_joint_parameters_differ_between_the_worlds_of_a_batch() -> None:
    """Friction, damping and stiffness by path, one value a world, as in a fit."""
    wheel = body("wheel", WHEEL, (0, 0, 0), angular_velocity=(0, 0, 3.0))
    mass = body("mass", BALL, (3.0, 0, -1.0))
    world = linked(
        wheel,
        mass,
        joints=(
            Hinge(name="axle", object="wheel", anchor=(0, 0, 0)),
            Spring(
                name="spring",
                object="mass",
                anchor=(3.0, 0, -1.0),
                other_anchor=(3.0, 0, 0),
                stiffness=200.0,
                rest_length=1.0 - G / 200.0,
            ),
        ),
    )
    overrides = {
        "joints.axle.friction": np.array([0.0, 0.01]),
        "joints.axle.damping": np.array([0.002, 0.0]),
        "joints.spring.stiffness": np.array([200.0, 100.0]),
    }
    motion = moved(world, 1.0, overrides=overrides, n_worlds=2)
    assert motion.angular_velocities[0, -1, 0, 2] == pytest.approx(3.0 * np.exp(-0.4), rel=1e-9)
    assert motion.angular_velocities[1, -1, 0, 2] == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(motion.positions[0, :, 1, 2], -1.0, atol=1e-9)
    swing = -1.0 - G / 200.0 * (1.0 - np.cos(10.0 * motion.times[0]))
    np.testing.assert_allclose(motion.positions[1, :, 1, 2], swing, atol=1e-4)


def test_a_hinge_turned_out_of_the_plane_keeps_friction_second_order() -> None:
    """A rubbing gimbal: the energy lost is friction times the angle turned, to 1e-5 at 2 ms."""
    frame = body("frame", Box(half_extents=(0.2, 0.05, 0.05)), (0, 0, 0), angular_velocity=(0, 0, 4.0))
    wheel = body("wheel", WHEEL, (0, 0, 0), angular_velocity=(15.0, 0, 4.0), orientation=turned(Y, np.pi / 2))
    world = linked(
        frame,
        wheel,
        joints=(
            Hinge(name="pivot", object="frame", anchor=(0, 0, 0)),
            Hinge(name="axle", object="wheel", other="frame", anchor=(0, 0, 0), axis=(1.0, 0, 0), friction=0.01),
        ),
    )
    motion = moved(world, 2.0)
    own = energy(world, motion)
    axis = geometry.quaternion_matrix(motion.orientations[0, :, 0])[:, :, 0]
    relative = motion.angular_velocities[0, :, 1] - motion.angular_velocities[0, :, 0]
    rate = np.einsum("ti,ti->t", relative, axis)
    turned_by = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * 0.01)])
    np.testing.assert_allclose(own, own[0] - 0.01 * turned_by, atol=1e-5 * own[0])
