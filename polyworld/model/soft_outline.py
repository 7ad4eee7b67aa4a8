"""Slices of bodies: what the motion plane cuts out of a shape, divided into triangles."""

from __future__ import annotations

import itertools

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from polyworld.core import interruption

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

CORNER = np.radians(30.0)  # turns of the outline larger than this stay where they are
ROUNDS = 8  # of parting edges of the outline that the triangulation does not have


def rectangle_triangles(size: Array, edge: float) -> tuple[Array, Ints]:
    """Points (p, 2) and counter-clockwise triangles of a rectangle about the origin; neighbours mirror each other."""
    count = np.maximum(1, np.rint(size / edge).astype(int))
    x, y = (np.linspace(-0.5 * a, 0.5 * a, n + 1) for a, n in zip(size, count, strict=True))
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    i, j = (g.ravel() for g in np.meshgrid(np.arange(count[0]), np.arange(count[1]), indexing="ij"))
    a = i * (count[1] + 1) + j
    b, c, d = a + count[1] + 1, a + count[1] + 2, a + 1
    odd = ((i + j) % 2 == 1)[:, None, None]
    one = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1)
    two = np.stack([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)], axis=1)
    return points, np.where(odd, two, one).reshape(-1, 3).astype(np.int32)


def section(solid: trimesh.Trimesh) -> list[Array]:
    """Closed outlines (k, 2) in which the plane z = 0 cuts a closed mesh; none where it misses."""
    vertices = np.asarray(solid.vertices, dtype=float)
    size = float(np.ptp(vertices, axis=0).max())
    above = vertices[:, 2] > 0.0  # a vertex in the plane counts as below: every cut face has two cut edges
    links: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face in np.asarray(solid.faces)[np.ptp(above[np.asarray(solid.faces)].astype(int), axis=1) > 0].tolist():
        a, b = ((min(p, q), max(p, q)) for p, q in zip(face, face[1:] + face[:1], strict=True) if above[p] != above[q])
        links.setdefault(a, []).append(b)
        links.setdefault(b, []).append(a)
    loops = []
    while links:
        loop = [min(links)]
        while loop[-1] in links:
            onward = [k for k in links.pop(loop[-1]) if k in links]
            if onward:
                loop.append(onward[0])
        low, high = np.asarray(loop).T
        share = vertices[low, 2] / (vertices[low, 2] - vertices[high, 2])
        place = (vertices[low] + share[:, None] * (vertices[high] - vertices[low]))[:, :2]
        place = place[np.linalg.norm(place - np.roll(place, 1, axis=0), axis=1) > 1e-6 * size]
        if len(place) > 2:
            loops.append(place)
    return loops


def outline_triangles(loops: list[Array], edge: float) -> tuple[Array, Ints]:
    """Points (p, 2) and counter-clockwise triangles that fill closed outlines; inner ones are holes.

    Raises ValueError where the outline is too intricate for the edge length [m].
    """
    rings = [_resampled(loop, edge) for loop in loops]
    lower = np.min([r.min(axis=0) for r in rings], axis=0)
    upper = np.max([r.max(axis=0) for r in rings], axis=0)
    inner = _hexagonal(lower, upper, edge)
    inner = inner[_inside(loops, inner)]
    for _ in range(ROUNDS):
        interruption.check()
        rim = np.concatenate(rings)
        away = np.linalg.norm(inner[:, None] - rim[None], axis=2).min(axis=1, initial=np.inf)
        points = np.concatenate([rim, inner[away > 0.65 * edge]])
        triangles = Delaunay(points).simplices
        a, b, c = (points[triangles[:, k]] for k in range(3))
        area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        keep = (np.abs(area) > 1e-5 * edge**2) & _inside(loops, (a + b + c) / 3.0)
        triangles = np.where((area < 0.0)[:, None], triangles[:, ::-1], triangles)[keep]
        rings, complete = _with_missing(rings, triangles)
        if complete:
            return points, triangles.astype(np.int32)
    raise ValueError(f"the outline is too intricate for elements of {edge:.3g} m: give a smaller resolution")


