"""Indices of the grid's samples around a point, and linear interpolation there."""

import warp as wp

from polyworld.solver.fluid.layout import Grid

ZERO = wp.float64(0.0)
ONE = wp.float64(1.0)
HALF = wp.float64(0.5)


@wp.struct
class Stencil:
    """Return the lowest of the eight samples around a point, and the point's position among them, 0 to 1 an axis."""

    base: int
    f: wp.vec3d


@wp.func
def face_offset(axis: int) -> wp.vec3d:
    """Place of a face's centre in its cell, in edges: axis 0, 1, 2; 3 for the centre of the cell."""
    o = wp.vec3d(HALF, HALF, HALF)
    if axis < 3:
        o[axis] = ZERO
    return o


@wp.func
def stencil(grid: Grid, x: wp.vec3d, axis: int) -> Stencil:
    """Return the eight samples around x of a quantity on the faces of an axis, or (3) at cell centres."""
    g = (x - grid.origin) / grid.cell - face_offset(axis)
    s = Stencil()
    base = wp.int32(0)
    for a in range(3):
        if grid.wide[a] == 1:
            low = wp.floor(g[a])
            i = wp.clamp(wp.int32(low), 0, grid.count[a] - 2)
            s.f[a] = wp.clamp(g[a] - wp.float64(i), ZERO, ONE)
            base += i * grid.stride[a]
    s.base = base
    return s


@wp.func
def gather(grid: Grid, row: wp.array[wp.float64], s: Stencil) -> wp.float64:
    """Linear interpolation of samples."""
    b = s.base
    i = grid.stride[0]
    j = grid.stride[1]
    k = grid.stride[2]
    fx = s.f[0]
    fy = s.f[1]
    fz = s.f[2]
    low = (ONE - fy) * ((ONE - fz) * row[b] + fz * row[b + k]) + fy * ((ONE - fz) * row[b + j] + fz * row[b + j + k])
    b += i
    high = (ONE - fy) * ((ONE - fz) * row[b] + fz * row[b + k]) + fy * ((ONE - fz) * row[b + j] + fz * row[b + j + k])
    return (ONE - fx) * low + fx * high


@wp.func
def gather_slope(grid: Grid, row: wp.array[wp.float64], s: Stencil) -> wp.vec3d:
    """Gradient of the linear interpolation."""
    b = s.base
    i = grid.stride[0]
    j = grid.stride[1]
    k = grid.stride[2]
    fx = s.f[0]
    fy = s.f[1]
    fz = s.f[2]
    a000 = row[b]
    a001 = row[b + k]
    a010 = row[b + j]
    a011 = row[b + j + k]
    b += i
    a100 = row[b]
    a101 = row[b + k]
    a110 = row[b + j]
    a111 = row[b + j + k]
    gx = (ONE - fy) * ((ONE - fz) * (a100 - a000) + fz * (a101 - a001)) + fy * (
        (ONE - fz) * (a110 - a010) + fz * (a111 - a011)
    )
    gy = (ONE - fx) * ((ONE - fz) * (a010 - a000) + fz * (a011 - a001)) + fx * (
        (ONE - fz) * (a110 - a100) + fz * (a111 - a101)
    )
    gz = (ONE - fx) * ((ONE - fy) * (a001 - a000) + fy * (a011 - a010)) + fx * (
        (ONE - fy) * (a101 - a100) + fy * (a111 - a110)
    )
    return wp.vec3d(gx, gy, gz) / grid.cell


@wp.func
def scatter(grid: Grid, row: wp.array[wp.float64], s: Stencil, value: wp.float64) -> None:
    """Share a value out among the eight samples."""
    i = grid.stride[0]
    j = grid.stride[1]
    k = grid.stride[2]
    fy = s.f[1]
    fz = s.f[2]
    b = s.base
    low = (ONE - s.f[0]) * value
    wp.atomic_add(row, b, (ONE - fy) * (ONE - fz) * low)
    wp.atomic_add(row, b + k, (ONE - fy) * fz * low)
    wp.atomic_add(row, b + j, fy * (ONE - fz) * low)
    wp.atomic_add(row, b + j + k, fy * fz * low)
    high = s.f[0] * value
    b += i
    wp.atomic_add(row, b, (ONE - fy) * (ONE - fz) * high)
    wp.atomic_add(row, b + k, (ONE - fy) * fz * high)
    wp.atomic_add(row, b + j, fy * (ONE - fz) * high)
    wp.atomic_add(row, b + j + k, fy * fz * high)


@wp.func
def scatter_linear(
    grid: Grid, row: wp.array[wp.float64], s: Stencil, weight: wp.float64, value: wp.float64, slope: wp.vec3d
) -> None:
    """Share weight times (value + slope · (sample - point)) out among the eight samples."""
    i = grid.stride[0]
    j = grid.stride[1]
    k = grid.stride[2]
    fy = s.f[1]
    fz = s.f[2]
    dx = slope[0] * grid.cell
    dy = slope[1] * grid.cell
    dz = slope[2] * grid.cell
    b = s.base
    v = value - s.f[0] * dx - fy * dy - fz * dz  # at the lowest sample
    w = (ONE - s.f[0]) * weight
    wp.atomic_add(row, b, (ONE - fy) * (ONE - fz) * w * v)
    wp.atomic_add(row, b + k, (ONE - fy) * fz * w * (v + dz))
    wp.atomic_add(row, b + j, fy * (ONE - fz) * w * (v + dy))
    wp.atomic_add(row, b + j + k, fy * fz * w * (v + dy + dz))
    b += i
    v += dx
    w = s.f[0] * weight
    wp.atomic_add(row, b, (ONE - fy) * (ONE - fz) * w * v)
    wp.atomic_add(row, b + k, (ONE - fy) * fz * w * (v + dz))
    wp.atomic_add(row, b + j, fy * (ONE - fz) * w * (v + dy))
    wp.atomic_add(row, b + j + k, fy * fz * w * (v + dy + dz))


@wp.func
def centre(grid: Grid, i: int, j: int, k: int, axis: int) -> wp.vec3d:
    """Return where the sample of cell (i, j, k) lies: a face's centre, or (3) the cell's."""
    index = wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k))
    return grid.origin + (index + face_offset(axis)) * grid.cell
