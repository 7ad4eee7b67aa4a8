"""Vertices and faces of simple solids (lengths in m, centred at the origin)."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tests.benchmarks.video_clips.bodies import Array

Faces = list[tuple[int, ...]]


@dataclass(frozen=True)
class Solid:
    """A polygon mesh. vertices: (n, 3). bevel: radius of rounded edges in m, 0 for surfaces that are smooth already.

    uv: (n, 2) coordinates in m on the surface of a thing that bends, else None.
    """

    vertices: Array
    faces: Faces
    bevel: float = 0.0
    uv: Array | None = None


def box(size: tuple[float, float, float], bevel: float = 0.0) -> Solid:
    """Return a box of full extents."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces: Faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Solid(signs * np.asarray(size) / 2, faces, bevel)


def lathe(profile: Array, sides: int, bevel: float = 0.0) -> Solid:
    """Turn a profile of (radius, z) about z; both ends are closed by a face or, at radius 0, by a point."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.vstack([np.column_stack([r * ring, np.full(sides, z)]) for r, z in profile])
    faces: Faces = []
    for i in range(len(profile) - 1):
        for k in range(sides):
            a, b = i * sides + k, i * sides + (k + 1) % sides
            faces.append((a, b, b + sides, a + sides))
    last = (len(profile) - 1) * sides
    faces.append(tuple(reversed(range(sides))))
    faces.append(tuple(range(last, last + sides)))
    return Solid(vertices, faces, bevel)


def sphere(diameter: float, rings: int = 24) -> Solid:
    """Return a sphere; the poles are tiny faces."""
    polar = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    polar[0], polar[-1] = polar[0] + 0.004, polar[-1] - 0.004
    return lathe(np.column_stack([np.cos(polar), np.sin(polar)]) * diameter / 2, 2 * rings)


def cylinder(diameter: float, length: float, bevel: float = 0.0) -> Solid:
    """Return a cylinder along z."""
    return lathe(np.array([[diameter / 2, -length / 2], [diameter / 2, length / 2]]), 64, bevel)


def capsule(diameter: float, length: float) -> Solid:
    """Return a capsule along z; length: of its straight part."""
    polar = np.concatenate([np.linspace(-np.pi / 2 + 0.01, 0.0, 9), np.linspace(0.0, np.pi / 2 - 0.01, 9)])
    shift = np.repeat([-0.5, 0.5], 9) * length
    return lathe(np.column_stack([np.cos(polar) * diameter / 2, np.sin(polar) * diameter / 2 + shift]), 24)


def smooth_path(points: Array, count: int = 72) -> Array:
    """Return points on the cubic spline through the given ones, evenly spaced in the parameter."""
    t = np.arange(len(points))
    return np.asarray(CubicSpline(t, points)(np.linspace(0, len(points) - 1, count)))


def tube(path: Array, diameter: float, sides: int = 14) -> Solid:
    """Sweep a circle along a path (n, 3), the frame carried along without twist; uv: around and along."""
    way = np.gradient(path, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    across = np.cross(way[0], [0.0, 1.0, 0.0] if abs(way[0, 1]) < 0.9 else [1.0, 0.0, 0.0])
    angles = 2 * np.pi * np.arange(sides) / sides
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    rows, uv = [], []
    for p, w, s in zip(path, way, along, strict=True):
        across = across - (across @ w) * w
        across /= np.linalg.norm(across)
        other = np.cross(w, across)
        rows.append(p + diameter / 2 * (np.outer(np.cos(angles), across) + np.outer(np.sin(angles), other)))
        uv.append(np.column_stack([angles * diameter / 2, np.full(sides, s)]))
    faces: Faces = []
    for i in range(len(path) - 1):
        for k in range(sides):
            a, b = i * sides + k, i * sides + (k + 1) % sides
            faces.append((a, b, b + sides, a + sides))
    last = (len(path) - 1) * sides
    faces.extend([tuple(reversed(range(sides))), tuple(range(last, last + sides))])
    return Solid(np.vstack(rows), faces, 0.0, np.vstack(uv))


def sheet(points: Array, cells: tuple[int, int], size: tuple[float, float]) -> Solid:
    """Return a grid surface of points (nx * nz, 3), the second index running fastest."""
    nx, nz = cells
    faces: Faces = []
    for i in range(nx - 1):
        for k in range(nz - 1):
            a = i * nz + k
            faces.append((a, a + nz, a + nz + 1, a + 1))
    grid = np.array([[i * size[0] / (nx - 1), k * size[1] / (nz - 1)] for i in range(nx) for k in range(nz)])
    return Solid(points, faces, 0.0, grid)
