"""A block that slides to rest under Coulomb friction, where everything is known in closed form: it stops after
v / (mu g) at v^2 / (2 mu g)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.world import Environment, MotionPlane, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box

GRAVITY, FRAME = 9.81, 0.04


def block_world(friction: float, speed: float, frames: int = 8) -> World:
    """The block on a plane, moving along x from the origin."""
    block = RigidObject(
        name="block",
        representation="rigid_planar",
        shape=Box(half_extents=(0.05, 0.05, 0.05)),
        position=(0.0, 0.0, 0.05),
        velocity=(speed, 0.0, 0.0),
        friction=friction,
    )
    return World(
        objects=(block,),
        environment=Environment(motion_plane=MotionPlane()),
        time=TimeBase(seconds_per_frame=FRAME, frame_count=frames, substep=0.004),
    )


def block_places(friction: float, speed: float, frames: int = 8) -> NDArray[np.float64]:
    """Where its centre is in each frame (frames, 3) [m]."""
    t = np.minimum(np.arange(frames) * FRAME, speed / (friction * GRAVITY))
    x = speed * t - 0.5 * friction * GRAVITY * t**2
    return np.stack([x, np.zeros(frames), np.full(frames, 0.05)], axis=1)


def stopping_distance(friction: float, speed: float) -> float:
    """v^2 / (2 mu g) [m]."""
    return speed**2 / (2.0 * friction * GRAVITY)
