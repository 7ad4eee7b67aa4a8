"""Joints that make no tree are stepped at second order, springs in the bodies' own freedoms.

Two hinges on one axis hold a body twice, so that it is no tree, which `test_tree_steps` is about.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.world import Effect, StaticObject, World
from polyworld.world.representations.joint import Hinge, Spring
from polyworld.world.shapes import Box, Sphere
from tests.verification.joint_scenes import G, body, energy, linked, moved

Array = NDArray[np.float64]

Y = (0.0, 1.0, 0.0)
BOB = Sphere(radius=0.01)
ARM = 0.15


def hung_twice(name: str, at: Array, **fields: Any) -> tuple[Hinge, Hinge]:
    """Two hinges on the axis along y through a point."""
    first, second = (
        Hinge(name=f"{name}-{i}", anchor=(float(at[0]), float(at[1]) + 0.05 * i, float(at[2])), axis=Y, **fields)
        for i in range(2)
    )
    return first, second


def bob_on_an_arm(angle: float, substep: float) -> World:
    bob = body("bob", BOB, (ARM * np.sin(angle), 0.0, -ARM * np.cos(angle)))
    return linked(bob, joints=hung_twice("pivot", np.zeros(3), object="bob"), substep=substep)


def swing(times: Array, angle: float) -> Array:
    """Angles (T,) of `bob_on_an_arm` from SciPy [rad]."""
    pull = G * ARM / (ARM**2 + 0.4 * BOB.radius**2)
    solution = solve_ivp(
        lambda _, y: [y[1], -pull * np.sin(y[0])], (0, times[-1]), [angle, 0.0], t_eval=times, rtol=1e-12, atol=1e-13
    )
    angles: Array = solution.y[0]
    return angles


@pytest.mark.parametrize(("substep", "error"), [(0.02, 0.1), (0.005, 0.02), (0.002, 3e-3)])
def test_a_small_bob_on_a_long_arm_swings_as_in_scipy_however_coarse_the_step(substep: float, error: float) -> None:
    """5 s from 1.6 rad. The bob is so easily turned that a wrong first guess of the hinge's pull would diverge."""
    motion = moved(bob_on_an_arm(1.6, substep), 5.0, step=0.02)
    x = motion.positions[0, :, 0]
    found = np.unwrap(np.arctan2(x[:, 0], -x[:, 2]))
    assert np.abs(found - swing(motion.times[0], 1.6)).max() < error


def dragged_pair(times: Array, start: tuple[float, float], masses: tuple[float, float], k: float) -> Array:
    """Places (T, 2, 3) of two small balls, the second hung from the first, dragged by -k |v| v: Lagrange, SciPy."""
    own = 0.4 * BOB.radius**2
    first, second = masses

    def rates(_: float, y: Array) -> list[float]:
        a, b, u, v = y
        ta, tb = np.array([np.cos(a), np.sin(a)]), np.array([np.cos(b), np.sin(b)])
        va = ARM * u * ta
        vb = va + ARM * v * tb
        fa, fb = -k * np.linalg.norm(va) * va, -k * np.linalg.norm(vb) * vb
        c, s = second * ARM**2 * np.cos(a - b), second * ARM**2 * np.sin(a - b)
        inertia = np.array([[(first + second) * ARM**2 + first * own, c], [c, second * (ARM**2 + own)]])
        force = [
            -s * v * v - (first + second) * G * ARM * np.sin(a) + ARM * (fa + fb) @ ta,
            s * u * u - second * G * ARM * np.sin(b) + ARM * fb @ tb,
        ]
        return [u, v, *np.linalg.solve(inertia, force)]

    solution = solve_ivp(rates, (0, times[-1]), [*start, 0.0, 0.0], t_eval=times, rtol=1e-12, atol=1e-13)
    a, b = solution.y[:2]
    level, zero = np.stack([np.sin(a), np.sin(a) + np.sin(b)], -1), np.zeros((len(times), 2))
    return ARM * np.stack([level, zero, -np.stack([np.cos(a), np.cos(a) + np.cos(b)], -1)], axis=-1)


def test_effects_on_jointed_bodies_keep_the_order() -> None:
    """Two dragged balls hung from each other, 2 s: within 5e-5 m at 2 ms; at a quarter of it ten times nearer."""
    start, masses, k = (1.0, 1.4), (0.3, 0.2), 0.05
    first = np.array([np.sin(start[0]), 0.0, -np.cos(start[0])]) * ARM
    then = first + np.array([np.sin(start[1]), 0.0, -np.cos(start[1])]) * ARM
    drag = Effect(name="drag", kind="quadratic_drag", parameters={"coefficient": k}, objects=("a", "b"))
    errors = []
    for substep in (0.002, 0.0005):
        world = linked(
            body("a", BOB, first, mass=masses[0]),
            body("b", BOB, then, mass=masses[1]),
            joints=(
                *hung_twice("top", np.zeros(3), object="a"),
                *hung_twice("elbow", first, object="b", other="a"),
            ),
            substep=substep,
        ).model_copy(update={"effects": (drag,)})
        motion = moved(world, 2.0)
        errors.append(np.abs(motion.positions[0] - dragged_pair(motion.times[0], start, masses, k)).max())
    assert errors[0] < 5e-5
    assert errors[0] / errors[1] > 10.0


def test_a_pendulum_that_strikes_a_wall_loses_nothing_but_to_the_blow() -> None:
    """Elastic blows on a wall at the lowest point: the swing comes back as high as it started from, six times.

    Also where it is sampled every 0.25 s, over which steps may reach.
    """
    wall = StaticObject(
        name="wall", shape=Box(half_extents=(0.05, 0.1, 0.1)), position=(-0.06, 0.0, -ARM), restitution=1.0
    )
    bob = body("bob", BOB, (ARM * np.sin(0.5), 0.0, -ARM * np.cos(0.5)), restitution=1.0)
    hinge = Hinge(name="pivot", object="bob", anchor=(0, 0, 0), axis=Y)
    world = linked(bob, joints=(hinge,), statics=(wall,))
    motion = moved(world, 2.5)
    x = motion.positions[0, :, 0, 0]
    assert x.min() > -1e-9
    kept = energy(world, motion)
    np.testing.assert_allclose(kept - kept[0], 0.0, atol=2e-4 * G * ARM)
    assert len([e for e in motion.events[0] if e.kind == "contact_begin"]) >= 6
    seldom = moved(world, 2.5, step=0.25)
    np.testing.assert_allclose(energy(world, seldom) - kept[0], 0.0, atol=2e-4 * G * ARM)
    assert len([e for e in seldom.events[0] if e.kind == "contact_begin"]) >= 6


def test_a_spring_between_what_steps_resolve_and_what_they_do_not_hardly_gains() -> None:
    """omega h from 0.1 to 20 at 2 ms: the energy of a spring stays within 1% of what it was for 5 s."""
    for stiffness in np.geomspace(2.5e3, 1e8, 24):
        ends = {"anchor": (0, 0, -1.0), "other_anchor": (0, 0, 0), "rest_length": 0.9}
        spring = Spring(name="s", object="m", stiffness=float(stiffness), **ends)
        world = linked(body("m", Sphere(radius=0.05), (0, 0, -1.0)), joints=(spring,), gravity=0.0)
        motion = moved(world, 5.0, step=0.05)
        z = motion.positions[0, :, 0, 2] + 0.9
        kept = 0.5 * motion.velocities[0, :, 0, 2] ** 2 + 0.5 * stiffness * z**2
        np.testing.assert_allclose(kept, kept[0], rtol=0.01)
