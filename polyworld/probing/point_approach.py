"""How near the points of a deformable object come to another object's surface.

The gap is that of nodes or particles, each a ball of its contact radius, at the samples of the trajectory: between
nodes and between samples the surfaces may come a little nearer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polyworld.model import model_of
from polyworld.trajectory import Trajectory
from polyworld.world import World, geometry
from polyworld.world.shapes import Box, Capsule, Compound, ConvexMesh, Cylinder, Plane, Sphere, Wall

Array = NDArray[np.float64]


def point_gaps(world: World, trajectory: Trajectory, name: str, other: str, rows: NDArray[np.intp]) -> Array | None:
    """Smallest gaps (r,) [m] between deformable `name` and another object or static at some samples, 0 in touch.

    NaN where there is none of a fluid. None where the other has no such distance: triangle meshes.
    """
    points = trajectory.deformables[name].points[rows]
    radius = _radius(world, name, points.shape[1])
    if other in trajectory.deformables:
        theirs = trajectory.deformables[other].points[rows]
        return _between(points, radius, theirs, _radius(world, other, theirs.shape[1]))
    static = next((s for s in world.statics if s.name == other), None)
    gaps = np.full(len(rows), np.nan)
    for i, row in enumerate(rows):
        known = np.isfinite(points[i]).all(axis=1)
        if not known.any():
            continue
        if static is not None:
            shape: object = static.shape
            position, turn = np.asarray(static.position), geometry.quaternion_matrix(np.asarray(static.orientation))
        else:
            item, column = world.object(other), trajectory.index(other)  # deformable others were met above
            shape, position = item.shape, trajectory.positions[row, column]
            turn = geometry.quaternion_matrix(trajectory.orientations[row, column])
        distance = distance_to(shape, (points[i, known] - position) @ turn)
        if distance is None:
            return None
        gaps[i] = max(float((distance - radius[known]).min()), 0.0)
    return gaps


def distance_to(shape: object, local: Array) -> Array | None:
    """Distance (k,) [m] of points (k, 3), in the shape's axes, from its surface, negative inside; None for a mesh.

    Beyond the edges of a hull it is the distance from the farthest of its planes: a little less than the true one.
    """
    if isinstance(shape, Sphere):
        return np.asarray(np.linalg.norm(local, axis=1) - shape.radius)
    if isinstance(shape, Capsule):
        along = np.clip(local[:, 2], -shape.half_height, shape.half_height)
        axis_point = np.stack([np.zeros_like(along), np.zeros_like(along), along], axis=1)
        return np.asarray(np.linalg.norm(local - axis_point, axis=1) - shape.radius)
    if isinstance(shape, Box):
        return _outside(np.abs(local) - np.asarray(shape.half_extents))
    if isinstance(shape, Cylinder):
        across = np.linalg.norm(local[:, :2], axis=1) - shape.radius
        return _outside(np.stack([across, np.abs(local[:, 2]) - shape.half_height], axis=1))
    if isinstance(shape, Plane):
        height: Array = local @ (np.asarray(shape.normal) / np.linalg.norm(shape.normal)) - shape.offset
        return height
    if isinstance(shape, Wall):
        box, centre, turn = geometry.wall_box(shape)
        return _outside(np.abs((local - centre) @ turn) - np.asarray(box.half_extents))
    if isinstance(shape, ConvexMesh):
        solid = geometry.hull(shape)
        planes = np.asarray(solid.face_normals, dtype=float)
        offsets = (planes * solid.triangles_center).sum(axis=1)
        beyond: Array = (local @ planes.T - offsets).max(axis=1)
        return beyond
    if isinstance(shape, Compound):
        parts = [distance_to(p.shape, (local - p.position) @ p.rotation) for p in geometry.pieces(shape)]
        known = [part for part in parts if part is not None]
        return np.asarray(np.min(known, axis=0)) if len(known) == len(parts) else None
    return None


def _outside(beyond: Array) -> Array:
    """Distance from a box-like solid, from how far points are beyond each pair of faces."""
    outer: Array = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    distance: Array = outer + np.minimum(beyond.max(axis=1), 0.0)
    return distance


def _between(points: Array, radius: Array, theirs: Array, their_radius: Array) -> Array:
    gaps = np.full(len(points), np.nan)
    for i in range(len(points)):
        mine, others = (np.isfinite(p[i]).all(axis=1) for p in (points, theirs))
        if mine.any() and others.any():
            distance, _ = cKDTree(theirs[i, others]).query(points[i, mine])
            gaps[i] = max(float((distance - radius[mine]).min() - np.median(their_radius)), 0.0)
    return gaps


def _radius(world: World, name: str, count: int) -> Array:
    radius = model_of(world).mesh(name).radius
    rest = float(np.median(radius)) if len(radius) else 0.0
    return np.concatenate([radius[:count], np.full(max(count - len(radius), 0), rest)])
