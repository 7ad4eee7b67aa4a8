"""Pressure projection: the pressure that keeps the liquid's volume, with its pushes on liquids and bodies.

Open fractions of faces as in Batty, Bertails and Bridson (2007) and Ng, Min and Gibou (2009); the free surface to
second order by ghost values (Enright, Nguyen, Gibou, Fedkiw 2003).
"""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Pace, System, Tension, Wetted
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO, gather, stencil

wp.set_module_options(OPTIONS)

OPEN = wp.float64(1.0e-3)  # a face less open than this is shut
NEAREST = wp.float64(0.05)  # a free surface nearer to a centre than this many edges is taken to be this far
TOLERANCE = wp.float64(1.0e-6)  # largest divergence left, relative to the largest there was
ITERATIONS = 400


@wp.func
def surface_pressure(tension: Tension, w: int, inner: int, outer: int, gap: wp.float64) -> wp.float64:
    """Return the pressure at the surface, a fraction `gap` of the distance from the inner to the outer cell."""
    t = wp.min(gap, ONE)
    return (ONE - t) * tension.jump[w, inner] + t * tension.jump[w, outer]


@wp.kernel
def number_unknowns(grid: Grid, fields: Fields, system: System, pace: Pace) -> None:
    """Give the liquid's cells rows of the equations: those with an open face that liquid is near."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for a in range(3):
        if grid.wide[a] == 1:
            lo[a] += 1
            hi[a] -= 1
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                if fields.level[w, c] >= ZERO:
                    fields.pressure[w, c] = ZERO
                    continue
                linked = wp.int32(0)
                for a in range(3):
                    for side in range(2):
                        face = c + side * grid.stride[a]
                        if grid.wide[a] == 1 and fields.open[w, a, face] > OPEN and fields.bulk[w, a, face] > ZERO:
                            linked = 1
                if linked == 1:
                    row = wp.atomic_add(system.n, w, 1)
                    if row < system.rows:
                        system.cell[w, row] = c
                        fields.unknown[w, c] = row
                    else:
                        wp.atomic_add(system.n, w, -1)
                        system.overflow[w] = 1


@wp.kernel
def build_pressure(grid: Grid, fields: Fields, system: System, tension: Tension, tense: int, pace: Pace) -> None:
    """Build the equations: row i is the divergence at cell i that pressures remove."""
    w = wp.tid()
    dt = pace.dt[w]
    if dt <= ZERO:
        return
    h = grid.cell
    none = system.rows
    for i in range(system.n[w]):
        c = system.cell[w, i]
        diagonal = wp.float64(0.0)
        divergence = wp.float64(0.0)
        level = fields.level[w, c]
        for a in range(3):
            system.plus[w, a, i] = none
            system.minus[w, a, i] = none
            system.coupling[w, a, i] = ZERO
            if grid.wide[a] == 0:
                continue
            for side in range(2):
                face = c + side * grid.stride[a]
                beyond = c + (2 * side - 1) * grid.stride[a]
                sign = wp.float64(2 * side - 1)
                free = fields.open[w, a, face]
                row = fields.unknown[w, beyond]
                if row >= 0:
                    if side == 0:
                        system.minus[w, a, i] = row
                    else:
                        system.plus[w, a, i] = row
                if free <= OPEN:
                    continue
                divergence += sign * free * fields.velocity[w, a, face] / h
                if row < 0 and fields.level[w, beyond] < ZERO:
                    continue
                bulk = fields.bulk[w, a, face]
                if bulk <= ZERO:
                    continue
                weight = dt * free * bulk / (fields.mass[w, a, face] * h * h)
                if row >= 0:
                    diagonal += weight
                    if side == 1:
                        system.coupling[w, a, i] = -weight
                else:
                    gap = wp.max(level / (level - fields.level[w, beyond]), NEAREST)
                    diagonal += weight / gap
                    if tense == 1:
                        divergence -= weight / gap * surface_pressure(tension, w, c, beyond, gap)
        if diagonal <= ZERO:
            diagonal = ONE
            divergence = ZERO
        system.diagonal[w, i] = diagonal
        system.residual[w, i] = -divergence
        system.x[w, i] = fields.pressure[w, c]
    for a in range(3):
        system.coupling[w, a, none] = ZERO
    system.x[w, none] = ZERO
    system.search[w, none] = ZERO


@wp.struct
class Gap:
    """Rows of the liquid at both ends of a gap, -1 where there is none, and how far along it a cell is, 0 to 1."""

    first: int
    last: int
    share: wp.float64


@wp.func(inline=False)
def _ends_of_gap(grid: Grid, fields: Fields, w: int, cell: int, axis: int, behind: int) -> Gap:
    """Find the liquid at both ends of the gap between a body and a wall, in a cell that the body fills.

    behind: the face of the cell that a wall shuts, if one does. Where a body stands on a floor no cell is left for
    water, but its roughness leaves room for pressure to pass: once liquid is on both sides, the body is not sealed to
    the floor, and Archimedes' force acts. In space, across the narrower way.
    """
    found = Gap()
    found.first = -1
    if fields.static_open[axis, behind] > OPEN or fields.room[w, cell] >= HALF:
        return found
    nearest = wp.int32(0)
    nyz = grid.count[1] * grid.count[2]
    for a in range(3):
        if a == axis or grid.wide[a] == 0:
            continue
        index = (cell // nyz) * wp.where(a == 0, 1, 0)
        if a == 1:
            index = (cell // grid.count[2]) % grid.count[1]
        if a == 2:
            index = cell % grid.count[2]
        first = _end_of_gap(grid, fields, w, cell, index, a, -1)
        last = _end_of_gap(grid, fields, w, cell, index, a, 1)
        if first == 0 or last == 0 or (nearest > 0 and first + last >= nearest):
            continue
        nearest = first + last
        found.first = fields.unknown[w, cell - first * grid.stride[a]]
        found.last = fields.unknown[w, cell + last * grid.stride[a]]
        found.share = wp.float64(first) / wp.float64(nearest)
    return found


@wp.func(inline=False)
def _end_of_gap(grid: Grid, fields: Fields, w: int, cell: int, index: int, axis: int, step: int) -> int:
    """Return how many cells away along an axis a gap ends in liquid, 0 where it does not."""
    far = wp.int32(1)
    while index + far * step > fields.window[w, axis] and index + far * step + 1 < fields.window[w, 3 + axis]:
        c = cell + far * step * grid.stride[axis]
        if fields.unknown[w, c] >= 0:
            return far
        if fields.room[w, c] >= HALF:
            return 0
        far += 1
    return 0


@wp.kernel
def list_touching(grid: Grid, fields: Fields, system: System, wetted: Wetted, pace: Pace) -> None:
    """List the covered faces with an unknown on either side, or at both ends of a gap, and the rows beside them."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    none = system.rows
    for e in range(wp.min(wetted.found[w], wetted.capacity)):
        c = wetted.face[w, e]
        a = wetted.axis[w, e]
        high = fields.unknown[w, c]
        low = fields.unknown[w, c - grid.stride[a]]
        wetted.beside[w, e] = none
        wetted.through[w, e] = ZERO
        if high < 0 and low < 0:
            below = _ends_of_gap(grid, fields, w, c - grid.stride[a], a, c - grid.stride[a])
            above = _ends_of_gap(grid, fields, w, c, a, c + grid.stride[a])
            gap = below
            sign = wp.float64(1.0)
            if below.first < 0:
                gap = above
                sign = wp.float64(-1.0)
            if gap.first < 0:
                continue
            cover = wetted.cover[w, e]
            wetted.cover[w, e] = cover * (ONE - gap.share)
            wetted.beside[w, e] = gap.last
            wetted.through[w, e] = sign * cover * gap.share
            if below.first >= 0:
                low = gap.first
            else:
                high = gap.first
        if high < 0:
            high = none
        if low < 0:
            low = none
        wetted.lower[w, e] = low
        wetted.upper[w, e] = high
        wetted.touching[w, wp.atomic_add(wetted.count, w, 1)] = e


