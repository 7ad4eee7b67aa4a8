"""Boxes divided into a regular grid of tetrahedra."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

# Corners of a cell are numbered x + 2 y + 4 z. Five tetrahedra fill it, four corners cut off and one in the middle;
# neighbouring cells are mirror images, so that diagonals on shared faces agree and no direction is preferred.
_EVEN = np.array([[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 2, 4, 7]])
_ODD = np.array([[1, 0, 5, 3], [2, 3, 6, 0], [4, 5, 0, 6], [7, 6, 3, 5], [0, 3, 6, 5]])


def box_tetrahedra(half_extents: tuple[float, float, float], edge: float) -> tuple[Array, Ints]:
    """Points (p, 3) and positively oriented tetrahedra (q, 4) of a box centred on the origin.

    Cells are as near to cubes of the given edge [m] as whole numbers of them allow.
    """
    half = np.asarray(half_extents, dtype=float)
    cells = np.maximum(1, np.rint(2.0 * half / edge).astype(int))
    axes = [np.linspace(-a, a, n + 1) for a, n in zip(half, cells, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    number = np.arange(points[..., 0].size).reshape(points.shape[:3])
    i, j, k = (g.ravel() for g in np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"))
    corners = np.stack([number[i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)] for c in range(8)], axis=1)
    odd = (i + j + k) % 2 == 1
    tetrahedra = np.where(odd[:, None, None], corners[:, _ODD], corners[:, _EVEN]).reshape(-1, 4)
    return points.reshape(-1, 3), tetrahedra.astype(np.int32)
