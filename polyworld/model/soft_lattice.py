"""Bodies of any shape filled with tetrahedra of a body-centred cubic lattice, cut off at their surface.

After Labelle & Shewchuk (2007, Isosurface Stuffing): lattice points near the surface are moved onto it, and what
remains of tetrahedra that it cuts is divided again. Unlike meshers that improve a mesh by chance and threads, it gives
the same mesh on every call; all but elements at sharp edges are well shaped.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from polyworld.core import interruption
from polyworld.model.soft_elements import QuadraticMesh, quadratic_solid, with_volume
from polyworld.model.soft_round import oriented
from polyworld.model.soft_surface import Surface

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

LONG, SHORT = 0.25, 0.41  # part of a lattice edge within which a cut point draws an end of it onto the surface
KEEN = 0.6  # part of the edge length within which a point of the surface is drawn onto a sharp edge
FLAT = 0.2  # least quality of an element after that, 1 for a regular tetrahedron
MOST = 400_000  # elements
CELL = 1.25  # edge of the lattice's cubes, in units of the edge asked for: its tetrahedra have shorter edges too
PASSES = 4  # over all points, to improve the worst elements
LACKING = 0.03  # part of the volume that may lack: where edges are lost, the lattice is made finer


def filled(surface: Surface, edge: float, volume: float) -> QuadraticMesh:
    """Quadratic tetrahedra that fill a surface around a volume [m^3], scaled to have just that.

    Edges are about as long as asked [m], shorter where the shape would else be lost. Raises ValueError where elements
    would be too many, or the body is too thin to hold any.
    """
    mesh = None
    for finer in 0.8 ** np.arange(6):
        interruption.check()
        points, cells = lattice_tetrahedra(surface, CELL * finer * edge)
        if len(cells):
            mesh = quadratic_solid(points, cells, lambda p: surface.nearest(p)[0])
            if abs(mesh.measure().sum() / volume - 1.0) < LACKING:
                break
    if mesh is None:
        raise ValueError(f"the body is too thin for elements of {edge:.3g} m: give a smaller resolution")
    return with_volume(mesh, volume)


def lattice_tetrahedra(surface: Surface, edge: float) -> tuple[Array, Ints]:
    """Points (p, 3) and tetrahedra (q, 4), perhaps none, from a lattice whose cubes have the given edge [m]."""
    points, cells, pairs, reach = _lattice(surface, edge)
    nearest, depth = surface.nearest(points)
    depth[np.abs(depth) < 1e-9 * edge] = 0.0
    # Points drawn onto the surface: those with a cut near them on one of their edges.
    a, b = pairs.T
    crossing = depth[a] * depth[b] < 0.0
    a, b, near = a[crossing], b[crossing], reach[crossing]
    share = depth[a] / (depth[a] - depth[b])
    drawn = np.zeros(len(points), dtype=bool)
    drawn[a[share < near]] = True
    drawn[b[1.0 - share < near]] = True
    points = np.where(drawn[:, None], nearest, points)
    depth = np.where(drawn, 0.0, depth)
    points, cells = _cut(points, depth, cells[(depth[cells] > 0.0).any(axis=1)], surface)
    if not len(cells):
        return points, cells.astype(np.int32)
    cells = _largest_piece(cells)
    used, inverse = np.unique(cells, return_inverse=True)
    points = points[used]
    return _improved(points, oriented(points, inverse.reshape(cells.shape)), surface, edge)


def quality(points: Array, cells: Ints) -> Array:
    """Volume over cubed root-mean-square edge length (q,), 1 for a regular tetrahedron, negative if inside out."""
    corners = points[cells]
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    square = sum(((corners[:, i] - corners[:, j]) ** 2).sum(axis=1) for i, j in itertools.combinations(range(4), 2))
    measure: Array = 6.0 * np.sqrt(2.0) * volume / (square / 6.0) ** 1.5
    return measure


def _lattice(surface: Surface, edge: float) -> tuple[Array, Ints, Ints, Array]:
    """Points, tetrahedra, edges, and the part of each edge within which its ends are drawn onto the surface."""
    lower, upper = surface.bounds()
    extent = upper - lower
    count = np.ceil(extent / edge + 1e-9).astype(int) + 2
    if 12 * int(np.prod(count)) > MOST:
        raise ValueError(
            f"elements of {edge:.3g} m in a box of {np.round(extent, 4).tolist()} m are more than {MOST}: "
            "give a larger resolution"
        )
    origin = 0.5 * (lower + upper) - 0.5 * edge * count
    corner = np.arange(int(np.prod(count + 1))).reshape(count + 1)
    middle = corner.size + np.arange(int(np.prod(count))).reshape(count)
    points = origin + edge * np.concatenate([_grid(count + 1), _grid(count) + 0.5])
    cells, long, short = [], [], []
    for axis in range(3):
        first = np.moveaxis(middle, axis, 0)
        low, high = first[:-1].reshape(-1), first[1:].reshape(-1)
        long.append(np.stack([low, high], axis=1))
        grid = np.moveaxis(corner, axis, 0)
        long.append(np.stack([grid[:-1].reshape(-1), grid[1:].reshape(-1)], axis=1))
        # Corners around the face between two cells, in order; axes after moveaxis are (axis, lower, higher).
        face = grid[1:-1]
        ring = [face[:, :-1, :-1], face[:, 1:, :-1], face[:, 1:, 1:], face[:, :-1, 1:]]
        ring = [r.reshape(-1) for r in ring]
        for k in range(4):
            cells.append(np.stack([low, high, ring[k], ring[(k + 1) % 4]], axis=1))
    for i, j, k in itertools.product((0, 1), repeat=3):
        ends = corner[i : i + count[0], j : j + count[1], k : k + count[2]]
        short.append(np.stack([middle.reshape(-1), ends.reshape(-1)], axis=1))
    pairs = np.concatenate(long + short)
    reach: Array = np.repeat([LONG, SHORT], [sum(map(len, long)), sum(map(len, short))])
    return points, np.concatenate(cells).astype(np.int32), pairs.astype(np.int32), reach


def _grid(count: NDArray[np.integer]) -> Array:
    steps = np.meshgrid(*(np.arange(n, dtype=float) for n in count), indexing="ij")
    return np.stack(steps, axis=-1).reshape(-1, 3)


def _cut(points: Array, depth: Array, cells: Ints, surface: Surface) -> tuple[Array, Ints]:
    """Tetrahedra cut off where the depth changes sign; the inner parts, pyramids and wedges, divided again."""
    whole = (depth[cells] >= 0.0).all(axis=1)
    kept = [cells[whole]]
    cut = cells[~whole]
    found: dict[tuple[int, int], int] = {}
    extra: list[Array] = []

    def crossing(inner: int, outer: int) -> int:
        key = (inner, outer)
        if key not in found:
            share = depth[inner] / (depth[inner] - depth[outer])
            found[key] = len(points) + len(extra)
            extra.append(points[inner] + share * (points[outer] - points[inner]))
        return found[key]

    pieces: list[list[int]] = []
    for cell in cut.tolist():
        interruption.check()
        inner = [p for p in cell if depth[p] > 0.0]
        level = [p for p in cell if depth[p] == 0.0]
        outer = [p for p in cell if depth[p] < 0.0]
        pieces.extend(_inner_part(inner, level, outer, crossing))
    if not extra:
        return points, np.concatenate(kept)
    moved, _ = surface.nearest(np.asarray(extra))
    return np.concatenate([points, moved]), np.concatenate([*kept, np.asarray(pieces)])


def _inner_part(
    inner: list[int], level: list[int], outer: list[int], crossing: Callable[[int, int], int]
) -> list[list[int]]:
    """Split the part inside the surface of a tetrahedron with corners inside, on and outside it."""
    if len(inner) == 1:
        return [[inner[0], *level, *(crossing(inner[0], o) for o in outer)]]
    if len(inner) == 2 and len(outer) == 1:  # a pyramid: its top is the point on the surface
        a, b = inner
        return _pyramid(level[0], [a, b, crossing(b, outer[0]), crossing(a, outer[0])])
    if len(inner) == 2:  # a wedge with the triangles (a, a0, a1) and (b, b0, b1)
        a, b = inner
        first = [a, crossing(a, outer[0]), crossing(a, outer[1])]
        return _wedge(first, [b, crossing(b, outer[0]), crossing(b, outer[1])])
    return _wedge(inner, [crossing(i, outer[0]) for i in inner])


def _pyramid(top: int, base: list[int]) -> list[list[int]]:
    """Two tetrahedra, parted by the diagonal of the base through its lowest number, as the neighbour's is."""
    k = base.index(min(base))
    a, b, c, d = base[k:] + base[:k]
    return [[top, a, b, c], [top, a, c, d]]


