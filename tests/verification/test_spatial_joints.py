"""Joints in space without resistance: pendulums, tops, chains against closed forms and SciPy, conservation, blows."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from polyworld.world import StaticObject, World, geometry
from polyworld.world.representations.joint import Ball, Fixed, Hinge
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere
from tests.verification.joint_scenes import (
    G,
    body,
    energy,
    linked,
    moments,
    momentum,
    moved,
    turned,
    upward_crossings,
)

Array = NDArray[np.float64]

Y = (0.0, 1.0, 0.0)
ROD = Box(half_extents=(0.03, 0.03, 0.5))
ROD_GYRATION2 = (0.03**2 + 0.5**2) / 3.0
BRICK = Box(half_extents=(0.1, 0.05, 0.05))


def pendulum(shape: Any, angle: float, substep: float = 0.002) -> World:
    """A body 1 m below a hinge along y at the origin, turned by `angle` towards +x."""
    bob = body("bob", shape, (np.sin(angle), 0.0, -np.cos(angle)), orientation=turned(Y, -angle))
    return linked(bob, joints=(Hinge(name="pivot", object="bob", anchor=(0, 0, 0), axis=Y),), substep=substep)


@pytest.mark.parametrize(("degrees", "ratio"), [(10.0, 1.00191), (45.0, 1.03997), (90.0, 1.18034)])
@pytest.mark.parametrize("shape", [Sphere(radius=0.05), ROD], ids=["ball", "rod"])
def test_pendulum_keeps_its_period_energy_and_length(shape: Any, degrees: float, ratio: float) -> None:
    """T / T0 = (2/pi) K(sin^2(theta/2)) to 1e-5 at 2 ms over some ten swings; energy within 2e-5 of the swing's.

    The energy of the last swing is that of the first to 1e-6: there is no drift. The length is kept to 1e-12 m.
    """
    angle = np.radians(degrees)
    world = pendulum(shape, angle)
    motion = moved(world, 24.0)
    x = motion.positions[0, :, 0]
    swing = np.arctan2(x[:, 0], -x[:, 2])
    periods = np.diff(upward_crossings(motion.times[0], swing, -motion.angular_velocities[0, :, 0, 1]))
    about_pivot = moments(world)[0, 1, 1] + 1.0
    exact = 2.0 / np.pi * ellipk(np.sin(angle / 2) ** 2)
    assert exact == pytest.approx(ratio, abs=6e-6)
    assert len(periods) >= 8
    assert np.mean(periods) / (2 * np.pi * np.sqrt(about_pivot / G)) == pytest.approx(exact, rel=1e-5)
    own = (energy(world, motion) / G + np.cos(angle)) / (1.0 - np.cos(angle))
    assert np.abs(own).max() < 2e-5
    assert abs(own[-240:].mean() - own[:240].mean()) < 1e-6
    np.testing.assert_allclose(np.linalg.norm(x, axis=1), 1.0, atol=1e-12)


def double_pendulum(times: Array, start: tuple[float, float]) -> Array:
    """Angles (T, 2) of two equal rods hinged end to end, from hanging [rad], from Lagrange's equations by SciPy."""
    inertia = ROD_GYRATION2

    def rates(_: float, y: Array) -> list[float]:
        a, b, u, v = y
        c, s = 0.5 * np.cos(a - b), 0.5 * np.sin(a - b)
        mass = np.array([[0.25 + inertia + 1.0, c], [c, 0.25 + inertia]])
        force = np.array([-1.5 * G * np.sin(a) - s * v * v, -0.5 * G * np.sin(b) + s * u * u])
        return [u, v, *np.linalg.solve(mass, force)]

    solution = solve_ivp(
        rates, (0, times[-1]), [*start, 0.0, 0.0], t_eval=times, method="DOP853", rtol=1e-13, atol=1e-13
    )
    angles: Array = solution.y[:2].T
    return angles


def two_rods(a: float, b: float, substep: float) -> World:
    elbow = np.array([np.sin(a), 0.0, -np.cos(a)])
    tip = elbow + np.array([np.sin(b), 0.0, -np.cos(b)])
    return linked(
        body("upper", ROD, elbow / 2, orientation=turned(Y, -a)),
        body("lower", ROD, (elbow + tip) / 2, orientation=turned(Y, -b)),
        joints=(
            Hinge(name="pivot", object="upper", anchor=(0, 0, 0), axis=Y),
            Hinge(name="elbow", object="lower", other="upper", anchor=tuple(map(float, elbow)), axis=Y),
        ),
        substep=substep,
    )


