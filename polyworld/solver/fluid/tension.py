"""Surface tension: the pressure jump sigma times curvature across the free surface.

The curvature is that of the smoothed content's level sets (Brackbill, Kothe, Zemach 1992); the jump enters the
pressure equations as the ghost value beyond the surface (Kang, Fedkiw, Liu 2000). Walls are met at a right angle.
"""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Liquids, Pace, Particles, Tension
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO, scatter, stencil

wp.set_module_options(OPTIONS)

PASSES = 3  # of the 1 2 1 filter along each axis
FAINT = wp.float64(1.0e-6)


@wp.func
def _beyond(grid: Grid, lo: wp.vec3i, hi: wp.vec3i, index: wp.vec3i, c: int, a: int, side: int) -> int:
    """Return the neighbour of cell c along an axis, or c itself at the window's end."""
    if grid.wide[a] == 0:
        return c
    at = index[a] + 2 * side - 1
    if at < lo[a] or at >= hi[a]:
        return c
    return c + (2 * side - 1) * grid.stride[a]


@wp.func(inline=False)
def _slope(grid: Grid, row: wp.array[wp.float64], lo: wp.vec3i, hi: wp.vec3i, index: wp.vec3i, c: int) -> wp.vec3d:
    """Central differences at a cell."""
    g = wp.vec3d()
    for a in range(3):
        if grid.wide[a] == 1:
            above = _beyond(grid, lo, hi, index, c, a, 1)
            below = _beyond(grid, lo, hi, index, c, a, 0)
            g[a] = (row[above] - row[below]) / (wp.float64(2.0) * grid.cell)
    return g


@wp.kernel
def fill_solids(grid: Grid, fields: Fields, tension: Tension, pace: Pace) -> None:
    """smooth: how full the cells are. Clears strength."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                tension.strength[w, c] = ZERO
                value = wp.min(fields.filled[w, c], ONE)
                if fields.room[w, c] <= HALF:
                    # Inside solids the liquid beside them goes on, so that its surface meets them at a right angle.
                    index = wp.vec3i(i, j, k)
                    total = wp.float64(0.0)
                    count = wp.float64(0.0)
                    for a in range(3):
                        for side in range(2):
                            n = _beyond(grid, lo, hi, index, c, a, side)
                            if fields.room[w, n] > HALF:
                                total += wp.min(fields.filled[w, n], ONE)
                                count += ONE
                    value = total / wp.max(count, ONE)
                tension.smooth[w, c] = value


@wp.kernel
def spread_strength(grid: Grid, particles: Particles, liquids: Liquids, tension: Tension, pace: Pace) -> None:
    """strength: surface tension times volume around the cells."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    strength = tension.strength[w]
    for p in range(particles.used[w]):
        f = particles.fluid[w, p]
        if f >= 0:
            sigma = liquids.surface_tension[w % liquids.surface_tension.shape[0], f]
            scatter(grid, strength, stencil(grid, particles.x[w, p], 3), particles.volume * sigma)


@wp.kernel
def smooth_along(
    grid: Grid, fields: Fields, a: int, source: wp.array2d[wp.float64], target: wp.array2d[wp.float64], pace: Pace
) -> None:
    """target: the 1 2 1 filter of source along axis a."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    row = source[w]
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                index = wp.vec3i(i, j, k)
                above = row[_beyond(grid, lo, hi, index, c, a, 1)]
                below = row[_beyond(grid, lo, hi, index, c, a, 0)]
                target[w, c] = HALF * row[c] + wp.float64(0.25) * (above + below)


@wp.kernel
def find_normals(grid: Grid, fields: Fields, smooth: wp.array2d[wp.float64], tension: Tension, pace: Pace) -> None:
    """normal: unit gradient of the smoothed content."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                g = _slope(grid, smooth[w], lo, hi, wp.vec3i(i, j, k), c)
                length = wp.length(g)
                for a in range(3):
                    tension.normal[w, a, c] = g[a] / wp.max(length, FAINT)


@wp.kernel
def find_jump(grid: Grid, fields: Fields, tension: Tension, pace: Pace) -> None:
    """jump: pressure above the air's that a surface at each cell has [Pa]."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                index = wp.vec3i(i, j, k)
                curvature = wp.float64(0.0)
                for a in range(3):
                    if grid.wide[a] == 1:
                        above = tension.normal[w, a, _beyond(grid, lo, hi, index, c, a, 1)]
                        below = tension.normal[w, a, _beyond(grid, lo, hi, index, c, a, 0)]
                        curvature -= (above - below) / (wp.float64(2.0) * grid.cell)
                # A drop smaller than a cell is no drop to the grid.
                curvature = wp.clamp(curvature, -ONE / grid.cell, ONE / grid.cell)
                sigma = wp.float64(0.0)
                if fields.content[w, c] > ZERO:
                    sigma = tension.strength[w, c] / fields.content[w, c]
                tension.jump[w, c] = sigma * curvature
