"""Half heights of bodies as they stand, and the corners of convex meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from polyworld.world.geometry import hull, planar_outline
from polyworld.world.shapes import BodyShape, Box, Capsule, Compound, ConvexMesh, Cylinder, Sphere

MOST_VERTICES = 256  # of a convex mesh


def half_height(shape: BodyShape) -> float:
    """Half the vertical extent of a shape in its rest orientation [m]: how high its centre is above the floor."""
    if isinstance(shape, Sphere):
        return shape.radius
    if isinstance(shape, Box):
        return shape.half_extents[2]
    if isinstance(shape, Cylinder):
        return shape.half_height
    if isinstance(shape, Capsule):
        return shape.half_height + shape.radius
    if isinstance(shape, Compound):
        return _compound_half_height(shape)
    return _mesh_half_height(shape)


def hull_vertices(points: NDArray[np.float64]) -> tuple[tuple[float, float, float], ...]:
    """At most 256 vertices of the convex hull of points (k, 3): all of them, or the extreme ones of even directions.

    Raises ValueError for points that span no volume.
    """
    try:
        corners = points[ConvexHull(points).vertices]
    except QhullError as error:
        raise ValueError("the mesh is flat: its convex hull has no volume") from error
    if len(corners) > MOST_VERTICES:
        # Directions on a Fibonacci lattice: nearly even over the sphere at any number.
        number = np.arange(MOST_VERTICES) + 0.5
        z, turn = 1.0 - 2.0 * number / MOST_VERTICES, np.pi * (1.0 + 5.0**0.5) * number
        level = np.sqrt(1.0 - z**2)
        directions = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
        corners = corners[np.unique(np.argmax(corners @ directions.T, axis=0))]
    return tuple((float(x), float(y), float(z)) for x, y, z in corners)


def _mesh_half_height(shape: ConvexMesh) -> float:
    return float(-np.asarray(hull(shape).vertices)[:, 2].min())


def _compound_half_height(shape: Compound) -> float:
    sideways = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z is the second axis of the outline
    outline, radius = planar_outline(shape, np.eye(3), sideways)
    return radius - float(outline[:, 1].min())
