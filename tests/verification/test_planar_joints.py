"""Hinges in the planar solver: pendulums against closed forms and SciPy, blows, friction, damping, conservation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from polyworld.trajectory import BatchTrajectory
from polyworld.world import Effect, Environment, StaticObject, TimeBase, World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, Cylinder, Sphere, Wall
from tests.verification.planar_scenes import SIDE_VIEW, G, body, run, top_view

Array = NDArray[np.float64]

ROD = Box(half_extents=(0.05, 0.05, 0.5))
ROD_GYRATION2 = (0.05**2 + 0.5**2) / 3.0  # moment of inertia about the centre over mass [m^2]
MASS = 2.0  # [kg]
REACH = 0.45  # from pivot to centre [m]


def hanging(
    name: str, pivot: tuple[float, float], angle: float, *, shape: Any = ROD, reach: float = REACH, **fields: Any
) -> RigidObject:
    """A body whose z axis points from its centre to the pivot (x, z), turned by `angle` from hanging down to +x."""
    position = (pivot[0] + reach * np.sin(angle), 0.0, pivot[1] - reach * np.cos(angle))
    turn = (np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0)
    return body(name, shape, position, orientation=turn, **{"mass": MASS, **fields})


def side(*objects: RigidObject, joints: tuple[Hinge, ...], substep: float = 0.002, **fields: Any) -> World:
    environment = Environment(motion_plane=SIDE_VIEW, **fields.pop("environment", {}))
    return World(objects=objects, joints=joints, environment=environment, time=TimeBase(substep=substep), **fields)


def pendulum(angle: float, **fields: Any) -> World:
    substep = fields.pop("substep", 0.002)
    effects = fields.pop("effects", ())
    rod = hanging("rod", (0.0, 0.0), angle, **fields)
    hinge = Hinge(name="pivot", object="rod", anchor=(0.0, 0.0, 0.0))
    return side(rod, joints=(hinge,), substep=substep, effects=effects)


def angles(motion: BatchTrajectory, index: int = 0, world: int = 0) -> Array:
    """Angle (T,) of a rod from hanging down, towards +x [rad]."""
    q = motion.orientations[world, :, index]
    return np.unwrap(2.0 * np.arctan2(-q[:, 2], q[:, 0]))


def spin(motion: BatchTrajectory, index: int = 0) -> Array:
    return -motion.angular_velocities[0, :, index, 1]


def energy(motion: BatchTrajectory, masses: list[float], gyration2: list[float], gravity: float = G) -> Array:
    """Kinetic and potential energy (T,) of bodies of the given radii of gyration squared [J]."""
    turning = np.square(motion.angular_velocities[0]).sum(axis=2) * gyration2
    kinetic = np.square(motion.velocities[0]).sum(axis=2) + turning
    total: Array = (masses * (0.5 * kinetic + gravity * motion.positions[0, :, :, 2])).sum(axis=1)
    return total


@pytest.mark.parametrize(("degrees", "ratio"), [(10.0, 1.00191), (45.0, 1.03997), (90.0, 1.18034)])
@pytest.mark.parametrize("shape", [ROD, Capsule(radius=0.05, half_height=0.45)], ids=["box", "capsule"])
def test_pendulum_keeps_its_period_energy_and_length(shape: Any, degrees: float, ratio: float) -> None:
    """T / T0 = (2/pi) K(sin^2(theta/2)), T0 = 2 pi sqrt(I / (m g d)), over ten swings at 2 ms: 2e-5.

    Energy is kept to 1e-5 of that of the swing and never gained; the distance to the pivot to 1e-12 m.
    """
    if isinstance(shape, Box):
        gyration2 = ROD_GYRATION2
    else:  # a cylinder and two half balls, whose centres of mass lie 3r/8 beyond the cap centres
        r, a = shape.radius, shape.half_height
        cylinder, ball = 2.0 * a * r**2, 4.0 / 3.0 * r**3
        inertia = cylinder * (r**2 / 4 + a**2 / 3) + ball * (0.4 * r**2 + a**2 + 0.75 * a * r)
        gyration2 = inertia / (cylinder + ball)
    amplitude = np.radians(degrees)
    exact_ratio = 2.0 / np.pi * ellipk(np.sin(amplitude / 2) ** 2)
    assert exact_ratio == pytest.approx(ratio, abs=6e-6)
    period = exact_ratio * 2.0 * np.pi * np.sqrt((gyration2 + REACH**2) / (G * REACH))
    motion = run(pendulum(amplitude, shape=shape), 10.3 * period)
    swing, times = angles(motion), motion.times[0]
    falls = np.flatnonzero((swing[:-1] > 0) & (swing[1:] <= 0))
    crossings = times[falls] + 0.01 * swing[falls] / (swing[falls] - swing[falls + 1])
    assert len(crossings) >= 10
    assert np.mean(np.diff(crossings)) == pytest.approx(period, rel=2e-5)
    drift = (energy(motion, [MASS], [gyration2]) / (MASS * G * REACH) + np.cos(amplitude)) / (1 - np.cos(amplitude))
    assert -1e-5 < drift.min() <= drift.max() < 1e-12
    np.testing.assert_allclose(np.linalg.norm(motion.positions[0, :, 0], axis=1), REACH, atol=1e-12)


def swung(omega: float, angle: float, mass_damping: float, spin_damping: float, times: Array) -> Array:
    """The angle of a damped rod, by SciPy: I theta'' = -m g d sin - (c_v m d^2 + c_w I_cm) theta'."""
    inertia = ROD_GYRATION2 + REACH**2
    rate = (mass_damping * REACH**2 + spin_damping * ROD_GYRATION2) / inertia
    exact = solve_ivp(
        lambda _, y: [y[1], -G * REACH / inertia * np.sin(y[0]) - rate * y[1]],
        (0.0, times[-1]),
        [angle, omega],
        t_eval=times,
        rtol=1e-11,
        atol=1e-12,
    )
    solution: Array = exact.y[0]
    return solution


