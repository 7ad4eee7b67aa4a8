"""Distances of points from the fixed things of a world."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.world import geometry
from polyworld.world.shapes import Box, ConvexMesh, Plane, Sphere, TriangleMesh, Wall
from polyworld.world.world import StaticObject

Array = NDArray[np.float64]


def distance_to_static(static: StaticObject, points: Array) -> Array:
    """Return the distance (T,) [m] of points (T, 3) from a static's surface; never too large, 0 inside."""
    signed = signed_distance(static, points)
    if signed is not None:
        return np.maximum(signed, 0.0)
    local = (points - np.asarray(static.position)) @ geometry.quaternion_matrix(np.asarray(static.orientation))
    if isinstance(static.shape, TriangleMesh):
        corners = np.asarray(static.shape.vertices)
        middle, half = (corners.min(axis=0) + corners.max(axis=0)) / 2, np.ptp(corners, axis=0) / 2
        return np.maximum(_to_corner(np.abs(local - middle) - half), 0.0)
    gap: Array = np.maximum(np.linalg.norm(local, axis=1) - geometry.circumscribed_radius(static.shape), 0.0)
    return gap


def signed_distance(static: StaticObject, points: Array) -> Array | None:
    """Return the distance (T,) [m] of points (T, 3) from a surface, negative inside; None for posts and open meshes."""
    local = (points - np.asarray(static.position)) @ geometry.quaternion_matrix(np.asarray(static.orientation))
    shape = static.shape
    if isinstance(shape, Plane):
        height: Array = local @ np.asarray(shape.normal) / np.linalg.norm(shape.normal) - shape.offset
        return height
    if isinstance(shape, Wall):
        box, centre, turn = geometry.wall_box(shape)
        return _to_corner(np.abs((local - centre) @ turn) - np.asarray(box.half_extents))
    if isinstance(shape, Box):
        return _to_corner(np.abs(local) - np.asarray(shape.half_extents))
    if isinstance(shape, Sphere):
        return np.asarray(np.linalg.norm(local, axis=1) - shape.radius)
    if isinstance(shape, ConvexMesh):
        solid = geometry.hull(shape)
        normals = np.asarray(solid.face_normals)
        offsets = np.einsum("fk,fk->f", normals, np.asarray(solid.triangles_center))
        return np.asarray((local @ normals.T - offsets).max(axis=1))
    return None


def _to_corner(beyond: Array) -> Array:
    """Distance from how far points (T, d) lie beyond each pair of faces: exact outside and inside."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    distance: Array = np.where(outside > 0.0, outside, beyond.max(axis=1))
    return distance
