"""Balls and cylinders divided into layers of tetrahedra that follow their surface."""

from __future__ import annotations

import itertools

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int32]


def ball_tetrahedra(radius: float, edge: float) -> tuple[Array, Ints]:
    """Points (p, 3) and tetrahedra (q, 4) of a ball about the origin, in concentric layers about as thick as `edge`.

    The twenty tetrahedra that join an icosahedron's faces to its centre are divided into n^3 each by the Freudenthal
    triangulation, whose faces agree between neighbours, and shells of the icosahedron are moved onto spheres.
    """
    n = max(1, round(radius / edge))
    solid = trimesh.creation.icosahedron()
    steps = [p for p in itertools.product(range(n + 1), repeat=3) if p[0] >= p[1] >= p[2]]
    pieces = [
        [_walk(base, order, m) for m in range(4)]
        for base in itertools.product(range(n), repeat=3)
        for order in itertools.permutations(range(3))
    ]
    inside = [t for t in pieces if all(n >= p[0] >= p[1] >= p[2] >= 0 for p in t)]
    number = {p: i for i, p in enumerate(steps)}
    local = np.array([[number[p] for p in t] for t in inside])
    grid = np.asarray(steps, dtype=float)
    weights = np.stack([grid[:, 0] - grid[:, 1], grid[:, 1] - grid[:, 2], grid[:, 2]], axis=1)
    points = (weights @ np.asarray(solid.vertices)[np.asarray(solid.faces)]).reshape(-1, 3)
    length = np.linalg.norm(points, axis=1)
    shell = np.tile(grid[:, 0] / n * radius, len(solid.faces))
    points = np.where(length[:, None] > 0, points / np.maximum(length, 1e-300)[:, None], 0.0) * shell[:, None]
    tetrahedra = (np.arange(len(solid.faces))[:, None, None] * len(steps) + local).reshape(-1, 4)
    return _merged(points, tetrahedra, 1e-6 * radius)


def cylinder_tetrahedra(radius: float, half_height: float, edge: float) -> tuple[Array, Ints]:
    """Points (p, 3) and tetrahedra (q, 4) of a cylinder about z, in rings and layers about as thick as `edge`."""
    rings, layers = max(1, round(radius / edge)), max(1, round(2.0 * half_height / edge))
    disc, triangles = disc_triangles(radius, rings)
    z = np.linspace(-half_height, half_height, layers + 1)
    points = np.concatenate([np.column_stack([disc, np.full(len(disc), h)]) for h in z])
    # Each prism in three: with corners in ascending order the diagonals of shared sides agree.
    t = np.sort(triangles, axis=1)
    up = t + len(disc)
    prism = np.stack([t[:, 0], t[:, 1], t[:, 2], up[:, 2]], axis=1)
    prism = np.stack(
        [
            prism,
            np.stack([t[:, 0], t[:, 1], up[:, 1], up[:, 2]], axis=1),
            np.stack([t[:, 0], up[:, 0], up[:, 1], up[:, 2]], axis=1),
        ],
        axis=1,
    ).reshape(-1, 4)
    tetrahedra = (np.arange(layers)[:, None, None] * len(disc) + prism).reshape(-1, 4)
    return points, oriented(points, tetrahedra)


def disc_triangles(radius: float, rings: int) -> tuple[Array, Ints]:
    """Points (p, 2) and triangles (t, 3) of a disc: a hexagon's triangular grid with its rings made round."""
    points, triangles = [np.zeros(2)], []
    first = {0: 0}
    for ring in range(1, rings + 1):
        first[ring] = len(points)
        turn = (np.arange(6 * ring) / ring) * (np.pi / 3)
        points.extend(radius * ring / rings * np.stack([np.cos(turn), np.sin(turn)], axis=1))

    def index(ring: int, sector: int, step: int) -> int:
        return 0 if ring == 0 else first[ring] + (sector * ring + step) % (6 * ring)

    for ring, sector in itertools.product(range(1, rings + 1), range(6)):
        for step in range(ring):
            outer, after = index(ring, sector, step), index(ring, sector, step + 1)
            inner = index(ring - 1, sector, step)
            triangles.append([inner, outer, after])
            if step + 1 < ring:
                triangles.append([inner, after, index(ring - 1, sector, step + 1)])
    return np.asarray(points), np.asarray(triangles, dtype=np.int32)


def oriented(points: Array, tetrahedra: NDArray[np.integer]) -> Ints:
    """The same tetrahedra with positive volume."""
    e = points[tetrahedra[:, 1:]] - points[tetrahedra[:, :1]]
    flip = np.linalg.det(e) < 0.0
    turned = tetrahedra.copy()
    turned[flip, 2], turned[flip, 3] = tetrahedra[flip, 3], tetrahedra[flip, 2]
    return turned.astype(np.int32)


def _walk(base: tuple[int, ...], order: tuple[int, ...], steps: int) -> tuple[int, ...]:
    """Corner of a cell reached from `base` by going one along each of the first `steps` axes in `order`."""
    corner = list(base)
    for axis in order[:steps]:
        corner[axis] += 1
    return tuple(corner)


def _merged(points: Array, tetrahedra: NDArray[np.integer], tolerance: float) -> tuple[Array, Ints]:
    """Points nearer than the tolerance made one."""
    key = np.rint(points / tolerance).astype(np.int64)
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    kept = points[first]
    return kept, oriented(kept, inverse.reshape(-1)[tetrahedra])
