"""Directions across a rope at its start, on the host: parallel transport along it, and its angle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def across(direction: Array) -> Array:
    """Return a unit vector perpendicular to a direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    vector: Array = np.cross(direction, other)
    return vector / np.linalg.norm(vector)


def carried(before: Array, after: Array, vector: Array) -> Array:
    """Return a vector turned by the least rotation that takes one unit vector into another."""
    axis, cosine = np.cross(before, after), max(float(before @ after), -0.999)
    turned: Array = vector * cosine + np.cross(axis, vector) + axis * (axis @ vector) / (1.0 + cosine)
    return turned


def parallel_angle(nodes: Array, start: tuple[Array, Array], end: tuple[Array, Array]) -> float:
    """Angle [rad] from the director of the start, carried along the rope, to that of the end; pairs of direction and
    director."""
    t, u = start
    for step in np.diff(nodes, axis=0):
        following = step / np.linalg.norm(step)
        t, u = following, carried(t, following, u)
    u = carried(t, end[0], u)
    return float(np.arctan2(end[0] @ np.cross(u, end[1]), u @ end[1]))


def reference_frames(nodes: Array, start: tuple[Array, Array]) -> tuple[Array, Array]:
    """Directions (m, 3) of the segments, and directions across them (m, 3), carried on from the start's director."""
    t, u = start
    directions, across_them = [], []
    for step in np.diff(nodes, axis=0):
        following = step / np.linalg.norm(step)
        t, u = following, carried(t, following, u)
        directions.append(t)
        across_them.append(u)
    return np.asarray(directions), np.asarray(across_them)


def curvatures(directions: Array, frames: Array) -> Array:
    """Components (m, 2) of the curvature binormal before each segment in its material frames; zero before the first."""
    found = np.zeros((len(directions), 2))
    for k in range(1, len(directions)):
        t1, t2 = directions[k - 1], directions[k]
        binormal = 2.0 * np.cross(t1, t2) / (1.0 + max(float(t1 @ t2), -0.999))
        found[k, 0] = 0.5 * binormal @ (np.cross(t1, frames[k - 1]) + np.cross(t2, frames[k]))
        found[k, 1] = -0.5 * binormal @ (frames[k - 1] + frames[k])
    return found