@wp.kernel
def take_pressure(fields: Fields, system: System, pace: Pace) -> None:
    """Pressure of the cells from their rows."""
    w = wp.tid()
    if pace.dt[w] > ZERO:
        for i in range(system.n[w]):
            fields.pressure[w, system.cell[w, i]] = system.x[w, i]


@wp.func(inline=False)
def _difference(fields: Fields, tension: Tension, tense: int, w: int, low: int, high: int) -> wp.float64:
    """Pressure of the upper cell less that of the lower one, a ghost value beyond the free surface."""
    above = fields.unknown[w, high]
    below = fields.unknown[w, low]
    if above >= 0 and below >= 0:
        return fields.pressure[w, high] - fields.pressure[w, low]
    inner = high
    outer = low
    sign = wp.float64(-1.0)
    if above < 0:
        inner = low
        outer = high
        sign = wp.float64(1.0)
    if fields.level[w, outer] < ZERO:
        return ZERO
    gap = wp.max(fields.level[w, inner] / (fields.level[w, inner] - fields.level[w, outer]), NEAREST)
    held = wp.float64(0.0)
    if tense == 1:
        held = surface_pressure(tension, w, inner, outer, gap)
    return sign * (held - fields.pressure[w, inner]) / gap


@wp.kernel
def push_liquid(grid: Grid, fields: Fields, tension: Tension, tense: int, pace: Pace) -> None:
    """Velocity change by the pressure gradient on all faces beside an unknown; marks the faces that are known."""
    w = wp.tid()
    dt = pace.dt[w]
    if dt <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                index = wp.vec3i(i, j, k)
                for a in range(3):
                    known = wp.int32(0)
                    push = wp.float64(0.0)
                    if fields.mass[w, a, c] > ZERO and fields.open[w, a, c] > OPEN:
                        known = 1
                        if index[a] > lo[a] and grid.wide[a] == 1:
                            d = c - grid.stride[a]
                            if fields.unknown[w, c] >= 0 or fields.unknown[w, d] >= 0:
                                push = -dt * _difference(fields, tension, tense, w, d, c) / grid.cell
                                fields.velocity[w, a, c] += push * fields.bulk[w, a, c] / fields.mass[w, a, c]
                    fields.push[w, a, c] = push
                    fields.known[w, a, c] = known
                    fields.shift[w, a, c] = fields.velocity[w, a, c]  # kept until solids have changed it


@wp.kernel
def read_cells(
    grid: Grid, rows: wp.array2d[wp.float64], points: wp.array[wp.vec3d], out: wp.array2d[wp.float64]
) -> None:
    """out: a quantity of the cells' centres at points, linear between them."""
    w, i = wp.tid()
    out[w, i] = gather(grid, rows[w], stencil(grid, points[i], 3))
