"""Rest geometry of one cloth: edges, material axes, strain and curvature operators. Plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.model.mesh import DeformableMesh
from polyworld.world.representations.cloth import Cloth, Sheet

Array = NDArray[np.float64]
Ints = NDArray[np.int32]


@dataclass(frozen=True)
class ClothGeometry:
    """T triangles and E edges; indices count from the cloth's own first node, triangle and edge.

    nodes (k, 3), node_area (k,). corners (T, 3). edges (T, 3): 2 e + s, s = 0 in the first triangle at edge e.
    area (T,). inverse_rest (T, 2, 2): of the matrix with the rest edges 0-1 and 0-2 in material axes as columns.
    curvature (T, 3, 3): bend angles to (k_11, k_22, k_12). rest_curvature (T, 3). normal (T, 3). ends (E, 2).
    slots (E, 2): 4 t + k, its position in the first and in the second triangle, -1 for none. softness (E,): inverse
    stiffness of a director for D = 1.
    """

    nodes: Array
    node_area: Array
    corners: Ints
    edges: Ints
    area: Array
    inverse_rest: Array
    curvature: Array
    rest_curvature: Array
    ends: Ints
    slots: Ints
    softness: Array
    normal: Array


def cloth_geometry(item: Cloth, mesh: DeformableMesh) -> ClothGeometry:
    """Operators of a cloth whose shape without forces is the mesh, without its bends where it is flat at rest."""
    x, corners = mesh.nodes, mesh.triangles
    side = [x[corners[:, (k + 2) % 3]] - x[corners[:, (k + 1) % 3]] for k in range(3)]
    cross = np.cross(side[2], -side[1])
    doubled = np.linalg.norm(cross, axis=1)
    normal, area = cross / doubled[:, None], 0.5 * doubled
    first, second = _material_axes(item, x, normal)
    rest = np.stack([np.stack([(d * a).sum(1) for d in (side[2], -side[1])], 1) for a in (first, second)], 1)
    ends, slots, edges = _edges(corners)
    length = np.stack([np.linalg.norm(s, axis=1) for s in side], axis=1)
    curvature = np.empty((len(corners), 3, 3))
    for k in range(3):
        across = np.cross(side[k], normal) / length[:, k, None]
        a, b = (across * first).sum(1), (across * second).sum(1)
        curvature[:, :, k] = np.stack([a * a, b * b, a * b], axis=1) * (length[:, k] / area)[:, None]
    stiffness = np.zeros(len(ends))
    np.add.at(stiffness, edges >> 1, length**2 / area[:, None])
    rest_curvature = np.zeros((len(corners), 3))
    if not item.flat_at_rest:
        half = 0.5 * hinge_angles(x, normal, ends, slots)
        rest_curvature = np.einsum("tij,tj->ti", curvature, half[edges >> 1])
    return ClothGeometry(
        nodes=x,
        node_area=mesh.measure,
        corners=corners,
        edges=edges,
        area=area,
        inverse_rest=np.linalg.inv(rest),
        curvature=curvature,
        rest_curvature=rest_curvature,
        ends=ends,
        slots=slots,
        softness=1.0 / stiffness,
        normal=normal,
    )


def hinge_angles(x: Array, normal: Array, ends: Ints, slots: Ints) -> Array:
    """Angle (..., E) from the first triangle's normal to the second's about each edge, 0 at borders [rad]."""
    along = x[..., ends[:, 1], :] - x[..., ends[:, 0], :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    n_a, n_b = normal[..., slots[:, 0] >> 2, :], normal[..., slots[:, 1] >> 2, :]
    angle = np.arctan2((np.cross(n_a, n_b) * along).sum(-1), (n_a * n_b).sum(-1))
    return np.where(slots[:, 1] >= 0, angle, 0.0)


def _material_axes(item: Cloth, x: Array, normal: Array) -> tuple[Array, Array]:
    """Return the axes of each triangle: the first along a sheet's u, or a mesh's longest extent; the second across."""
    if isinstance(item.geometry, Sheet):
        choices = [np.asarray(item.geometry.edge_u, dtype=float)]
    else:
        choices = list(np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[2][:2])
    first = np.zeros_like(normal)
    for choice in reversed(choices):  # the earlier one counts wherever it is not across the triangle
        laid = choice / np.linalg.norm(choice) - normal * (normal @ choice / np.linalg.norm(choice))[:, None]
        size = np.linalg.norm(laid, axis=1, keepdims=True)
        first = np.where(size > 0.1, laid / np.maximum(size, 1e-12), first)
    return first, np.cross(normal, first)


def _edges(corners: Ints) -> tuple[Ints, Ints, Ints]:
    """Ends (E, 2) and slots (E, 2) of all edges, and the edges (T, 3) of each triangle, by first appearance."""
    start, stop = corners[:, [1, 2, 0]].ravel(), corners[:, [2, 0, 1]].ravel()
    key = np.stack([np.minimum(start, stop), np.maximum(start, stop)], axis=1)
    _, appears, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(appears))
    number = order[which.ravel()]
    first = np.sort(appears)
    ends = np.stack([start[first], stop[first]], axis=1).astype(np.int32)
    slots = np.full((len(first), 2), -1, dtype=np.int32)
    slots[:, 0] = 4 * (first // 3) + first % 3
    later = np.ones(len(number), dtype=bool)
    later[first] = False
    second = np.flatnonzero(later)
    slots[number[later], 1] = 4 * (second // 3) + second % 3
    edges = (2 * number + later).reshape(-1, 3)
    return ends, slots, edges.astype(np.int32)
