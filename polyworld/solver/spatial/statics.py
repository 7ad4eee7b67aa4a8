"""Poses of a world's statics in each of its variants, as the kernels read them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.model.arrays import RigidArrays, dot
from polyworld.solver.spatial.scene import box_orientation
from polyworld.world import World, geometry
from polyworld.world.shapes import Plane, Wall

Array = NDArray[np.float64]


def static_poses(world: World, arrays: RigidArrays) -> tuple[Array, Array, Array]:
    """Position (R, s, 3) and orientation (R, s, 4; x, y, z, w) of each static's shape, and planes (R, s, 4).

    A wall's shape is a box, which lies elsewhere than the wall's own position. Planes are given by their outward
    normal and offset along it, the other statics by zeros. R is 1 where all worlds share the poses.
    """
    rows = max(len(arrays.static_position), len(arrays.static_orientation))
    count = len(world.statics)
    position = np.broadcast_to(arrays.static_position, (rows, count, 3)).copy()
    orientation = np.broadcast_to(arrays.static_orientation, (rows, count, 4)).copy()
    planes = np.zeros((rows, count, 4))
    for s, static in enumerate(world.statics):
        if isinstance(static.shape, Plane):
            normal = np.asarray(static.shape.normal, dtype=float)
            normal = rotated(orientation[:, s], normal / np.linalg.norm(normal))
            planes[:, s, :3] = normal
            planes[:, s, 3] = static.shape.offset + dot(normal, position[:, s])
        elif isinstance(static.shape, Wall):
            _, centre, rotation = geometry.wall_box(static.shape)
            position[:, s] = rotated(orientation[:, s], centre) + position[:, s]
            orientation[:, s] = geometry.quaternion_product(orientation[:, s], box_orientation(rotation))
    return position, np.roll(orientation, -1, axis=-1), planes


def rotated(orientation: Array, vector: Array) -> Array:
    """Return a vector (3,) turned by each of some quaternions (R, 4).

    Summed term by term, so that a row's result does not depend on how many rows there are.
    """
    matrix = geometry.quaternion_matrix(orientation)
    result: Array = matrix[..., 0] * vector[0] + matrix[..., 1] * vector[1] + matrix[..., 2] * vector[2]
    return result