def test_double_pendulum_moves_as_in_scipy_nearer_with_a_shorter_step() -> None:
    """2 s from 1.2 and 2 rad: the rods within 3e-5 rad at 5 ms, sampled every 0.1 s; five times nearer at 0.05 ms."""
    errors = []
    for substep in (0.005, 0.00005):
        motion = moved(two_rods(1.2, 2.0, substep), 2.0, step=0.1)
        q = motion.orientations[0]
        found = np.unwrap(2.0 * np.arctan2(-q[..., 2], q[..., 0]), axis=0)
        errors.append(np.abs(found - double_pendulum(motion.times[0], (1.2, 2.0))).max())
    assert errors[0] < 3e-5
    assert errors[0] / errors[1] > 5.0


def test_double_pendulum_keeps_its_energy_without_drift() -> None:
    """20 s of chaotic motion at 2 ms: within 1e-3 of m g l at any time, mean of the last second within 5e-5."""
    world = two_rods(np.pi / 2, np.pi / 2, 0.002)
    own = energy(world, moved(world, 20.0)) / G
    assert np.abs(own).max() < 1e-3
    assert abs(own[-100:].mean()) < 5e-5


def test_top_on_a_ball_joint_precesses_as_it_should() -> None:
    """Steady precession W of a heavy top: I1 cos(t) W^2 - I3 w3 W + m g l = 0 (Goldstein 5.7); 100 rad/s at 2 ms.

    The rate to 5e-4, the tilt to 4e-4 rad, over 5 s.
    """
    disc, tilt, lever, spin = Cylinder(radius=0.1, half_height=0.01), 0.4, 0.15, 100.0
    axis = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    solid = geometry.mass_properties(disc)
    own = solid.inertia / solid.volume
    i1, i3 = own[0, 0] + lever**2, own[2, 2]
    a = i1 * np.cos(tilt)
    rate = (i3 * spin - np.sqrt((i3 * spin) ** 2 - 4 * a * G * lever)) / (2 * a)
    turning = np.array([0.0, 0.0, rate])
    top = body(
        "top",
        disc,
        lever * axis,
        orientation=turned(Y, tilt),
        angular_velocity=turning + axis * (spin - rate * np.cos(tilt)),
        velocity=np.cross(turning, lever * axis),
    )
    motion = moved(linked(top, joints=(Ball(name="foot", object="top", anchor=(0, 0, 0)),)), 5.0)
    x = motion.positions[0, :, 0] / lever
    phase = np.unwrap(np.arctan2(x[:, 1], x[:, 0]))
    assert (phase[-1] - phase[0]) / 5.0 == pytest.approx(rate, rel=5e-4)
    assert np.abs(np.arccos(x[:, 2]) - tilt).max() < 4e-4


def beam(count: int, *, held: bool, **fields: Any) -> World:
    """Bricks of 0.2 m in a row along x, fixed to each other, the first one to the world where `held`."""
    bricks = [
        body(
            f"b{i}",
            BRICK,
            (0.1 + 0.2 * i, 0, 0),
            velocity=(0, 0, 0 if held else 2.0 * (0.1 + 0.2 * i)),
            angular_velocity=(0, 0, 0) if held else (0.5, -2.0, 0),
        )
        for i in range(count)
    ]
    joints = [
        Fixed(name=f"f{i}", object=f"b{i}", other=None if i == 0 else f"b{i - 1}", anchor=(0.2 * i, 0, 0))
        for i in range(0 if held else 1, count)
    ]
    return linked(*bricks, joints=tuple(joints), **fields)


def test_boxes_fixed_to_each_other_are_a_rigid_beam() -> None:
    """Ten bricks built into a wall do not sag: 1e-12 m."""
    motion = moved(beam(10, held=True), 2.0)
    np.testing.assert_allclose(motion.positions[0], np.broadcast_to(motion.positions[0, 0], (201, 10, 3)), atol=1e-12)


def test_a_flying_beam_keeps_momentum_angular_momentum_and_energy() -> None:
    """To rounding over 5 s, and its bricks stay in line: in free flight a beam is one body."""
    world = beam(10, held=False, gravity=0.0)
    motion = moved(world, 5.0)
    linear, angular = momentum(world, motion)
    np.testing.assert_allclose(linear, np.broadcast_to(linear[0], linear.shape), atol=1e-11)
    np.testing.assert_allclose(angular, np.broadcast_to(angular[0], angular.shape), atol=1e-11)
    own = energy(world, motion)
    np.testing.assert_allclose(own, own[0], rtol=1e-11)
    ends = motion.positions[0, :, -1] - motion.positions[0, :, 0]
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 1.8, atol=1e-11)


