"""Soft bodies divided into quadratic tetrahedra or, in a plane, triangles."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from polyworld.geometry import mass_properties, quaternion_matrix
from polyworld.meshing.mesh import DeformableMesh
from polyworld.meshing.soft_box import box_tetrahedra
from polyworld.meshing.soft_elements import QuadraticMesh, quadratic_solid
from polyworld.meshing.soft_round import ball_tetrahedra, cylinder_tetrahedra
from polyworld.representations.soft import Soft
from polyworld.shapes import Box, Cylinder, Sphere
from polyworld.world import World

Array = NDArray[np.float64]

CONTACT_RADIUS = 0.01  # of the edge length: nodes are points of the surface, so nearly nothing
DIVISIONS = 3.0  # elements across the smallest extent, unless a resolution is given


def soft_mesh(world: World, item: Soft) -> DeformableMesh:
    """Nodes, surface and linear tetrahedra of a soft body as it starts.

    Each 10-node tetrahedron appears as eight linear ones over its nodes, each of its surface faces as four
    triangles; of a soft_planar slice `triangles` fill it and `segments` are its outline, the inside on their left
    as seen against the motion plane's normal.
    """
    form = soft_form(world, item)
    placed = form.nodes @ quaternion_matrix(np.asarray(item.orientation)).T + np.asarray(item.position)
    measure = form.measure()
    return DeformableMesh(
        nodes=placed,
        measure=measure,
        radius=np.full(len(placed), CONTACT_RADIUS * edge_length(item)),
        segments=form.segments(),
        triangles=form.triangles(),
        tetrahedra=form.tetrahedra(),
    )


def soft_form(world: World, item: Soft) -> QuadraticMesh:
    """The body without forces, in its own axes; elements as `QuadraticMesh` says. Equal bytes on every call."""
    return _solid(item.shape, edge_length(item))


def edge_length(item: Soft) -> float:
    """Edge length that the elements aim at [m]."""
    return item.resolution if item.resolution is not None else smallest_extent(item) / DIVISIONS


def smallest_extent(item: Soft) -> float:
    """Smallest width of the shape's bounding box in its own axes [m]."""
    shape = item.shape
    if isinstance(shape, Sphere):
        return 2.0 * shape.radius
    if isinstance(shape, Box):
        return 2.0 * min(shape.half_extents)
    if isinstance(shape, Cylinder):
        return 2.0 * min(shape.radius, shape.half_height)
    raise NotImplementedError(shape.kind)


@lru_cache(maxsize=64)
def _solid(shape: Sphere | Box | Cylinder, edge: float) -> QuadraticMesh:
    if isinstance(shape, Box):
        return quadratic_solid(*box_tetrahedra(shape.half_extents, edge))
    if isinstance(shape, Sphere):
        points, cells = ball_tetrahedra(shape.radius, edge)
        mesh = quadratic_solid(points, cells, lambda p: p * (shape.radius / np.linalg.norm(p, axis=1))[:, None])
        return _with_volume(mesh, mass_properties(shape).volume)
    points, cells = cylinder_tetrahedra(shape.radius, shape.half_height, edge)
    return quadratic_solid(points, cells)


def _with_volume(mesh: QuadraticMesh, volume: float) -> QuadraticMesh:
    """The same, scaled about its origin by the little that its volume lacks."""
    scale = (volume / mesh.gradients()[1].sum()) ** (1.0 / 3.0)
    return replace(mesh, nodes=mesh.nodes * scale)
