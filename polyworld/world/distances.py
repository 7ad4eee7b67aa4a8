"""Distances of points from the fixed things of a world."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.world import geometry
from polyworld.world.shapes import Box, Plane, TriangleMesh, Wall
from polyworld.world.world import StaticObject

Array = NDArray[np.float64]


def distance_to_static(static: StaticObject, points: Array) -> Array:
    """Return the distance (T,) [m] of points (T, 3) from a static's surface; never too large, 0 inside."""
    rotation = geometry.quaternion_matrix(np.asarray(static.orientation))
    local = (points - np.asarray(static.position)) @ rotation
    shape = static.shape
    if isinstance(shape, Plane):
        normal = np.asarray(shape.normal) / np.linalg.norm(shape.normal)
        height: Array = np.maximum(local @ normal - shape.offset, 0.0)
        return height
    if isinstance(shape, Wall):
        box, centre, turn = geometry.wall_box(shape)
        return _outside_box((local - centre) @ turn, np.asarray(box.half_extents))
    if isinstance(shape, Box):
        return _outside_box(local, np.asarray(shape.half_extents))
    if isinstance(shape, TriangleMesh):
        corners = np.asarray(shape.vertices)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        return _outside_box(local - middle, (corners.max(axis=0) - corners.min(axis=0)) / 2)
    gap: Array = np.maximum(np.linalg.norm(local, axis=1) - geometry.circumscribed_radius(shape), 0.0)
    return gap


def _outside_box(local: Array, half_extents: Array) -> Array:
    distance: Array = np.linalg.norm(np.maximum(np.abs(local) - half_extents, 0.0), axis=1)
    return distance