def test_a_chain_of_light_links_swings_a_load_ten_thousand_times_as_heavy() -> None:
    """Ten links of 0.1 kg and a tonne, from the horizontal, for 4 s: no stretch, energy within 5e-4 of m g l."""
    links = [body(f"b{i}", BRICK, (0.1 + 0.2 * i, 0, 0), mass=0.1) for i in range(10)]
    load = body("load", Sphere(radius=0.1), (2.1, 0, 0), mass=1000.0)
    joints: list[Ball | Fixed] = [
        Ball(name=f"f{i}", object=f"b{i}", other=None if i == 0 else f"b{i - 1}", anchor=(0.2 * i, 0, 0))
        for i in range(10)
    ]
    joints.append(Fixed(name="hook", object="load", other="b9", anchor=(2.0, 0, 0)))
    world = linked(*links, load, joints=tuple(joints))
    motion = moved(world, 4.0)
    assert np.linalg.norm(motion.positions[0, :, -1], axis=1).max() < 2.1 + 1e-9
    assert np.abs(energy(world, motion)).max() / (1000.0 * G * 2.1) < 5e-4


def test_a_door_on_two_hinges_turns_as_on_one() -> None:
    """Hinges that say the same twice do not stop the door, nor does its weight."""
    door = body("door", Box(half_extents=(0.4, 0.02, 1.0)), (0.4, 0, 0), mass=10.0, velocity=(0, 0.8, 0))
    door = door.model_copy(update={"angular_velocity": (0.0, 0.0, 2.0)})
    hinges = tuple(Hinge(name=f"h{z}", object="door", anchor=(0, 0, z)) for z in (-1, 1))
    motion = moved(linked(door, joints=hinges), 5.0)
    np.testing.assert_allclose(motion.angular_velocities[0, :, 0], [(0, 0, 2.0)] * 501, atol=1e-10)
    at = 0.4 * np.array([np.cos(10.0), np.sin(10.0), 0.0])  # chords are (w h)^2 / 24 shorter than arcs
    np.testing.assert_allclose(motion.positions[0, -1, 0], at, atol=1e-5)


def test_a_parallel_linkage_keeps_its_bar_level_and_its_energy() -> None:
    """Four hinges, a closed loop, swinging by 34 degrees for 10 s: level to 1e-10, energy within 1e-5 of m g l."""
    swing = np.array([np.sin(0.6), 0.0, -np.cos(0.6)])
    across = Box(half_extents=(0.5, 0.02, 0.02))
    world = linked(
        body("left", ROD, swing / 2, orientation=turned(Y, -0.6)),
        body("right", ROD, swing / 2 + (1, 0, 0), orientation=turned(Y, -0.6)),
        body("bar", across, swing + np.array([0.5, 0, 0])),
        joints=tuple(
            Hinge(name=name, object=a, other=b, anchor=tuple(map(float, at)), axis=Y)
            for name, a, b, at in (
                ("1", "left", None, np.zeros(3)),
                ("2", "right", None, np.array([1.0, 0, 0])),
                ("3", "bar", "left", swing),
                ("4", "bar", "right", swing + np.array([1.0, 0, 0])),
            )
        ),
    )
    motion = moved(world, 10.0)
    np.testing.assert_allclose(motion.orientations[0, :, 2], [(1.0, 0, 0, 0)] * 1001, atol=1e-10)
    own = energy(world, motion) / (3 * G)
    assert np.abs(own - own[0]).max() < 1e-5


def test_a_chain_in_three_dimensions_moves_as_in_mujoco() -> None:
    """Ball, skew hinge and ball between three bricks, against MuJoCo's Runge-Kutta at 0.1 ms, up to 1.5 s.

    Within 1e-7 m at 5 ms, within 2e-9 at 1 ms.
    """
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="1e-4" integrator="RK4" gravity="0 0 -9.81"><flag contact="disable"/></option>
        <worldbody><body><joint type="ball"/><geom type="box" size="0.2 0.04 0.06" pos="0.2 0 0" mass="1"/>
        <body pos="0.4 0 0"><joint axis="0.6 0.8 0"/><geom type="box" size="0.15 0.03 0.05" pos="0.15 0 0" mass="0.7"/>
        <body pos="0.3 0 0"><joint type="ball"/><geom type="box" size="0.1 0.05 0.02" pos="0.1 0 0" mass="0.4"/>
        </body></body></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    expected = []
    for step in range(15_001):
        if step % 100 == 0:
            expected.append(data.xipos[1:].copy())
        mujoco.mj_step(model, data)
    errors = []
    for substep in (0.005, 0.001):
        world = linked(
            body("a", Box(half_extents=(0.2, 0.04, 0.06)), (0.2, 0, 0)),
            body("b", Box(half_extents=(0.15, 0.03, 0.05)), (0.55, 0, 0), mass=0.7),
            body("c", Box(half_extents=(0.1, 0.05, 0.02)), (0.8, 0, 0), mass=0.4),
            joints=(
                Ball(name="1", object="a", anchor=(0, 0, 0)),
                Hinge(name="2", object="b", other="a", anchor=(0.4, 0, 0), axis=(0.6, 0.8, 0.0)),
                Ball(name="3", object="c", other="b", anchor=(0.7, 0, 0)),
            ),
            substep=substep,
        )
        errors.append(np.abs(moved(world, 1.5).positions[0] - np.array(expected)).max())
    assert errors[0] < 1e-7
    assert errors[1] < 2e-9


