"""Joints and motors whose numbers differ from world to world of a batch, against formulas and SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Environment, TimeBase, World
from polyworld.world.representations.joint import Hinge, Motor, Slider
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]
G = 9.81
MASS, R, LENGTH = 2.0, 0.1, 0.5
MOMENT = 0.4 * MASS * R**2  # of the wheel about its axle
SWUNG = MOMENT + MASS * LENGTH**2  # of the pendulum about its hinge


def wheel(**motor: Any) -> World:
    """A ball that turns about z through its centre, without weight."""
    item = RigidObject(name="wheel", shape=Sphere(radius=R), mass=MASS, position=(0.0, 0.0, 0.0))
    axle = Hinge(name="axle", object="wheel", anchor=(0.0, 0.0, 0.0), motor=Motor(**motor))
    return World(objects=(item,), joints=(axle,), environment=Environment(gravity=(0.0, 0.0, 0.0)))


def pendulum(angle: float, **hinge: float) -> World:
    """A ball on a massless rod that swings about y through the origin, let go `angle` from hanging [rad]."""
    place = (LENGTH * float(np.sin(angle)), 0.0, -LENGTH * float(np.cos(angle)))
    bob = RigidObject(name="bob", shape=Sphere(radius=R), mass=MASS, position=place)
    joint = Hinge(name="hinge", object="bob", anchor=(0.0, 0.0, 0.0), axis=(0.0, 1.0, 0.0), **hinge)  # type: ignore[arg-type]
    return World(objects=(bob,), joints=(joint,), environment=Environment(), time=TimeBase(substep=0.002))


def batch(world: World, overrides: dict[str, Any], end: float, samples: int = 51, threads: int = 2) -> BatchTrajectory:
    values = {path: np.asarray(v, dtype=float) for path, v in overrides.items()}
    count = len(next(iter(values.values())))
    return simulator(world, np.linspace(0.0, end, samples), n_worlds=count, threads=threads).run(values)


def swings(angle: float, damping: float, friction: float, times: Array) -> Array:
    """Angles at `times` by SciPy, from one turning point to the next, for dry friction has a sign."""
    found = np.empty(len(times))
    t, y = 0.0, np.array([angle, 0.0])
    while t < times[-1]:
        pull = -MASS * G * LENGTH * np.sin(y[0])
        if abs(pull) <= friction:
            found[times >= t] = y[0]
            break
        way = np.sign(pull)

        def rate(_t: float, s: Array, way: float = way) -> list[float]:
            return [s[1], (-MASS * G * LENGTH * np.sin(s[0]) - damping * s[1] - way * friction) / SWUNG]

        def turns(_t: float, s: Array, way: float = way) -> float:
            return float(way * s[1])

        turns.terminal, turns.direction = True, -1.0  # type: ignore[attr-defined]
        leg = solve_ivp(rate, (t, times[-1] + 1.0), y, events=turns, dense_output=True, rtol=1e-10, atol=1e-12)
        inside = (times >= t) & (times <= leg.t[-1])
        found[inside] = leg.sol(times[inside])[0]
        t, y = float(leg.t[-1]), np.array([leg.y[0, -1], 0.0])
    return found


def test_each_worlds_motor_begins_when_its_delay_is_over() -> None:
    world = wheel(limit=0.04, end=0.5)
    delays = np.array([0.0, 0.1, 0.2537, 2.0])
    found = batch(world, {"joints.axle.motor.delay": delays}, 1.0)
    driven = np.clip(found.times - delays[:, None], 0.0, 0.5)
    np.testing.assert_allclose(found.angular_velocities[:, :, 0, 2], 0.04 / MOMENT * driven, atol=1e-9)


def test_each_worlds_motor_has_its_own_torque_and_speed() -> None:
    limits, targets = np.array([0.01, 0.04, 0.04]), np.array([2.0, 2.0, -1.0])
    overrides = {"joints.axle.motor.limit": limits, "joints.axle.motor.target_speed": targets}
    found = batch(wheel(target_speed=1.0, limit=1.0), overrides, 1.0)
    expected = np.sign(targets)[:, None] * np.minimum(limits[:, None] / MOMENT * found.times, np.abs(targets)[:, None])
    np.testing.assert_allclose(found.angular_velocities[:, :, 0, 2], expected, atol=1e-9)


def test_a_sliders_motor_differs_from_world_to_world() -> None:
    item = RigidObject(name="cart", shape=Sphere(radius=R), mass=MASS, position=(0.0, 0.0, 0.0))
    rail = Slider(name="rail", object="cart", anchor=(0.0, 0.0, 0.0), axis=(1.0, 0.0, 0.0), motor=Motor(limit=3.0))
    world = World(objects=(item,), joints=(rail,))
    found = batch(world, {"joints.rail.motor.limit": [1.0, 6.0], "joints.rail.motor.delay": [0.0, 0.25]}, 1.0)
    driven = np.maximum(found.times - np.array([[0.0], [0.25]]), 0.0)
    force = np.array([[1.0], [6.0]])
    np.testing.assert_allclose(found.positions[:, :, 0, 0], 0.5 * force / MASS * driven**2, atol=1e-5)


@pytest.mark.parametrize("angle", [0.2, 1.2])
def test_pendulums_of_a_batch_swing_with_their_own_damping_and_friction(angle: float) -> None:
    dampings, frictions = np.array([0.0, 0.3, 0.0, 0.2]), np.array([0.0, 0.0, 0.25, 0.1])
    overrides = {"joints.hinge.damping": dampings, "joints.hinge.friction": frictions}
    found = batch(pendulum(angle), overrides, 4.0, samples=101)
    angles = np.arctan2(found.positions[:, :, 0, 0], -found.positions[:, :, 0, 2])
    for w in range(4):
        exact = swings(angle, dampings[w], frictions[w], found.times[w])
        np.testing.assert_allclose(angles[w], exact, atol=2e-4 * angle / 0.2)


def test_a_pendulums_damping_and_friction_are_found_by_least_squares() -> None:
    from scipy.optimize import least_squares

    times = np.linspace(0.0, 3.0, 61)
    bob = swings(0.6, 0.25, 0.15, times)
    data = np.stack([LENGTH * np.sin(bob), -LENGTH * np.cos(bob)], axis=1)
    world = pendulum(0.6)
    runner = simulator(world, times, n_worlds=3, threads=1)

    def positions(values: Array) -> Array:
        paths = {"joints.hinge.damping": values[:, 0], "joints.hinge.friction": values[:, 1]}
        return runner.run(paths).positions[:, :, 0, [0, 2]]

    def residual(values: Array) -> Array:
        return (positions(np.tile(values, (3, 1)))[0] - data).ravel()

    def slopes(values: Array) -> Array:
        made = positions(values + 1e-4 * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        return np.stack([(made[1] - made[0]).ravel(), (made[2] - made[0]).ravel()], axis=1) / 1e-4

    found = least_squares(residual, [0.1, 0.05], jac=slopes, bounds=(0.0, 10.0))
    # What is left is the error of the step, which friction and damping share between them.
    np.testing.assert_allclose(found.x, [0.25, 0.15], rtol=2e-2)
