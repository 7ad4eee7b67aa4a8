"""A uniform grid of points in each world, by hashed cells: what lies near a box (Teschner et al. 2003)."""

from __future__ import annotations

import numpy as np
import warp as wp

from polyworld.core import buffers


@wp.struct
class Grid:
    """Points of W worlds sorted into cells; bucket k of world w holds items[w, start[w, k] : start[w, k + 1]].

    point (W, n): positions at the last sorting. cell: size of the cubic cells [m]. buckets: a power of two.
    """

    point: wp.array2d[wp.vec3d]
    start: wp.array2d[wp.int32]
    items: wp.array2d[wp.int32]
    cell: wp.float64
    buckets: int


@wp.func
def cell_of(p: wp.float64, size: wp.float64) -> int:
    """Number of the cell along one axis; points that diverged all share one."""
    q = wp.floor(p / size)
    if wp.abs(q) < wp.float64(1.0e9):
        return wp.int32(q)
    return 0


@wp.func
def bucket_of(i: int, j: int, k: int, buckets: int) -> int:
    return ((i * 73856093) ^ (j * 19349663) ^ (k * 83492791)) & (buckets - 1)


@wp.func
def sort_points(grid: Grid, w: int) -> None:
    """Counting sort of world w's points into their buckets."""
    n = grid.point.shape[1]
    for b in range(grid.buckets + 1):
        grid.start[w, b] = 0
    for i in range(n):
        p = grid.point[w, i]
        b = bucket_of(cell_of(p[0], grid.cell), cell_of(p[1], grid.cell), cell_of(p[2], grid.cell), grid.buckets)
        grid.start[w, b] += 1
    total = wp.int32(0)
    for b in range(grid.buckets + 1):
        total += grid.start[w, b]
        grid.start[w, b] = total
    for r in range(n):
        i = n - 1 - r
        p = grid.point[w, i]
        b = bucket_of(cell_of(p[0], grid.cell), cell_of(p[1], grid.cell), cell_of(p[2], grid.cell), grid.buckets)
        grid.start[w, b] -= 1
        grid.items[w, grid.start[w, b]] = i


@wp.func
def in_cell(grid: Grid, w: int, item: int, i: int, j: int, k: int) -> bool:
    """Check whether a point of a bucket is in this cell, rather than in another one with the same hash."""
    p = grid.point[w, item]
    return cell_of(p[0], grid.cell) == i and cell_of(p[1], grid.cell) == j and cell_of(p[2], grid.cell) == k


def make_grid(n_worlds: int, points: int, cell: float) -> Grid:
    """Return a grid with room for `points` points a world."""
    grid = Grid()
    grid.buckets = int(2 ** np.ceil(np.log2(max(2 * points, 2))))
    grid.cell = cell
    grid.point = buffers.zeros((n_worlds, points), wp.vec3d)
    grid.start = buffers.zeros((n_worlds, grid.buckets + 1), wp.int32)
    grid.items = buffers.zeros((n_worlds, points), wp.int32)
    return grid