@pytest.mark.parametrize(("linear", "angular"), [(0.0, 0.0), (0.0, 1.5), (0.7, 0.0), (0.7, 1.5)])
def test_pendulum_follows_scipy(linear: float, angular: float) -> None:
    """3 s from 100 degrees at 4 ms: within 1e-4 rad, damped or not."""
    world = pendulum(np.radians(100.0), substep=0.004, linear_damping=linear, angular_damping=angular)
    motion = run(world, 3.0, 0.02)
    exact = swung(0.0, np.radians(100.0), linear, angular, motion.times[0])
    assert np.abs(angles(motion) - exact).max() < 1e-4


def test_drag_on_a_pendulum_follows_scipy() -> None:
    """A linear drag force -k v on the rod's centre is linear damping at the rate k/m: 1e-4 rad in 3 s at 4 ms."""
    drag = Effect(name="air", kind="linear_drag", parameters={"coefficient": 1.0})
    motion = run(pendulum(1.0, effects=(drag,), substep=0.004), 3.0, 0.02)
    exact = swung(0.0, 1.0, 1.0 / MASS, 0.0, motion.times[0])
    assert np.abs(angles(motion) - exact).max() < 1e-4


def test_a_fast_rod_turns_over_and_keeps_its_energy() -> None:
    """Full turns at 12 to 15 rad/s for 10 s: energy to 1e-4, the pivot to 1e-12 m, the angle as SciPy's to 2e-3."""
    rod = (
        pendulum(0.0)
        .objects[0]
        .model_copy(update={"velocity": (15.0 * REACH, 0.0, 0.0), "angular_velocity": (0.0, -15.0, 0.0)})
    )
    motion = run(side(rod, joints=pendulum(0.0).joints), 10.0)
    total = energy(motion, [MASS], [ROD_GYRATION2])
    np.testing.assert_allclose(total, total[0], rtol=1e-4)
    assert total.max() <= total[0] * (1 + 1e-12)
    np.testing.assert_allclose(np.linalg.norm(motion.positions[0, :, 0], axis=1), REACH, atol=1e-12)
    exact = swung(15.0, 0.0, 0.0, 0.0, motion.times[0][:201])
    np.testing.assert_allclose(angles(motion)[:201], exact, atol=2e-3)


