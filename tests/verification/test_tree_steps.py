"""Joints that make a tree, stepped in their own freedoms, against Lagrange's equations by SciPy and against MuJoCo."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.world import Effect, World
from polyworld.world.representations.joint import Ball, Hinge, Motor, Slider
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere
from tests.verification.joint_scenes import G, body, energy, linked, momentum, moved

Array = NDArray[np.float64]

Y = (0.0, 1.0, 0.0)
BOB = Sphere(radius=0.01)
OWN = 0.4 * BOB.radius**2  # of inertia, per mass
COARSE = 0.02


def solved(rates: Any, start: list[float], times: Array) -> Array:
    """States (n, T) by SciPy, to some 1e-11."""
    done = solve_ivp(rates, (0, times[-1]), start, t_eval=times, method="DOP853", rtol=1e-13, atol=1e-13)
    states: Array = done.y
    return states


@pytest.mark.parametrize("turned_round", [False, True], ids=["hung", "turned-round"])
def test_a_cart_with_a_pendulum_moves_as_in_scipy_whichever_body_its_joints_name_first(turned_round: bool) -> None:
    """A cart on a rail, dragged by its wheels, a bob on a damped hinge below it, driven by a motor from 0.4 s to 1 s.

    Within 1e-7 m for 3 s at 20 ms, the sampling interval. A hinge that names the cart first turns the other way.
    """
    m, n, arm, rail, axle, effort = 1.0, 0.3, 0.25, 0.4, 2e-3, 0.15
    on, off = 0.4, 1.0

    def rates(t: float, y: Array) -> list[float]:
        _, a, v, u = y
        drive = effort if on <= t < off else 0.0
        torque = drive - axle * u  # about y, by which the bob swings towards -x
        mass = np.array([[m + n, -n * arm * np.cos(a)], [-n * arm * np.cos(a), n * (arm**2 + OWN)]])
        force = [-rail * v - n * arm * np.sin(a) * u * u, torque - n * G * arm * np.sin(a)]
        return [v, u, *np.linalg.solve(mass, force)]

    start = 0.7
    bob_at = (-arm * np.sin(start), 0.0, -arm * np.cos(start))
    ends = {"object": "cart", "other": "bob"} if turned_round else {"object": "bob", "other": "cart"}
    motor = Motor(limit=effort, start=on, end=off, reverse=turned_round)
    world = linked(
        body("cart", Box(half_extents=(0.1, 0.05, 0.02)), (0, 0, 0), mass=m),
        body("bob", BOB, bob_at, mass=n),
        joints=(
            Hinge(name="axle", anchor=(0, 0, 0), axis=Y, damping=axle, motor=motor, **ends),
            Slider(name="rail", object="cart", anchor=(0, 0, 0), axis=(1.0, 0, 0), damping=rail),
        ),
        substep=COARSE,
    )
    motion = moved(world, 3.0, step=COARSE)
    times = motion.times[0]
    pieces, state = [], [0.0, start, 0.0, 0.0]
    for begin, end in ((0.0, on), (on, off), (off, 3.0)):
        inside = times[(times >= begin - 1e-9) & (times <= end + 1e-9)] - begin
        found = solved(lambda t, y, begin=begin: rates(t + begin + 1e-12, y), state, inside)
        state = list(found[:, -1])
        pieces.append(found if begin == 0.0 else found[:, 1:])
    x, a = np.concatenate(pieces, axis=1)[:2]
    expected = np.stack([x, x - arm * np.sin(a)], axis=1)
    np.testing.assert_allclose(motion.positions[0, :, :, 0], expected, atol=1e-7)
    np.testing.assert_allclose(motion.positions[0, :, 1, 2], -arm * np.cos(a), atol=1e-7)


def test_three_dragged_bobs_far_from_the_origin_swing_as_in_scipy() -> None:
    """A triple pendulum a kilometre away, quadratic drag on all three: within 5e-6 m for 2 s at 20 ms."""
    place = np.array([800.0, -500.0, 300.0])
    masses, arms, k = np.array([0.3, 0.2, 0.1]), np.array([0.2, 0.15, 0.1]), 0.01
    start = np.array([1.2, 0.4, -0.9])

    def swung(angles: Array) -> Array:
        each = arms[:, None] * np.stack([np.sin(angles), np.zeros_like(angles), -np.cos(angles)], axis=-1)
        points: Array = np.cumsum(each, axis=-2)
        return points

    def rates(_: float, y: Array) -> list[float]:
        a, u = y[:3], y[3:]
        along = arms[:, None] * np.stack([np.cos(a), np.sin(a)], axis=-1)
        across = arms[:, None] * np.stack([-np.sin(a), np.cos(a)], axis=-1)
        mass, force = np.diag(masses * OWN), np.zeros(3)
        for i in range(3):
            v = (along[: i + 1] * u[: i + 1, None]).sum(axis=0)
            turning = (across[: i + 1] * u[: i + 1, None] ** 2).sum(axis=0)
            pull = np.array([0.0, -masses[i] * G]) - k * np.linalg.norm(v) * v - masses[i] * turning
            mass[: i + 1, : i + 1] += masses[i] * along[: i + 1] @ along[: i + 1].T
            force[: i + 1] += along[: i + 1] @ pull
        return [*u, *np.linalg.solve(mass, force)]

    points = place + swung(start)
    above = [place, *points[:2]]
    names = ("a", "b", "c")
    drag = Effect(name="drag", kind="quadratic_drag", parameters={"coefficient": k}, objects=names)
    world = linked(
        *(body(name, BOB, p, mass=m) for name, p, m in zip(names, points, masses, strict=True)),
        joints=tuple(
            Hinge(name=f"j{name}", object=name, other=other, anchor=tuple(map(float, at)), axis=Y)
            for name, other, at in zip(names, (None, "a", "b"), above, strict=True)
        ),
        substep=COARSE,
    ).model_copy(update={"effects": (drag,)})
    motion = moved(world, 2.0, step=COARSE)
    angles = solved(rates, [*start, 0.0, 0.0, 0.0], motion.times[0])[:3].T
    found = motion.positions[0] - place
    expected = np.stack([swung(a) for a in angles])
    np.testing.assert_allclose(found, expected, atol=5e-6)


def thrown(gravity: float) -> World:
    """Two bricks joined by a ball joint, thrown with spins; no joint holds them to the world."""
    omega = np.array([[1.0, 4.0, -2.0], [3.0, -1.0, 5.0]])
    point, centres = np.array([0.2, 0.0, 0.0]), np.array([[0.0, 0.0, 0.0], [0.35, 0.0, 0.0]])
    v = np.array([0.5, -0.2, 3.0])
    second = v + np.cross(omega[0], point - centres[0]) - np.cross(omega[1], point - centres[1])
    fields: list[dict[str, Any]] = [
        {"velocity": v, "angular_velocity": omega[0], "mass": 1.0},
        {"velocity": second, "angular_velocity": omega[1], "mass": 0.6},
    ]
    shapes = (Box(half_extents=(0.2, 0.04, 0.06)), Box(half_extents=(0.15, 0.03, 0.05)))
    bricks: list[RigidObject] = [
        body(name, shape, x, **f) for name, shape, x, f in zip("ab", shapes, centres, fields, strict=True)
    ]
    return linked(
        *bricks, joints=(Ball(name="p", object="a", other="b", anchor=tuple(point)),), gravity=gravity, substep=0.01
    )


def test_bodies_that_hang_on_each_other_alone_fly_as_in_mujoco() -> None:
    """A free brick and one on a ball joint, with spins about all axes: within 1e-7 m of MuJoCo's Runge-Kutta."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="1e-4" integrator="RK4" gravity="0 0 -9.81"><flag contact="disable"/></option>
        <worldbody><body><freejoint/><geom type="box" size="0.2 0.04 0.06" mass="1"/>
        <body pos="0.2 0 0"><joint type="ball"/><geom type="box" size="0.15 0.03 0.05" pos="0.15 0 0" mass="0.6"/>
        </body></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    world = thrown(G)
    a, b = world.objects
    data.qvel[:3], data.qvel[3:6] = a.velocity, a.angular_velocity
    data.qvel[6:9] = np.subtract(b.angular_velocity, a.angular_velocity)
    mujoco.mj_forward(model, data)
    expected = []
    for step in range(10_001):
        if step % 100 == 0:
            expected.append(data.xipos[1:].copy())
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(moved(world, 1.0).positions[0], np.array(expected), atol=1e-7)


