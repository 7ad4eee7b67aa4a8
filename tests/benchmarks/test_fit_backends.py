"""The forward models that identification compares do the same where they can: sliding to rest, and a bounce."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from polyworld.solver.rollout import Simulator, simulator
from polyworld.world import TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere
from tests.benchmarks.peers import fit_backends
from tests.benchmarks.peers.fit_backends import Mujoco, Straight

GRAVITY = 9.81
TIMES = np.arange(40) * 0.028


def body(name: str, shape: Box | Sphere, x: float, speed: float, friction: float) -> RigidObject:
    return RigidObject(
        name=name,
        representation="rigid_planar",
        shape=shape,
        mass=1.0,
        friction=friction,
        restitution=0.6,
        position=(x, 0.0, 0.2),
        velocity=(speed, 0.0, 0.0),
    )


def world(*objects: RigidObject) -> World:
    return World(objects=objects, time=TimeBase(seconds_per_frame=0.028, frame_count=len(TIMES), substep=0.007))


@pytest.mark.parametrize("make", [simulator, Mujoco, Straight])
def test_a_box_slides_as_far_as_friction_lets_it(make: Callable[..., Simulator]) -> None:
    """v^2 / (2 mu g), of two variants with friction of their own."""
    sliding = make(world(body("box", Box(half_extents=(0.2,) * 3), 0.0, 1.5, 0.3)), TIMES, n_worlds=2)
    found = sliding.run({"objects.box.friction": np.array([0.3, 0.6])}).positions[:, -1, 0, 0]
    # MuJoCo's floor is soft: a box presses on it with its weight only once it has sunk in.
    tolerance = 0.1 if make is Mujoco else 0.01
    assert found == pytest.approx(1.5**2 / (2.0 * GRAVITY * np.array([0.3, 0.6])), rel=tolerance)


@pytest.mark.parametrize("make", [simulator, Mujoco])
def test_balls_part_with_the_restitution_of_their_speed(
    make: Callable[..., Simulator], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fit_backends, "STEPS_OF_FRAME", 112)  # the spring's law, not how few steps resolve it
    balls = [body(name, Sphere(radius=0.2), x, v, 0.0) for name, x, v in (("a", -0.5, 1.0), ("b", 0.5, -1.0))]
    last = make(world(*balls), TIMES, n_worlds=1).run().velocities[0, -1, :, 0]
    assert last[1] - last[0] == pytest.approx(0.6 * 2.0, rel=0.05)
    assert last.sum() == pytest.approx(0.0, abs=1e-6)