def test_velocities_that_would_pull_a_joint_apart_are_taken_up_as_a_blow() -> None:
    """A hanging rod struck at its centre by m v swings off with m v d / I about the pivot."""
    rod = body("rod", ROD, (0, 0, -0.5), velocity=(2.0, 0, 0))
    world = linked(rod, joints=(Hinge(name="pivot", object="rod", anchor=(0, 0, 0), axis=Y),))
    motion = moved(world, 0.002, step=0.0001)
    expected = -2.0 * 0.5 / (ROD_GYRATION2 + 0.25)
    assert motion.angular_velocities[0, 1, 0, 1] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("restitution", [0.5, 1.0])
def test_a_ball_rebounds_from_a_hinged_door_by_the_inertia_about_the_hinge(restitution: float) -> None:
    """J = (1 + e) v / (1/m + r^2/I): ball and door to 1e-9."""
    panel = Box(half_extents=(0.5, 0.02, 0.5))
    fields: dict[str, Any] = {"restitution": restitution, "friction": 0.0}
    world = linked(
        body("door", panel, (0.5, 0, 0), mass=3.0, **fields),
        body("ball", Sphere(radius=0.05), (0.9, -1.0, 0), velocity=(0, 5.0, 0), **fields),
        joints=(Hinge(name="hinge", object="door", anchor=(0, 0, 0)),),
        gravity=0.0,
    )
    motion = moved(world, 0.25)
    about = moments(world)[0, 2, 2] + 3.0 * 0.25
    impulse = (1 + restitution) * 5.0 / (1.0 + 0.9**2 / about)
    assert motion.angular_velocities[0, 20, 0, 2] == pytest.approx(impulse * 0.9 / about, rel=1e-9)
    assert motion.velocities[0, 20, 1, 1] == pytest.approx(5.0 - impulse, abs=1e-8)


def test_joined_bodies_pass_through_each_other_and_others_do_not() -> None:
    """Two bricks hinged at one point overlap; a ball on them does not."""
    floor = StaticObject(name="floor", shape=Plane(offset=-0.5))
    world = linked(
        body("a", BRICK, (0.1, 0, 0)),
        body("b", BRICK, (0.15, 0, 0)),
        body("ball", Sphere(radius=0.05), (0.1, 0, 0.3), restitution=0.0),
        joints=(
            Fixed(name="wall", object="a", anchor=(0, 0, 0)),
            Hinge(name="pin", object="b", other="a", anchor=(0.1, 0, 0), axis=Y),
        ),
        statics=(floor,),
    )
    motion = moved(world, 1.0)
    touched = {e.participants for e in motion.events[0]}
    assert ("a", "b") not in touched
    assert any("ball" in pair for pair in touched)


def test_a_chain_dropped_on_the_floor_comes_to_rest_on_it() -> None:
    links = [body(f"b{i}", BRICK, (0.22 * i, 0, 0.5), orientation=turned(Y, 0.2), restitution=0.2) for i in range(5)]
    joints = [
        Ball(name=f"f{i}", object=f"b{i}", other=f"b{i - 1}", anchor=(0.22 * i - 0.11, 0, 0.5)) for i in range(1, 5)
    ]
    world = linked(*links, joints=tuple(joints), statics=(StaticObject(name="floor", shape=Plane()),))
    motion = moved(world, 3.0)
    assert np.abs(motion.velocities[0, -1]).max() < 1e-5
    assert motion.positions[0, -1, :, 2].min() > 0.0499


def test_late_joined_bodies_hang_from_their_joint_once_they_come() -> None:
    late = body("late", ROD, (0.5, 0, 0), orientation=turned(Y, -np.pi / 2), start_time=0.5)
    hinge = Hinge(name="pivot", object="late", anchor=(0, 0, 0), axis=Y)
    motion = moved(linked(late, joints=(hinge,)), 2.0)
    same = moved(linked(late.model_copy(update={"start_time": 0.0}), joints=(hinge,)), 1.5)
    np.testing.assert_allclose(motion.positions[0, 50:], same.positions[0], atol=1e-12)