def double_pendulum(first: float, second: float) -> World:
    """Two rods; each hangs by a point REACH above its centre, the second from REACH below the first's."""
    upper = hanging("upper", (0.0, 0.0), first)
    elbow = (2 * REACH * np.sin(first), -2 * REACH * np.cos(first))
    lower = hanging("lower", elbow, second, mass=0.5 * MASS)
    pivot = Hinge(name="pivot", object="upper", anchor=(0.0, 0.0, 0.0))
    joint = Hinge(name="elbow", object="lower", other="upper", anchor=(elbow[0], 0.0, elbow[1]))
    return side(upper, lower, joints=(pivot, joint))


def double_pendulum_by_scipy(first: float, second: float, times: Array) -> Array:
    """Angles (T, 2) from Lagrange's equations M(q) q'' = f(q, q') of two compound pendulums."""
    m1, m2, length = MASS, 0.5 * MASS, 2 * REACH
    m11 = m1 * (ROD_GYRATION2 + REACH**2) + m2 * length**2
    m22 = m2 * (ROD_GYRATION2 + REACH**2)
    couple = m2 * length * REACH

    def rates(_: float, y: Array) -> Array:
        a, b, u, v = y
        mass = np.array([[m11, couple * np.cos(a - b)], [couple * np.cos(a - b), m22]])
        force = np.array(
            [
                -couple * np.sin(a - b) * v * v - (m1 * REACH + m2 * length) * G * np.sin(a),
                couple * np.sin(a - b) * u * u - m2 * REACH * G * np.sin(b),
            ]
        )
        return np.concatenate([[u, v], np.linalg.solve(mass, force)])

    exact = solve_ivp(rates, (0.0, times[-1]), [first, second, 0.0, 0.0], t_eval=times, rtol=1e-11, atol=1e-12)
    solution: Array = exact.y[:2].T
    return solution


