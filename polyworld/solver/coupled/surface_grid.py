"""A uniform grid of points in each world, by hashed cells: what lies near a box (Teschner et al. 2003)."""

from __future__ import annotations

import numpy as np
import warp as wp

from polyworld.core import buffers

# Cells of a box over buckets beyond which all points are looked at instead: a box grows with the speed of what is in
# it, and what flies apart would have billions of cells looked at, all but a few of them empty.
CELLS_PER_BUCKET = wp.constant(wp.float64(8.0))


@wp.struct
class Grid:
    """Points of W worlds sorted into cells; bucket k of world w holds items[w, start[w, k] : start[w, k + 1]].

    point (W, n): positions at the last sorting. first, last (W,): least and greatest cell that holds one. cell: size of
    the cubic cells [m]. buckets: a power of two.
    """

    point: wp.array2d[wp.vec3d]
    start: wp.array2d[wp.int32]
    items: wp.array2d[wp.int32]
    first: wp.array[wp.vec3i]
    last: wp.array[wp.vec3i]
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


@wp.struct
class Span:
    """The visits that find all points of a box: of its cells, or, where there are too many of them, of all buckets."""

    low: wp.vec3i
    count: wp.vec3i
    visits: int
    whole: int


@wp.func
def span_of(grid: Grid, w: int, low: wp.vec3d, high: wp.vec3d) -> Span:
    """Visits for the box from low to high, without the cells beyond the outermost points."""
    span = Span()
    cells = wp.float64(1.0)
    for a in range(3):
        begin = wp.max(cell_of(low[a], grid.cell), grid.first[w][a])
        end = wp.min(cell_of(high[a], grid.cell), grid.last[w][a])
        span.low[a] = begin
        span.count[a] = wp.max(end - begin + 1, 0)
        cells *= wp.float64(span.count[a])
    if cells > CELLS_PER_BUCKET * wp.float64(grid.buckets):
        span.whole = 1
        span.visits = grid.buckets
    else:
        span.visits = span.count[0] * span.count[1] * span.count[2]
    return span


@wp.func
def cell_at(span: Span, visit: int) -> wp.vec3i:
    rows = visit // span.count[2]
    i = rows // span.count[1]
    return wp.vec3i(span.low[0] + i, span.low[1] + rows - i * span.count[1], span.low[2] + visit - rows * span.count[2])


@wp.func
def bucket_at(grid: Grid, span: Span, visit: int) -> int:
    if span.whole == 1:
        return visit
    cell = cell_at(span, visit)
    return bucket_of(cell[0], cell[1], cell[2], grid.buckets)


@wp.func
def sort_points(grid: Grid, w: int) -> None:
    """Counting sort of world w's points into their buckets."""
    n = grid.point.shape[1]
    for b in range(grid.buckets + 1):
        grid.start[w, b] = 0
    for i in range(n):
        p = grid.point[w, i]
        cell = wp.vec3i(cell_of(p[0], grid.cell), cell_of(p[1], grid.cell), cell_of(p[2], grid.cell))
        if i == 0:
            grid.first[w] = cell
            grid.last[w] = cell
        grid.first[w] = wp.min(grid.first[w], cell)
        grid.last[w] = wp.max(grid.last[w], cell)
        b = bucket_of(cell[0], cell[1], cell[2], grid.buckets)
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
def visited(grid: Grid, w: int, item: int, span: Span, visit: int) -> bool:
    """Check whether a visit is of this point of the bucket, rather than of another cell with the same hash."""
    if span.whole == 1:
        return True
    p = grid.point[w, item]
    cell = cell_at(span, visit)
    here = cell_of(p[0], grid.cell) == cell[0] and cell_of(p[1], grid.cell) == cell[1]
    return here and cell_of(p[2], grid.cell) == cell[2]


def make_grid(n_worlds: int, points: int, cell: float) -> Grid:
    """Return a grid with room for `points` points a world."""
    grid = Grid()
    grid.buckets = int(2 ** np.ceil(np.log2(max(2 * points, 2))))
    grid.cell = cell
    grid.point = buffers.zeros((n_worlds, points), wp.vec3d)
    grid.start = buffers.zeros((n_worlds, grid.buckets + 1), wp.int32)
    grid.items = buffers.zeros((n_worlds, points), wp.int32)
    grid.first, grid.last = buffers.zeros((n_worlds,), wp.vec3i), buffers.zeros((n_worlds,), wp.vec3i)
    return grid
