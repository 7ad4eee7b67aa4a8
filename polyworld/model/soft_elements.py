"""Quadratic elements: nodes halfway along every edge, and the geometry that the solver needs of them.

An element's nodes are its corners, then the middles of its edges in the order of `EDGES`. Shape functions are
N_i = L_i (2 L_i - 1) at corners and 4 L_i L_j at middles, in barycentric coordinates L; see any finite element text,
for example Zienkiewicz & Taylor, The Finite Element Method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

TETRAHEDRON_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])  # outward

# Quadrature point q has barycentric coordinate NEAR at corner q and FAR at the others; equal weights.
TETRAHEDRON_FAR = (5.0 - np.sqrt(5.0)) / 20.0  # degree 2 with four points
TETRAHEDRON_NEAR = 1.0 - 3.0 * TETRAHEDRON_FAR
TRIANGLE_FAR, TRIANGLE_NEAR = 1.0 / 6.0, 2.0 / 3.0  # degree 2 with three points

# Shares of an element's mass (Hinton, Rock & Zienkiewicz 1976: the consistent mass matrix's diagonal, scaled).
TETRAHEDRON_SHARES = np.array([1.0 / 36.0] * 4 + [4.0 / 27.0] * 6)
TRIANGLE_SHARES = np.array([1.0 / 19.0] * 3 + [16.0 / 57.0] * 3)

# Linear pieces of one element, in its own node numbers: four at the corners and four of the octahedron between.
_SUB_TETRAHEDRA = np.array(
    [[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3], [4, 9, 5, 6], [4, 9, 6, 8], [4, 9, 8, 7], [4, 9, 7, 5]]
)
_SUB_TRIANGLES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


@dataclass(frozen=True, eq=False)  # compared and hashed by identity: a mesh is a key of caches
class QuadraticMesh:
    """A solid of 10-node tetrahedra, or a slice of 6-node triangles, without forces.

    nodes (k, 3) [m]; elements (q, 10) or (q, 6); boundary (b, 6) outward faces of a solid with their middles, or
    (b, 3) edges of a slice with theirs, the inside on their left. thickness: of a slice [m], 1 of a solid.
    """

    nodes: Array
    elements: Ints
    boundary: Ints
    thickness: float = 1.0

    @property
    def planar(self) -> bool:
        """Whether it is a slice of triangles."""
        return bool(self.elements.shape[1] == 6)

    @property
    def corners(self) -> int:
        """Corners of an element: 4 or 3."""
        return 3 if self.planar else 4

    def gradients(self) -> tuple[Array, Array]:
        """Gradients of the barycentric coordinates and weights at the quadrature points.

        Returns (q, c, c, 3): gradient [1/m] of coordinate i at point p of an element in [.., p, i], and (q, c): the
        volume [m^3] that a point stands for. c is the number of corners.
        """
        near, far = (TRIANGLE_NEAR, TRIANGLE_FAR) if self.planar else (TETRAHEDRON_NEAR, TETRAHEDRON_FAR)
        slope = barycentric_slopes(self, near, far)
        edges = slope[:, :, 1:] - slope[:, :, :1]  # rows: derivative of place by coordinate 1, 2, (3)
        if self.planar:
            edges = edges[..., :2]
        measure = np.linalg.det(edges) / (2.0 if self.planar else 6.0)
        if measure.min() <= 0.0:
            worst = int(measure.min(axis=1).argmin())
            raise ValueError(f"element {worst} of the mesh is turned inside out or flat")
        inverse = np.swapaxes(np.linalg.inv(edges), -1, -2)  # rows: gradients of coordinates 1, 2, (3)
        gradient = np.concatenate([-inverse.sum(axis=-2, keepdims=True), inverse], axis=-2)
        if self.planar:
            gradient = np.concatenate([gradient, np.zeros((*gradient.shape[:-1], 1))], axis=-1)
        return gradient, measure * (self.thickness / self.corners)

    def measure(self) -> Array:
        """Volume that each node stands for (k,) [m^3]."""
        _, weight = self.gradients()
        shares = TRIANGLE_SHARES if self.planar else TETRAHEDRON_SHARES
        total = np.zeros(len(self.nodes))
        np.add.at(total, self.elements, weight.sum(axis=1)[:, None] * shares)
        return total

    def triangles(self) -> Ints:
        """Linear triangles (t, 3) of a solid's surface, outward, or of a slice."""
        faces = self.elements if self.planar else self.boundary
        pieces: Ints = faces[:, _SUB_TRIANGLES].reshape(-1, 3)
        return pieces

    def segments(self) -> Ints:
        """Linear segments (s, 2) of a slice's outline, the inside on their left; none of a solid."""
        if not self.planar:
            return np.zeros((0, 2), dtype=np.int32)
        pieces: Ints = self.boundary[:, [[0, 2], [2, 1]]].reshape(-1, 2)
        return pieces

    def tetrahedra(self) -> Ints:
        """Linear tetrahedra (8 q, 4) that fill a solid, their faces on its surface being `triangles`."""
        if self.planar:
            return np.zeros((0, 4), dtype=np.int32)
        pieces: Ints = self.elements[:, _SUB_TETRAHEDRA].reshape(-1, 4)
        return pieces