def test_what_nothing_holds_keeps_momentum_angular_momentum_and_energy() -> None:
    """To 1e-7 over 5 s of tumbling at 10 ms."""
    world = thrown(0.0)
    motion = moved(world, 5.0)
    linear, angular = momentum(world, motion)
    np.testing.assert_allclose(linear, np.broadcast_to(linear[0], linear.shape), atol=1e-9)
    np.testing.assert_allclose(angular, np.broadcast_to(angular[0], angular.shape), atol=1e-7)
    own = energy(world, motion)
    np.testing.assert_allclose(own, own[0], rtol=1e-7)


def test_dry_friction_brings_a_pendulum_to_rest_as_in_scipy() -> None:
    """Until it sticks: angles within 1e-4 rad, through every turn of the slip, and it stays where friction holds it."""
    arm, friction, start = 0.25, 0.03, 1.0
    mass = 0.3
    about = mass * (arm**2 + OWN)

    def to_rest(times: Array) -> Array:
        angles, t, a, way = np.full(len(times), np.nan), 0.0, start, -1.0
        while True:

            def rates(_: float, y: Array, way: float = way) -> list[float]:
                return [y[1], (-mass * G * arm * np.sin(y[0]) - way * friction) / about]

            def stopped(t: float, y: Array, way: float = way) -> float:
                return y[1] * way if t > 1e-6 else 1.0

            stopped.terminal, stopped.direction = True, -1.0  # type: ignore[attr-defined]
            done = solve_ivp(rates, (0, 10), [a, 0.0], events=stopped, dense_output=True, rtol=1e-11, atol=1e-13)
            inside = (times >= t) & (times <= t + done.t[-1])
            angles[inside] = done.sol(times[inside] - t)[0]
            t, a, way = t + done.t[-1], done.y[0, -1], -way
            if mass * G * arm * abs(np.sin(a)) < friction:
                angles[times > t] = a
                return angles

    bob = body("bob", BOB, (arm * np.sin(start), 0.0, -arm * np.cos(start)), mass=mass)
    hinge = Hinge(name="pivot", object="bob", anchor=(0, 0, 0), axis=Y, friction=friction)
    motion = moved(linked(bob, joints=(hinge,)), 12.0)
    x = motion.positions[0, :, 0]
    expected = to_rest(motion.times[0])
    assert np.ptp(expected[-200:]) == 0.0  # it does come to rest
    np.testing.assert_allclose(np.arctan2(x[:, 0], -x[:, 2]), expected, atol=1e-4)
