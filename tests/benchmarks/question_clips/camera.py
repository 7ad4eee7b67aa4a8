"""CLEVRER's camera: where points of the scene fall in a picture of 480 by 320 pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SIZE = (480, 320)
POSITION = np.array([4.318, 0.0, 2.5])  # m
FORWARD = np.array([-0.8651, 0.0, -0.5016]) / np.hypot(0.8651, 0.5016)
RIGHT = np.array([0.0, 1.0, 0.0])
UP = np.cross(RIGHT, FORWARD)
FOCAL = 485.0  # pixels
FOVY = float(2 * np.degrees(np.arctan(SIZE[1] / 2 / FOCAL)))


def project(points: Floats) -> tuple[Floats, Floats]:
    """Return pixels (..., 2) and depths (...) [m] of points (..., 3)."""
    offset = points - POSITION
    depth = offset @ FORWARD
    right, down = offset @ RIGHT / depth, -(offset @ UP) / depth
    return np.stack([SIZE[0] / 2 + FOCAL * right, SIZE[1] / 2 + FOCAL * down], axis=-1), depth


def in_view(points: Floats) -> NDArray[np.bool_]:
    """Return whether points (..., 3) lie in the picture."""
    pixels, depth = project(points)
    return (depth > 0) & (pixels >= 0).all(axis=-1) & (pixels < np.array(SIZE)).all(axis=-1)


def homography(height: float) -> Floats:
    """Return the map (3, 3) of (x, y, 1) in the plane z = height to pixels, its last entry 1."""
    rows = np.array([FOCAL * RIGHT + SIZE[0] / 2 * FORWARD, -FOCAL * UP + SIZE[1] / 2 * FORWARD, FORWARD])
    matrix = np.column_stack([rows[:, 0], rows[:, 1], rows @ (np.array([0.0, 0.0, height]) - POSITION)])
    return np.asarray(matrix / matrix[2, 2])