def barycentric_slopes(mesh: QuadraticMesh, near: float, far: float) -> Array:
    """Derivative of place by each barycentric coordinate (q, c, c, 3) at points near each corner: [.., p, i]."""
    table = node_table(mesh.elements, mesh.corners)
    x = mesh.nodes[table]  # (q, c, c, 3): corner i at [i, i], middle of i and j at [i, j]
    c = mesh.corners
    own = x[:, np.arange(c), np.arange(c)]
    common = 4.0 * far * x.sum(axis=2) - own
    slope: Array = common[:, None] + 4.0 * (near - far) * np.swapaxes(x, 1, 2)
    return slope


def node_table(elements: Ints, corners: int) -> Ints:
    """Nodes (q, c, c) of elements: corner i at [i, i], the middle of corners i and j at [i, j] and [j, i]."""
    edges = TRIANGLE_EDGES if corners == 3 else TETRAHEDRON_EDGES
    table = np.zeros((len(elements), corners, corners), dtype=np.int32)
    for i in range(corners):
        table[:, i, i] = elements[:, i]
    for k, (i, j) in enumerate(edges):
        table[:, i, j] = table[:, j, i] = elements[:, corners + k]
    return table


def quadratic_solid(points: Array, tetrahedra: Ints, snap: Callable[[Array], Array] | None = None) -> QuadraticMesh:
    """10-node tetrahedra from points (p, 3) and tetrahedra (q, 4).

    `snap` moves middles of edges on the surface to the true surface, where the elements stay well shaped.
    """
    nodes, elements, middle = _with_middles(points, tetrahedra, TETRAHEDRON_EDGES)
    faces = tetrahedra[:, FACES].reshape(-1, 3)
    key = np.sort(faces, axis=1)
    _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
    outer = faces[np.sort(first[count == 1])]
    middles = np.stack([middle(outer[:, i], outer[:, j]) for i, j in TRIANGLE_EDGES], axis=1)
    boundary = np.concatenate([outer, middles], axis=1).astype(np.int32)
    mesh = QuadraticMesh(nodes, elements, boundary)
    return mesh if snap is None else _snapped(mesh, np.unique(middles), snap)


def quadratic_slice(
    points: Array, triangles: Ints, thickness: float, snap: Callable[[Array], Array] | None = None
) -> QuadraticMesh:
    """6-node triangles from points (p, 2) and counter-clockwise triangles (q, 3); see `quadratic_solid`."""
    flat = np.column_stack([points, np.zeros(len(points))])
    nodes, elements, middle = _with_middles(flat, triangles, TRIANGLE_EDGES)
    edges = triangles[:, TRIANGLE_EDGES].reshape(-1, 2)
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    outer = edges[np.sort(first[count == 1])]
    middles = middle(outer[:, 0], outer[:, 1])
    mesh = QuadraticMesh(nodes, elements, np.column_stack([outer, middles]).astype(np.int32), thickness)
    return mesh if snap is None else _snapped(mesh, np.unique(middles), snap)


def _with_middles(
    points: Array, cells: Ints, edges: NDArray[np.integer]
) -> tuple[Array, Ints, Callable[[Ints, Ints], Ints]]:
    pairs = np.sort(cells[:, edges].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    nodes = np.concatenate([points, 0.5 * (points[unique[:, 0]] + points[unique[:, 1]])])
    elements = np.concatenate([cells, len(points) + inverse.reshape(len(cells), -1)], axis=1).astype(np.int32)
    code = unique[:, 0].astype(np.int64) * len(points) + unique[:, 1]  # ascending, as np.unique sorts rows

    def middle(a: Ints, b: Ints) -> Ints:
        low, high = np.minimum(a, b).astype(np.int64), np.maximum(a, b)
        found: Ints = (len(points) + np.searchsorted(code, low * len(points) + high)).astype(np.int32)
        return found

    return nodes, elements, middle


def _snapped(mesh: QuadraticMesh, middles: Ints, snap: Callable[[Array], Array]) -> QuadraticMesh:
    """Middles moved to the true surface, less far where an element would become badly shaped."""
    straight = mesh.nodes[middles]
    target = snap(straight)
    share = np.ones(len(middles))
    rest = _worst_jacobian(mesh)
    while True:
        nodes = mesh.nodes.copy()
        nodes[middles] = straight + share[:, None] * (target - straight)
        curved = replace(mesh, nodes=nodes)
        bad = _worst_jacobian(curved) < 0.4 * rest
        if not bad.any():
            return curved
        hit = np.isin(middles, mesh.elements[bad]) & (share > 0.0)
        share[hit] = np.where(share[hit] > 0.3, share[hit] - 0.25, 0.0)


def _worst_jacobian(mesh: QuadraticMesh) -> Array:
    """Smallest volume density of each element (q,) at its corners and quadrature points."""
    worst = np.full(len(mesh.elements), np.inf)
    near = TRIANGLE_NEAR if mesh.planar else TETRAHEDRON_NEAR
    for share in (1.0, near):
        slope = barycentric_slopes(mesh, share, (1.0 - share) / (mesh.corners - 1))
        edges = slope[:, :, 1:] - slope[:, :, :1]
        worst = np.minimum(worst, np.linalg.det(edges[..., :2] if mesh.planar else edges).min(axis=1))
    return worst


def with_volume(mesh: QuadraticMesh, volume: float) -> QuadraticMesh:
    """The same, scaled about its centre of mass by the little that its volume [m^3] lacks."""
    measure = mesh.measure()
    centre = measure @ mesh.nodes / measure.sum()
    scale = (volume / measure.sum()) ** (0.5 if mesh.planar else 1.0 / 3.0)
    return replace(mesh, nodes=centre + scale * (mesh.nodes - centre))