def nearest_on(loops: list[Array], points: Array) -> Array:
    """Nearest points (n, 2) of the outlines."""
    start = np.concatenate(loops)
    along = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops]) - start
    t = ((points[:, None] - start) * along).sum(axis=2) / (along**2).sum(axis=1)
    place = start + np.clip(t, 0.0, 1.0)[..., None] * along
    best = np.linalg.norm(points[:, None] - place, axis=2).argmin(axis=1)
    found: Array = place[np.arange(len(points)), best]
    return found


def area(loops: list[Array]) -> float:
    """Area inside outlines, holes taken off [m^2]."""
    signed = []
    for loop in loops:
        x, y = loop.T
        signed.append(abs(0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))))
    depth = [sum(bool(_inside([other], loop[:1])[0]) for other in loops if other is not loop) for loop in loops]
    return float(sum(-s if d % 2 else s for s, d in zip(signed, depth, strict=True)))


def _resampled(loop: Array, edge: float) -> Array:
    """The outline in steps of about the edge length, its corners kept."""
    before, after = loop - np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0) - loop
    turn = np.abs(np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1)))
    corners = np.flatnonzero(turn > CORNER)
    loop = np.roll(loop, -int(corners[0]), axis=0) if len(corners) else loop
    corners = corners - corners[0] if len(corners) else np.array([0])
    path = np.concatenate([loop, loop[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    stops = np.append(length[corners], length[-1])
    least = {1: 6, 2: 3}.get(len(corners), 1)  # steps from one corner to the next, that the outline keeps an area
    at = [np.linspace(a, b, max(least, round((b - a) / edge)), endpoint=False) for a, b in itertools.pairwise(stops)]
    s = np.concatenate(at)
    return np.stack([np.interp(s, length, path[:, k]) for k in range(2)], axis=1)


def _hexagonal(lower: Array, upper: Array, edge: float) -> Array:
    """Points of a triangular grid over a box, symmetric about its middle."""
    height = edge * np.sqrt(0.75)
    half = np.ceil((upper - lower) / 2.0 / np.array([edge, height])).astype(int) + 1
    i, j = np.meshgrid(np.arange(-half[0], half[0] + 1), np.arange(-half[1], half[1] + 1), indexing="ij")
    x = (i + 0.5 * (j % 2)) * edge
    return np.stack([x.ravel(), (j * height).ravel()], axis=1) + 0.5 * (lower + upper)


def _inside(loops: list[Array], points: Array) -> NDArray[np.bool_]:
    """Whether points (n, 2) lie inside an odd number of outlines."""
    inside = np.zeros(len(points), dtype=bool)
    for loop in loops:
        after = np.roll(loop, -1, axis=0)
        for a, b in zip(loop, after, strict=True):
            if a[1] == b[1]:
                continue
            spans = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
            inside ^= spans & (points[:, 0] < a[0] + (points[:, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
    return inside


def _with_missing(rings: list[Array], triangles: NDArray[np.integer]) -> tuple[list[Array], bool]:
    """Outlines with the edges that no triangle has parted in two; whether there were none."""
    present = {tuple(sorted(e)) for t in triangles.tolist() for e in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))}
    parted, first, complete = [], 0, True
    for ring in rings:
        numbers = first + np.arange(len(ring))
        first += len(ring)
        points = []
        for k, (a, b) in enumerate(zip(numbers.tolist(), np.roll(numbers, -1).tolist(), strict=True)):
            points.append(ring[k])
            if (min(a, b), max(a, b)) not in present:
                points.append(0.5 * (ring[k] + ring[(k + 1) % len(ring)]))
                complete = False
        parted.append(np.asarray(points))
    return parted, complete