@pytest.mark.parametrize(("first", "second"), [(0.3, -0.2), (1.2, 2.0), (2.0, 2.5)])
def test_double_pendulum_follows_lagranges_equations(first: float, second: float) -> None:
    """1.5 s: 1e-3 rad, energy kept to 1e-5 of m g d, both pivots to 1e-12 m."""
    motion = run(double_pendulum(first, second), 1.5)
    exact = double_pendulum_by_scipy(first, second, motion.times[0])
    found = np.stack([angles(motion, 0), angles(motion, 1)], axis=1)
    assert np.abs(found - exact).max() < 1e-3
    total = energy(motion, [MASS, 0.5 * MASS], [ROD_GYRATION2] * 2) / (MASS * G * REACH)
    np.testing.assert_allclose(total, total[0], atol=1e-5)
    down = np.stack([np.sin(found), -np.cos(found)], axis=2)
    centres = motion.positions[0][:, :, [0, 2]]
    np.testing.assert_allclose(centres[:, 0] - REACH * down[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(centres[:, 0] + REACH * down[:, 0], centres[:, 1] - REACH * down[:, 1], atol=1e-12)


def struck_rod(restitution: float, **fields: Any) -> BatchTrajectory:
    """A ball of 0.5 kg at 3 m/s hits a rod at rest, 0.4 from its pivot at the origin; no gravity."""
    rod = body("rod", ROD, (0.0, 0.0, -REACH), mass=MASS, restitution=restitution, **fields)
    ball = body(
        "ball", Sphere(radius=0.1), (-0.5, 0.0, -0.4), mass=0.5, velocity=(3.0, 0.0, 0.0), restitution=restitution
    )
    hinge = Hinge(name="pivot", object="rod", anchor=(0.0, 0.0, 0.0))
    return run(side(rod, ball, joints=(hinge,), environment={"gravity": (0.0, 0.0, 0.0)}), 0.4)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_struck_rod_turns_as_angular_momentum_about_its_pivot_demands(restitution: float) -> None:
    """omega = (1 + e) m r v / (I + m r^2), the ball keeps v - I omega / (m r): 1e-6; pivot held to 1e-12 m."""
    motion = struck_rod(restitution)
    inertia, arm = MASS * (ROD_GYRATION2 + REACH**2), 0.5 * 0.4
    omega = (1 + restitution) * arm * 3.0 / (inertia + arm * 0.4)
    # Before the rod can come back round, and for e = 0 before the ball has slid far: at 0.15 + 0.02 s.
    now = int(np.searchsorted(motion.times[0], 0.17))
    assert spin(motion)[now] == pytest.approx(omega, rel=1e-6 if restitution > 0 else 1e-2)
    relative = motion.positions[0]
    ball = 0.5 * (relative[:, 1, 0] * motion.velocities[0, :, 1, 2] - relative[:, 1, 2] * motion.velocities[0, :, 1, 0])
    rod = MASS * (relative[:, 0, 0] * motion.velocities[0, :, 0, 2] - relative[:, 0, 2] * motion.velocities[0, :, 0, 0])
    momentum = ball + rod + MASS * ROD_GYRATION2 * spin(motion)
    np.testing.assert_allclose(momentum, arm * 3.0, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(relative[:, 0], axis=1), REACH, atol=1e-12)
    kinetic = energy(motion, [MASS, 0.5], [ROD_GYRATION2, 0.4 * 0.1**2], gravity=0.0)
    assert kinetic.max() <= kinetic[0] * (1 + 1e-9)
    if restitution == 1.0:
        np.testing.assert_allclose(kinetic, kinetic[0], rtol=1e-6)


def test_a_pendulum_bounces_off_a_wall_and_comes_to_rest_on_it() -> None:
    """Released beside an upright wall below its pivot: impacts at e omega, energy never gained, rest at contact."""
    wall = StaticObject(
        name="wall", shape=Wall(start=(-0.1, -1.0, -2.0), end=(-0.1, 1.0, -2.0), height=1.9, thickness=0.02)
    )
    world = pendulum(0.8, restitution=0.5)
    motion = run(world.model_copy(update={"statics": (wall,)}), 8.0)
    total = energy(motion, [MASS], [ROD_GYRATION2])
    assert np.diff(total).max() < 1e-6 * MASS * G * REACH
    np.testing.assert_allclose(np.linalg.norm(motion.positions[0, :, 0], axis=1), REACH, atol=1e-12)
    begins = [e for e in motion.events[0] if e.kind == "contact_begin"]
    assert len(begins) >= 3
    # The lower end, 0.95 below the pivot, strikes first: speed 0.95 omega with the energy of the fall.
    inertia = ROD_GYRATION2 + REACH**2
    left = np.array([-0.05, -0.95])  # the corner that strikes, rod hanging
    reach, lean = np.linalg.norm(left), np.arctan2(0.05, 0.95)
    strike = lean - np.arcsin(0.09 / reach)  # the corner at x = -0.09
    omega = np.sqrt(2 * G * REACH * (np.cos(strike) - np.cos(0.8)) / inertia)
    assert begins[0].speed == pytest.approx(omega * reach * np.cos(np.arcsin(0.09 / reach)), rel=1e-4)
    assert begins[1].speed == pytest.approx(0.5 * begins[0].speed, rel=1e-3)


def test_bodies_hinged_to_each_other_alone_keep_momentum_and_energy() -> None:
    """Two overlapping rods tumbling freely: linear momentum to 1e-9, angular momentum and energy to 1e-5."""
    left = body("left", ROD, (0.0, 0.0, 0.0), mass=MASS, velocity=(0.3, 0.0, 0.2), angular_velocity=(0.0, 4.0, 0.0))
    right = body("right", ROD, (0.0, 0.0, 0.9), mass=1.0, velocity=(-0.2, 0.0, 0.1), angular_velocity=(0.0, -5.0, 0.0))
    hinge = Hinge(name="link", object="left", other="right", anchor=(0.0, 0.0, 0.45))
    motion = run(side(left, right, joints=(hinge,), environment={"gravity": (0.0, 0.0, 0.0)}), 5.0)
    masses = np.array([MASS, 1.0])
    x, v = motion.positions[0][1:], motion.velocities[0][1:]
    linear = (masses[:, None] * v).sum(axis=1)
    turning = (masses * (x[:, :, 0] * v[:, :, 2] - x[:, :, 2] * v[:, :, 0])).sum(axis=1)
    turning = turning - (masses * ROD_GYRATION2 * motion.angular_velocities[0, 1:, :, 1]).sum(axis=1)
    np.testing.assert_allclose(linear, np.tile([MASS * 0.3 - 0.2, 0.0, MASS * 0.2 + 0.1], (len(linear), 1)), atol=1e-9)
    np.testing.assert_allclose(turning, ROD_GYRATION2 * (-MASS * 4.0 + 5.0) + 0.9 * 0.2, atol=1e-5)
    total = energy(motion, [MASS, 1.0], [ROD_GYRATION2] * 2, gravity=0.0)[1:]
    np.testing.assert_allclose(total, total[0], rtol=1e-5)
    assert motion.events[0] == ()


def test_bodies_on_joints_that_would_rub_on_a_table_are_refused_with_the_cure() -> None:
    ball = body("ball", Sphere(radius=0.1), (0.5, 0.0, 0.1))
    with pytest.raises(ValueError, match="for things on a table use spatial representations on a static plane"):
        top_view(ball, joints=(Hinge(name="post", object="ball", anchor=(0.0, 0.0, 0.0)),))


def test_velocities_that_pull_at_a_hinge_are_taken_up_as_a_blow() -> None:
    """A rod with velocity v and no spin: angular momentum about the pivot is kept, omega = m d v / I, 1e-5."""
    rod = pendulum(0.0).objects[0].model_copy(update={"velocity": (2.0, 0.0, 1.0)})
    motion = run(side(rod, joints=pendulum(0.0).joints, environment={"gravity": (0.0, 0.0, 0.0)}), 0.5)
    np.testing.assert_allclose(spin(motion)[1:], REACH * 2.0 / (ROD_GYRATION2 + REACH**2), rtol=1e-5)


def test_a_hinge_takes_hold_when_its_object_starts() -> None:
    """A rod that joins at 0.5 s swings from then on as it would have from 0: 1e-6 rad."""
    early = run(pendulum(1.0), 1.0)
    late = run(pendulum(1.0, start_time=0.5), 1.5)
    np.testing.assert_allclose(angles(late)[50:], angles(early), atol=1e-6)


def test_a_chain_hung_from_both_ends_comes_to_rest_in_balance() -> None:
    """Nine equal links between two pivots, damped to rest: the horizontal part of the tension is the same in all.

    Link i of a chain of equal rods then leans by an angle whose tangent grows by equal steps from the middle: 1e-3.
    """
    links, length = 9, 0.2
    # A shape to start from: straight links of the right length zigzag down between the pivots.
    lean = np.where(np.arange(links) < links // 2, -1.0, 1.0) * np.arccos(0.75)
    lean[links // 2] = 0.0
    ends = np.concatenate([[[0.0, 0.0]], np.cumsum(length * np.stack([np.cos(lean), np.sin(lean)], axis=1), axis=0)])
    centres = 0.5 * (ends[1:] + ends[:-1])
    objects = []
    for i in range(links):
        half = -lean[i] / 2
        objects.append(
            body(
                f"link{i}",
                Cylinder(radius=0.02, half_height=0.01),
                (centres[i, 0], 0.0, centres[i, 1]),
                orientation=(np.cos(half), 0.0, np.sin(half), 0.0),
                mass=0.1,
                linear_damping=3.0,
                angular_damping=3.0,
            )
        )
    joints = [Hinge(name="h0", object="link0", anchor=(0.0, 0.0, 0.0))]
    joints += [
        Hinge(name=f"h{i}", object=f"link{i}", other=f"link{i - 1}", anchor=(ends[i, 0], 0.0, ends[i, 1]))
        for i in range(1, links)
    ]
    joints.append(Hinge(name="end", object=f"link{links - 1}", anchor=(ends[-1, 0], 0.0, ends[-1, 1])))
    motion = run(side(*objects, joints=tuple(joints)), 15.0, 0.5)
    assert np.abs(motion.velocities[0, -1]).max() < 1e-4
    q = motion.orientations[0, -1]
    slope = np.tan(-2.0 * np.arctan2(q[:, 2], q[:, 0]))
    steps = np.diff(slope)
    assert steps.mean() > 0.1
    np.testing.assert_allclose(steps, steps.mean(), rtol=1e-3)