def _wedge(first: list[int], second: list[int]) -> list[list[int]]:
    """Three tetrahedra: every four-sided face parted by the diagonal through its lowest number."""
    k = min(range(3), key=lambda i: min(first[i], second[i]))
    if second[k] < first[k]:
        first, second = second, first
    a, b, c = first[k:] + first[:k]
    d, e, f = second[k:] + second[:k]
    # Both faces at the lowest number a are parted from it; what remains is a pyramid over the third.
    return [[a, d, e, f], *_pyramid(a, [b, c, f, e])]


def _largest_piece(cells: Ints) -> Ints:
    """Crumbs that hang on by less than a face fall off."""
    faces = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    owner = np.repeat(np.arange(len(cells)), 4)
    order = np.lexsort(faces.T)
    same = (faces[order][1:] == faces[order][:-1]).all(axis=1)
    a, b = owner[order][1:][same], owner[order][:-1][same]
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(cells), len(cells)))
    _, label = connected_components(graph, directed=False)
    piece: Ints = cells[label == np.bincount(label).argmax()]
    return piece


def _improved(points: Array, cells: Ints, surface: Surface, edge: float) -> tuple[Array, Ints]:
    """Points of the surface near corners and sharp edges moved onto them, then all others to where the worst element
    around them is better: towards the middle of their neighbours, those of the surface along it."""
    faces = np.sort(cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    _, first, count = np.unique(faces, axis=0, return_index=True, return_counts=True)
    skin = faces[first[count == 1]]
    outer = np.unique(skin)
    order = np.argsort(cells.ravel(), kind="stable")
    around = np.split(order // 4, np.cumsum(np.bincount(cells.ravel(), minlength=len(points)))[:-1])
    points = points.copy()

    def moves(point: int, target: Array, least: float) -> bool:
        """Move one point unless the worst element around it gets worse and worse than `least`."""
        kept = points[point].copy()
        touched = cells[around[point]]
        before = quality(points, touched).min()
        points[point] = target
        if quality(points, touched).min() >= min(before, least):
            return True
        points[point] = kept
        return False

    fixed = _sharpen(points, outer, surface.edges(), edge, moves)
    on_skin = np.isin(np.arange(len(points)), outer)
    for _ in range(PASSES):
        for point in range(len(points)):
            interruption.check()
            if point in fixed:
                continue
            near = np.unique((skin[(skin == point).any(axis=1)] if on_skin[point] else cells[around[point]]).ravel())
            target = points[near[near != point]].mean(axis=0)
            if on_skin[point]:
                target = surface.nearest(target[None])[0][0]
            for part in (1.0, 0.5, 0.25):
                if moves(point, points[point] + part * (target - points[point]), np.inf):
                    break
    return points, cells


def _sharpen(
    points: Array, outer: Ints, edges: Array, edge: float, moves: Callable[[int, Array, float], bool]
) -> set[int]:
    """Draw points of the surface onto corners, and others onto sharp edges; returns those that were."""
    fixed: set[int] = set()
    if not len(edges):
        return fixed
    for corner in _corners(edges):
        interruption.check()
        distance = np.linalg.norm(points[outer] - corner, axis=1)
        for row in np.argsort(distance, kind="stable")[:4]:
            point = int(outer[row])
            if point not in fixed and distance[row] < 1.5 * KEEN * edge and moves(point, corner, FLAT):
                fixed.add(point)
                break
    target, distance = _nearest_on(edges, points[outer])
    for row in np.argsort(distance, kind="stable"):
        interruption.check()
        point = int(outer[row])
        if point not in fixed and distance[row] < KEEN * edge and moves(point, target[row], FLAT):
            fixed.add(point)
    return fixed


def _corners(edges: Array) -> Array:
    """Ends of sharp edges (c, 3) at which they do not go straight on."""
    ends = edges.reshape(-1, 3)
    away = (edges[:, ::-1] - edges).reshape(-1, 3)
    away = away / np.linalg.norm(away, axis=1)[:, None]
    place, inverse = np.unique(ends, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    count = np.bincount(inverse)
    total = np.zeros_like(place)
    np.add.at(total, inverse, away)
    straight = (count == 2) & (np.linalg.norm(total, axis=1) < 0.5)
    corners: Array = place[~straight]
    return corners


def _nearest_on(edges: Array, points: Array) -> tuple[Array, Array]:
    """Nearest point (n, 3) of any edge to each point, and its distance (n,)."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    t = ((points[:, None] - start) * along).sum(axis=2) / (along**2).sum(axis=1)
    place = start + np.clip(t, 0.0, 1.0)[..., None] * along
    distance = np.linalg.norm(points[:, None] - place, axis=2)
    best = distance.argmin(axis=1)
    rows = np.arange(len(points))
    return place[rows, best], distance[rows, best]
