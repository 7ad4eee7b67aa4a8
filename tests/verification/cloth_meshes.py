"""Strips and plates cut in different ways, so that no result may depend on how."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from polyworld import World

Array = NDArray[np.float64]


def sheet(size: tuple[float, float], divisions: tuple[int, int], start: float = 0.0) -> dict[str, Any]:
    """A rectangle in the x-y plane from x = start, on a regular grid."""
    return {
        "kind": "sheet",
        "corner": (start, 0.0, 0.0),
        "edge_u": (size[0], 0.0, 0.0),
        "edge_v": (0.0, size[1], 0.0),
        "divisions": divisions,
    }


def scattered(size: tuple[float, float], divisions: tuple[int, int], start: float, seed: int) -> dict[str, Any]:
    """The same rectangle with nodes moved by up to 0.3 of their distance; those at x <= 0 stay on their lines."""
    nx, ny = divisions
    h = np.array([size[0] / nx, size[1] / ny])
    x, y = np.meshgrid(np.arange(nx + 1) * h[0], np.arange(ny + 1) * h[1], indexing="ij")
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    shift = np.random.default_rng(seed).uniform(-0.3, 0.3, points.shape) * h
    x_kept = (points[:, 0] < -start + 1e-9) | (points[:, 0] > size[0] - 1e-9)
    shift[x_kept, 0] = 0.0
    shift[(points[:, 1] < 1e-9) | (points[:, 1] > size[1] - 1e-9), 1] = 0.0
    return triangulated(points + shift, start)


def slanted(size: tuple[float, float], divisions: tuple[int, int], start: float, angle: float) -> dict[str, Any]:
    """The same rectangle filled by a square grid that is turned by `angle` against it, with its border cut straight."""
    nx, ny = divisions
    h = size[0] / nx
    k = np.arange(-2 * nx, 2 * nx + 1) * h
    a, b = np.meshgrid(k, k, indexing="ij")
    c, s = np.cos(angle), np.sin(angle)
    inner = np.stack([c * a - s * b, s * a + c * b], axis=-1).reshape(-1, 2) + np.array(size) / 2
    lines = [np.arange(ny + 1) * size[1] / ny]
    fixed = [np.stack([np.full(ny + 1, x), lines[0]], axis=1) for x in (0.0, -start, size[0])]
    along = np.arange(nx + 1) * h
    fixed += [np.stack([along, np.full(nx + 1, y)], axis=1) for y in (0.0, size[1])]
    border = np.unique(np.round(np.concatenate(fixed), 12), axis=0)
    clear = 0.45 * h
    keep = (inner > clear).all(axis=1) & (inner < np.array(size) - clear).all(axis=1)
    keep &= np.abs(inner[:, 0] + start) > clear
    return triangulated(np.concatenate([border, inner[keep]]), start)


def triangulated(points: Array, start: float) -> dict[str, Any]:
    """Points (k, 2) as a surface mesh in the x-y plane, moved to begin at x = start."""
    faces = Delaunay(points).simplices
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces = faces[np.abs(area) > 1e-9]
    vertices = np.column_stack([points[:, 0] + start, points[:, 1], np.zeros(len(points))])
    return {"kind": "mesh", "vertices": vertices.tolist(), "faces": faces.tolist()}


def held_strip(geometry: Any, *, gravity: tuple[float, float, float] = (0.0, 0.0, 0.0), **cloth: Any) -> World:
    """A cloth `strip` without air, lateral contraction or contacts with itself, held where x = 0."""
    held = {"name": "wall", "object": "strip", "region": {"lower": (-1, -1, -1), "upper": (1e-6, 1, 1)}}
    fields = {"name": "strip", "representation": "cloth", "geometry": geometry, "poisson_ratio": 0.0, **cloth}
    environment = {"gravity": gravity, "air_density": 0.0}
    parts = {"deformables": [{"self_contact": False, **fields}], "attachments": [held], "environment": environment}
    return World.model_validate(parts)
