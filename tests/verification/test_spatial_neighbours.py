"""Bodies that come from afar are found, and crowds that collide many times in a step gain no energy."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.solver.rollout import simulator
from polyworld.world import Environment, StaticObject, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Plane, Sphere


def ball(name: str, x: tuple[float, float, float], v: tuple[float, float, float], restitution: float) -> RigidObject:
    return RigidObject(
        name=name,
        representation="rigid_spatial",
        shape=Sphere(radius=0.1),
        mass=1.0,
        friction=0.0,
        restitution=restitution,
        position=x,
        velocity=v,
    )


def weightless(*balls: RigidObject) -> World:
    return World(objects=balls, environment=Environment(gravity=(0, 0, 0)), time=TimeBase(substep=0.002))


def test_a_ball_that_comes_from_afar_hits_the_last_of_a_row() -> None:
    """Elastic, head on: at 40 m/s it takes the place of one that has been at rest for 1 s, and both of two others."""
    world = weightless(
        ball("still", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0),
        ball("fast", (-40.1, 0.0, 0.0), (40.0, 0.0, 0.0), 1.0),
        ball("slow", (0.5, 5.0, 0.0), (0.0, -0.01, 0.0), 1.0),
        ball("last", (20.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0),
    )
    motion = simulator(world, np.array([0.0, 0.9, 1.2, 1.9])).run()
    speeds = motion.velocities[0, :, :, 0]
    np.testing.assert_allclose(speeds[1], [0.0, 40.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(speeds[2], [40.0, 0.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(speeds[3], [0.0, 0.0, 0.0, 40.0], atol=1e-9)


@pytest.mark.parametrize("restitution", [0.9, 1.0])
def test_a_crowd_that_collides_keeps_momentum_and_gains_no_energy(restitution: float) -> None:
    """Two blocks of 27 balls meet at 10 m/s: momentum to 1e-9, and elastic ones keep their energy to 1e-9 of it."""
    random = np.random.default_rng(1)
    balls = []
    for side in (-1.0, 1.0):
        for i, j, k in np.ndindex(3, 3, 3):
            x = np.array([i, j, k]) * 0.205 + [side * 0.4, 0, 0] + random.uniform(-0.002, 0.002, 3)
            balls.append(ball(f"b{len(balls)}", tuple(map(float, x)), (-5.0 * side, 0.0, 0.0), restitution))
    motion = simulator(weightless(*balls), np.linspace(0.0, 0.2, 51)).run()
    v, w = motion.velocities[0], motion.angular_velocities[0]
    np.testing.assert_allclose(v.sum(axis=1), np.broadcast_to(v[0].sum(axis=0), (51, 3)), atol=1e-9)
    energy = 0.5 * (v**2).sum(axis=(1, 2)) + 0.5 * 0.4 * 0.01 * (w**2).sum(axis=(1, 2))
    assert np.diff(energy).max() <= 1e-9 * energy[0]
    if restitution == 1.0:
        np.testing.assert_allclose(energy, energy[0], rtol=1e-9)
    apart = np.linalg.norm(motion.positions[0, :, :, None] - motion.positions[0, :, None, :], axis=-1)
    assert apart[:, ~np.eye(54, dtype=bool)].min() > 0.2 - 0.002


def test_a_dense_elastic_pile_dropped_on_a_floor_keeps_its_energy() -> None:
    """Three layers of 16 balls that nearly touch: many blows within each step, none of them without rebound."""
    random = np.random.default_rng(0)
    balls = []
    for k, j, i in np.ndindex(3, 4, 4):
        x, y = np.array([i, j]) * 0.22 + random.uniform(-0.008, 0.008, 2)
        balls.append(ball(f"b{len(balls)}", (float(x), float(y), 1.2 + 0.24 * k), (0.0, 0.0, 0.0), 1.0))
    floor = StaticObject(name="floor", shape=Plane(), friction=0.0, restitution=1.0)
    world = World(objects=balls, statics=(floor,), time=TimeBase(substep=0.002))
    motion = simulator(world, np.linspace(0.0, 0.6, 7)).run()
    energy = 0.5 * (motion.velocities[0] ** 2).sum(axis=(1, 2)) + 9.81 * motion.positions[0, ..., 2].sum(axis=1)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)
