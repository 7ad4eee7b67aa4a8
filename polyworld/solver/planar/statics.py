"""Poses of a planar world's statics in each of its variants."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.model.arrays import RigidArrays, dot
from polyworld.world import World, geometry
from polyworld.world.shapes import Plane

Array = NDArray[np.float64]

SLACK = 1e-9  # of a pose that differs from the world's own by rounding [m], and of a quaternion


def static_poses(world: World, arrays: RigidArrays, own: Array) -> Array:
    """Poses (R, s, 3) of the statics' outlines: x, y, angle; of half planes their outward normal and offset.

    own (s, 3): those of the world itself, which come out to the last bit where nothing is overridden. Raises
    ValueError for a static moved or turned out of the motion plane, which would change its outline.
    """
    axes = geometry.plane_axes(world.environment.motion_plane)
    base = np.array([s.position for s in world.statics]).reshape(1, -1, 3)
    angle = rotation_in_plane(
        arrays.static_orientation,
        np.array([s.orientation for s in world.statics]).reshape(1, -1, 4),
        axes[2],
        "statics",
    )
    if np.abs(dot(arrays.static_position - base, axes[2])).max(initial=0.0) > SLACK:
        raise ValueError(
            "statics of planar worlds move only within the motion plane, across its normal "
            f"{tuple(np.round(axes[2], 6).tolist())}: override the position in the plane alone"
        )
    rows = max(len(arrays.static_position), len(angle))
    poses = np.broadcast_to(own, (rows, *own.shape)).copy()
    c, s = np.cos(angle), np.sin(angle)
    was = np.stack([dot(base, a) for a in axes[:2]], axis=-1)
    now = np.stack([dot(arrays.static_position, a) for a in axes[:2]], axis=-1)
    for k, static in enumerate(world.statics):
        x, y = own[k, :2]
        if isinstance(static.shape, Plane):
            u, v = c[:, k] * x - s[:, k] * y, s[:, k] * x + c[:, k] * y
            shift = u * now[:, k, 0] + v * now[:, k, 1] - (x * was[:, k, 0] + y * was[:, k, 1])
            poses[:, k, 0], poses[:, k, 1], poses[:, k, 2] = u, v, own[k, 2] + shift
        else:  # a wall's outline stands beside the wall's own position, and rotates about it
            dx, dy = x - was[:, k, 0], y - was[:, k, 1]
            poses[:, k, 0] = x + (now[:, k, 0] - was[:, k, 0]) + ((c[:, k] * dx - s[:, k] * dy) - dx)
            poses[:, k, 1] = y + (now[:, k, 1] - was[:, k, 1]) + ((s[:, k] * dx + c[:, k] * dy) - dy)
            poses[:, k, 2] = own[k, 2] + angle[:, k]
    return poses


def rotation_in_plane(orientation: Array, base: Array, normal: Array, what: str) -> Array:
    """Angle (R, n) about the plane's normal from orientations `base` (1, n, 4) to those given (R, n, 4) [rad].

    Raises ValueError, naming `what` rotates, for rotations about other axes.
    """
    rotation = geometry.quaternion_product(orientation, base * np.array([1.0, -1.0, -1.0, -1.0]))
    along = rotation[..., 1:] @ normal
    if np.abs(rotation[..., 1:] - along[..., None] * normal).max(initial=0.0) > SLACK:
        raise ValueError(
            f"planar {what} turn only about the motion plane's normal "
            f"{tuple(np.round(normal, 6).tolist())}: override that rotation alone"
        )
    angle: Array = 2.0 * np.arctan2(along, rotation[..., 0])
    return angle
