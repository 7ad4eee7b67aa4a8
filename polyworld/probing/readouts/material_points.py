"""Points of the material: a place at the object's start as a weighted mean of its nodes, for all times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.model import DeformableMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class MaterialPoints:
    """nodes (m, n): indices of the nodes that a point hangs on; weights (m, n), which sum to 1.

    distance (m,): how far the place asked for is from the material point that stands for it [m].
    """

    nodes: Ints
    weights: Array
    distance: Array

    def places(self, points: Array) -> Array:
        """Where the material points are (..., m, 3), from the places of the nodes (..., k, 3)."""
        result: Array = (points[..., self.nodes, :] * self.weights[..., None]).sum(axis=-2)
        return result


def material_points(mesh: DeformableMesh, places: Array) -> MaterialPoints:
    """The material points nearest to places (m, 3) at the start, on segments, triangles or in tetrahedra.

    A place a little outside a tetrahedron's mesh belongs to the nearest tetrahedron, whose deformation it follows.
    Raises ValueError for a fluid, which has no lasting neighbours.
    """
    wanted = np.atleast_2d(np.asarray(places, dtype=float))
    if len(mesh.tetrahedra):
        elements, weights = _in_tetrahedra(mesh.nodes, mesh.tetrahedra.astype(np.int64), wanted)
    elif len(mesh.triangles):
        elements, weights = _on_triangles(mesh.nodes, mesh.triangles.astype(np.int64), wanted)
    elif len(mesh.segments):
        elements, weights = _on_segments(mesh.nodes, mesh.segments.astype(np.int64), wanted)
    else:
        raise ValueError("a fluid has no material points to follow: compare its occupancy, amount or front instead")
    found = MaterialPoints(elements, weights, np.zeros(len(wanted)))
    return MaterialPoints(elements, weights, np.linalg.norm(found.places(mesh.nodes) - wanted, axis=1))


def _on_segments(nodes: Array, segments: Ints, places: Array) -> tuple[Ints, Array]:
    a, b = nodes[segments[:, 0]], nodes[segments[:, 1]]
    step = b - a
    share = ((places[:, None] - a) * step).sum(axis=-1) / np.maximum((step**2).sum(axis=-1), 1e-300)
    share = np.clip(share, 0.0, 1.0)
    distance = ((a + share[..., None] * step - places[:, None]) ** 2).sum(axis=-1)
    chosen = np.argmin(distance, axis=1)
    part = share[np.arange(len(places)), chosen]
    return segments[chosen], np.stack([1.0 - part, part], axis=1)


def _on_triangles(nodes: Array, triangles: Ints, places: Array) -> tuple[Ints, Array]:
    elements, weights = np.empty((len(places), 3), dtype=np.int64), np.empty((len(places), 3))
    a, b, c = (nodes[triangles[:, i]] for i in range(3))
    for row, place in enumerate(places):
        barycentric = _nearest_barycentric(a, b, c, place)
        feet = barycentric[:, :1] * a + barycentric[:, 1:2] * b + barycentric[:, 2:] * c
        chosen = int(np.argmin(((feet - place) ** 2).sum(axis=1)))
        elements[row], weights[row] = triangles[chosen], barycentric[chosen]
    return elements, weights


def _nearest_barycentric(a: Array, b: Array, c: Array, place: Array) -> Array:
    """Barycentric coordinates (t, 3) of the points of triangles nearest to a place (3,)."""
    ab, ac, ap = b - a, c - a, place - a
    d11, d12, d22 = (ab * ab).sum(axis=1), (ab * ac).sum(axis=1), (ac * ac).sum(axis=1)
    e1, e2 = (ap * ab).sum(axis=1), (ap * ac).sum(axis=1)
    scale = np.maximum(d11 * d22 - d12**2, 1e-300)
    v, w = (d22 * e1 - d12 * e2) / scale, (d11 * e2 - d12 * e1) / scale
    inside = np.stack([1.0 - v - w, v, w], axis=1)
    best, distance = inside, np.where((inside >= 0.0).all(axis=1), 0.0, np.inf)
    # Outside, the nearest point is on one of the three edges.
    for i, j, begin, step in ((0, 1, a, ab), (0, 2, a, ac), (1, 2, b, c - b)):
        share = ((place - begin) * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-300)
        share = np.clip(share, 0.0, 1.0)
        away = ((begin + share[:, None] * step - place) ** 2).sum(axis=1)
        candidate = np.zeros_like(inside)
        candidate[:, i], candidate[:, j] = 1.0 - share, share
        better = away < distance
        best, distance = np.where(better[:, None], candidate, best), np.where(better, away, distance)
    return best


def _in_tetrahedra(nodes: Array, tetrahedra: Ints, places: Array) -> tuple[Ints, Array]:
    origin = nodes[tetrahedra[:, 0]]
    edges = np.stack([nodes[tetrahedra[:, i]] - origin for i in (1, 2, 3)], axis=2)
    inverse = np.linalg.pinv(edges)
    elements, weights = np.empty((len(places), 4), dtype=np.int64), np.empty((len(places), 4))
    for row, place in enumerate(places):
        part = np.einsum("qij,qj->qi", inverse, place - origin)
        barycentric = np.concatenate([1.0 - part.sum(axis=1, keepdims=True), part], axis=1)
        chosen = int(np.argmax(barycentric.min(axis=1)))
        elements[row], weights[row] = tetrahedra[chosen], barycentric[chosen]
    return elements, weights
