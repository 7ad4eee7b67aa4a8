"""The free surface: a level set from how full the cells are."""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Pace
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO

wp.set_module_options(OPTIONS)

ROOMY = wp.float64(0.75)  # cells with less room than this share their neighbours' content,
TIGHT = wp.float64(0.5)  # and those with less than this, too little to be reliable, continue their neighbours' level


@wp.func
def distance_of(content: wp.float64, h: wp.float64) -> wp.float64:
    """Distance to a plane free surface from a cell's centre, negative in the liquid.

    The content of a cell's surroundings, weighted by a tent of half width h, is 1/2 (1 - d/h)^2 at a distance d
    above a plane surface and 1 - 1/2 (1 + d/h)^2 below; this is the inverse.
    """
    two = wp.float64(2.0)
    if content < HALF:
        return h * (ONE - wp.sqrt(two * content))
    return h * (wp.sqrt(two * wp.max(ONE - content, ZERO)) - ONE)


@wp.kernel
def find_surface(grid: Grid, fields: Fields, pace: Pace) -> None:
    """filled and level of the window's cells."""
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
                volume = fields.content[w, c]
                room = fields.room[w, c] * grid.volume
                if fields.room[w, c] < ROOMY:
                    for a in range(3):
                        if grid.wide[a] == 1 and index[a] > lo[a] and index[a] + 1 < hi[a]:
                            m = c - grid.stride[a]
                            n = c + grid.stride[a]
                            volume += fields.content[w, m] + fields.content[w, n]
                            room += (fields.room[w, m] + fields.room[w, n]) * grid.volume
                filled = wp.float64(0.0)
                if room > wp.float64(0.05) * grid.volume:
                    filled = volume / room
                fields.filled[w, c] = filled
                fields.level[w, c] = distance_of(filled, grid.cell)


@wp.kernel
def continue_level(grid: Grid, fields: Fields, pace: Pace) -> None:
    """Level of tight cells: the mean of their neighbours that are not."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                if fields.room[w, c] >= TIGHT:
                    continue
                index = wp.vec3i(i, j, k)
                total = wp.float64(0.0)
                weight = wp.float64(0.0)
                for a in range(3):
                    for side in range(2):
                        if grid.wide[a] == 0 or index[a] + 2 * side - 1 < lo[a] or index[a] + 2 * side - 1 >= hi[a]:
                            continue
                        n = c + (2 * side - 1) * grid.stride[a]
                        room = fields.room[w, n] * fields.open[w, a, c + side * grid.stride[a]]
                        if fields.room[w, n] >= TIGHT:
                            total += room * fields.level[w, n]
                            weight += room
                if weight > ZERO:
                    fields.level[w, c] = total / weight
