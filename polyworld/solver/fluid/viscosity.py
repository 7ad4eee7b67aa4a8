"""Viscosity, implicit: the velocity that minimises inertia plus dissipation over the sub-step.

Batty and Bridson, Accurate viscous free surfaces for buckling, coiling, and rotating liquids (2008): normal strain
rates at cell centres, shear rates at edges, each with the product of viscosity and liquid volume there, so that a
free surface carries no traction. Where the liquid sticks, a wall is the point of zero slip between two samples.
"""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Liquids, Pace, Particles, Resistance, Solids, Viscous
from polyworld.solver.fluid.motion import SHUT, solid_at
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO, centre, scatter, stencil
from polyworld.solver.spatial.layout import Body

wp.set_module_options(OPTIONS)

NEGLIGIBLE = wp.float64(1.0e-5)  # dt viscosity / (density cell^2) below which a sub-step is inviscid
TOLERANCE = wp.float64(1.0e-6)  # of the residual, relative to the first
LEAST = wp.float64(1.0e-12)  # no velocity matters below this [m/s]
ITERATIONS = 500
RESOLVED = wp.float64(10.0)  # sub-steps in which a boundary layer must have grown over a cell to be resolved
WALL = wp.float64(0.72)  # a face less open than this has its centre in a solid, or a quarter edge outside at most
FARTHEST = wp.float64(1.3)
NEAREST = wp.float64(0.25)  # distance of a sample from a wall, in edges, is at least this

LEAST_ROOM = wp.float64(0.1)  # a cell with less room is left out

EMPTY = 0
LIQUID = 1
SOLID = 2


@wp.kernel
def begin_viscosity(grid: Grid, liquids: Liquids, viscous: Viscous, pace: Pace) -> None:
    """active: whether viscosity matters in the sub-step."""
    w = wp.tid()
    dt = pace.dt[w]
    viscous.active[w] = 0
    viscous.n[w] = 0
    viscous.walls[w] = 0
    if dt <= ZERO:
        return
    thickest = wp.float64(0.0)
    for f in range(liquids.density.shape[1]):
        nu = liquids.viscosity[w % liquids.viscosity.shape[0], f] / liquids.density[w % liquids.density.shape[0], f]
        thickest = wp.max(thickest, nu)
    if dt * thickest / (grid.cell * grid.cell) < NEGLIGIBLE:
        return
    viscous.active[w] = 1
    viscous.reach[w] = RESOLVED * dt * thickest / (grid.cell * grid.cell)


@wp.kernel
def clear_viscosity(grid: Grid, fields: Fields, viscous: Viscous, pace: Pace) -> None:
    w = wp.tid()
    if pace.dt[w] <= ZERO or viscous.active[w] == 0:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                viscous.resistance.amount[w, c] = ZERO
                viscous.resistance.sticky[w, c] = ZERO


@wp.kernel
def spread_viscosity(grid: Grid, particles: Particles, liquids: Liquids, viscous: Viscous, pace: Pace) -> None:
    """Viscosity times volume around the cells."""
    w = wp.tid()
    if pace.dt[w] <= ZERO or viscous.active[w] == 0:
        return
    for p in range(particles.used[w]):
        f = particles.fluid[w, p]
        if f < 0:
            continue
        s = stencil(grid, particles.x[w, p], 3)
        value = particles.volume * liquids.viscosity[w % liquids.viscosity.shape[0], f]
        scatter(grid, viscous.resistance.amount[w], s, value)
        if liquids.slip[f] == 0:
            scatter(grid, viscous.resistance.sticky[w], s, value)


@wp.kernel
def classify_faces(
    grid: Grid, solids: Solids, fields: Fields, viscous: Viscous, bodies: wp.array2d[Body], pace: Pace
) -> None:
    """Viscosity times volume for the room that cells have, and what every face is. The liquid's faces get rows."""
    w = wp.tid()
    if pace.dt[w] <= ZERO or viscous.active[w] == 0:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                room = fields.room[w, c]
                if room < LEAST_ROOM:
                    viscous.resistance.amount[w, c] = ZERO
                else:
                    viscous.resistance.amount[w, c] = viscous.resistance.amount[w, c] / room
                    viscous.resistance.sticky[w, c] = viscous.resistance.sticky[w, c] / room
                for a in range(3):
                    kind = EMPTY
                    if grid.wide[a] == 1:
                        if fields.open[w, a, c] < WALL:
                            kind = SOLID
                            stuck = viscous.resistance.sticky[w, c]
                            if wp.vec3i(i, j, k)[a] > lo[a]:
                                stuck += viscous.resistance.sticky[w, c - grid.stride[a]]
                            if stuck > ZERO or (fields.open[w, a, c] <= SHUT and fields.mass[w, a, c] > ZERO):
                                fields.velocity[w, a, c] = _wall_speed(grid, solids, fields, bodies, w, i, j, k, a, c)
                        elif fields.mass[w, a, c] > ZERO:
                            kind = LIQUID
                            beside = HALF * (room + fields.room[w, c - grid.stride[a]])
                            n = wp.atomic_add(viscous.n, w, 1)
                            viscous.mass[w, n] = fields.mass[w, a, c] / wp.max(beside, HALF)
                            viscous.row[w, a, c] = n
                    viscous.resistance.kind[w, a, c] = kind


@wp.kernel
def number_walls(grid: Grid, fields: Fields, viscous: Viscous, pace: Pace) -> None:
    """Give faces in solids their rows, and all rows the present velocity."""
    w = wp.tid()
    if pace.dt[w] <= ZERO or viscous.active[w] == 0:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    n = viscous.n[w]
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                for a in range(3):
                    if viscous.resistance.kind[w, a, c] == SOLID:
                        row = n + wp.atomic_add(viscous.walls, w, 1)
                        viscous.row[w, a, c] = row
                        viscous.search[w, row] = ZERO
                    if viscous.resistance.kind[w, a, c] != EMPTY:
                        viscous.x[w, viscous.row[w, a, c]] = fields.velocity[w, a, c]


@wp.func(inline=False)
def _wall_speed(
    grid: Grid, solids: Solids, fields: Fields, bodies: wp.array2d[Body], w: int, i: int, j: int, k: int, a: int, c: int
) -> wp.float64:
    if solids.moving == 0 or fields.static_open[a, c] < WALL:
        return ZERO
    return solid_at(solids, bodies, w, centre(grid, i, j, k, a), 0).v[a]


@wp.func
def _reach(grid: Grid, fields: Fields, a: int, c: int) -> wp.float64:
    """Distance from a face to the wall beside it, in edges."""
    d = HALF * (fields.static_distance[c] + fields.static_distance[c - grid.stride[a]]) / grid.cell
    if d > FARTHEST or d < ZERO:
        return HALF  # a wall of the box, or a body: half way between two samples
    return wp.max(d, NEAREST)


@wp.struct
class Shear:
    """Coefficients of an edge's shear rate on its four faces, and viscosity times volume there."""

    a_above: wp.float64
    a_below: wp.float64
    b_above: wp.float64
    b_below: wp.float64
    weight: wp.float64


@wp.func
def _mean_sticky(fields: Fields, resistance: Resistance, w: int, c: int, ca: int, cb: int, cab: int) -> wp.float64:
    """Mean over those of four cells that have room."""
    total = wp.float64(0.0)
    count = wp.float64(0.0)
    for n in range(4):
        m = c
        if n == 1:
            m = ca
        if n == 2:
            m = cb
        if n == 3:
            m = cab
        if fields.room[w, m] >= LEAST_ROOM:
            total += resistance.sticky[w, m]
            count += ONE
    return total / wp.max(count, ONE)


@wp.func(inline=False)
def _shear(grid: Grid, fields: Fields, resistance: Resistance, w: int, c: int, a: int, b: int) -> Shear:
    """Return the edge at the lower corner of cell c, along the axis that is neither a nor b."""
    s = Shear()
    ca = c - grid.stride[a]
    cb = c - grid.stride[b]
    k0 = resistance.kind[w, a, c]
    k1 = resistance.kind[w, a, cb]
    k2 = resistance.kind[w, b, c]
    k3 = resistance.kind[w, b, ca]
    if k0 == EMPTY or k1 == EMPTY or k2 == EMPTY or k3 == EMPTY:
        return s
    if k0 != LIQUID and k1 != LIQUID and k2 != LIQUID and k3 != LIQUID:
        return s
    cab = ca - grid.stride[b]
    quarter = wp.float64(0.25)
    if k0 == LIQUID and k1 == LIQUID and k2 == LIQUID and k3 == LIQUID:
        s.weight = quarter * (
            resistance.amount[w, c] + resistance.amount[w, ca] + resistance.amount[w, cb] + resistance.amount[w, cab]
        )
    else:
        s.weight = _mean_sticky(fields, resistance, w, c, ca, cb, cab)
    if s.weight <= ZERO:
        return s
    da = wp.float64(1.0)  # distances between the two samples, or between one and the wall, in edges
    db = wp.float64(1.0)
    if k0 == LIQUID and k1 == SOLID:
        da = _reach(grid, fields, a, c)
    if k0 == SOLID and k1 == LIQUID:
        da = _reach(grid, fields, a, cb)
    if k2 == LIQUID and k3 == SOLID:
        db = _reach(grid, fields, b, c)
    if k2 == SOLID and k3 == LIQUID:
        db = _reach(grid, fields, b, ca)
    s.weight *= da * db  # the part of the edge's volume that is liquid
    ga = ONE / (grid.cell * da)
    gb = ONE / (grid.cell * db)
    s.a_above = ga
    s.a_below = -ga
    s.b_above = gb
    s.b_below = -gb
    return s


@wp.struct
class Dissipation:
    """Inertia and dissipation within dt [s] of the liquid's faces."""

    grid: Grid
    fields: Fields
    viscous: Viscous
    dt: wp.float64


@wp.func(inline=False)
def inertia(
    equations: Dissipation, w: int, n: int, x: wp.array[wp.float64], y: wp.array[wp.float64], only: int
) -> None:
    """y = inertia x; `only` 1: its diagonal alone, x then ignored."""
    viscous = equations.viscous
    mass = viscous.mass[w]
    for i in range(n):
        y[i] = mass[i]
        if only == 0:
            y[i] = mass[i] * x[i]
    for i in range(n, n + viscous.walls[w]):
        y[i] = ZERO


@wp.func(inline=False)
def dissipate(equations: Dissipation, w: int, x: wp.array[wp.float64], y: wp.array[wp.float64], only: int) -> None:
    """Add dt dissipation x to y; `only` 1: its diagonal alone, x then ignored."""
    grid = equations.grid
    fields = equations.fields
    viscous = equations.viscous
    dt = equations.dt
    kind = viscous.resistance.kind[w]
    row = equations.viscous.row[w]
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for a in range(3):
        if grid.wide[a] == 1:
            lo[a] += 1
            hi[a] -= 1
    two = wp.float64(2.0)
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                amount = viscous.resistance.amount[w, c]
                for a in range(3):
                    if grid.wide[a] == 0:
                        continue
                    beyond = c + grid.stride[a]
                    if amount > ZERO and kind[a, c] != EMPTY and kind[a, beyond] != EMPTY:
                        pull = two * dt * amount / (grid.cell * grid.cell)
                        low = row[a, c]
                        high = row[a, beyond]
                        if only == 1:
                            wp.atomic_add(y, high, pull)
                            wp.atomic_add(y, low, pull)
                        else:
                            pull *= x[high] - x[low]
                            wp.atomic_add(y, high, pull)
                            wp.atomic_add(y, low, -pull)
                    for b in range(a + 1, 3):
                        if grid.wide[b] == 0 or kind[a, c] == EMPTY or kind[b, c] == EMPTY:
                            continue
                        s = _shear(grid, fields, viscous.resistance, w, c, a, b)
                        if s.weight <= ZERO:
                            continue
                        a_above = row[a, c]
                        a_below = row[a, c - grid.stride[b]]
                        b_above = row[b, c]
                        b_below = row[b, c - grid.stride[a]]
                        pull = dt * s.weight
                        if only == 1:
                            wp.atomic_add(y, a_above, pull * s.a_above * s.a_above)
                            wp.atomic_add(y, a_below, pull * s.a_below * s.a_below)
                            wp.atomic_add(y, b_above, pull * s.b_above * s.b_above)
                            wp.atomic_add(y, b_below, pull * s.b_below * s.b_below)
                        else:
                            pull *= (
                                s.a_above * x[a_above]
                                + s.a_below * x[a_below]
                                + s.b_above * x[b_above]
                                + s.b_below * x[b_below]
                            )
                            wp.atomic_add(y, a_above, pull * s.a_above)
                            wp.atomic_add(y, a_below, pull * s.a_below)
                            wp.atomic_add(y, b_above, pull * s.b_above)
                            wp.atomic_add(y, b_below, pull * s.b_below)


@wp.kernel
def take_velocity(grid: Grid, fields: Fields, viscous: Viscous, pace: Pace) -> None:
    """Velocity of the liquid's faces from their rows."""
    w = wp.tid()
    if pace.dt[w] <= ZERO or viscous.active[w] == 0:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                for a in range(3):
                    if viscous.resistance.kind[w, a, c] == LIQUID:
                        fields.velocity[w, a, c] = viscous.x[w, viscous.row[w, a, c]]


@wp.kernel
def mirror_at_walls(
    grid: Grid, solids: Solids, fields: Fields, viscous: Viscous, bodies: wp.array2d[Body], pace: Pace
) -> None:
    """Velocity of faces inside solids beside liquid that sticks: interpolation then vanishes at the wall.

    Only as far as viscosity reaches across a cell: a thinner boundary layer leaves the liquid beside it sliding.
    """
    w = wp.tid()
    if pace.dt[w] <= ZERO or viscous.active[w] == 0:
        return
    felt = wp.min(viscous.reach[w], ONE)
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                index = wp.vec3i(i, j, k)
                for a in range(3):
                    if viscous.resistance.kind[w, a, c] != SOLID:
                        continue
                    total = wp.float64(0.0)
                    ratio = wp.float64(0.0)
                    count = wp.float64(0.0)
                    for b in range(3):
                        if b == a or grid.wide[b] == 0:
                            continue
                        for side in range(2):
                            m = c + (2 * side - 1) * grid.stride[b]
                            if index[b] + 2 * side - 1 < lo[b] or index[b] + 2 * side - 1 >= hi[b]:
                                continue
                            if viscous.resistance.kind[w, a, m] == LIQUID and viscous.resistance.sticky[w, m] > ZERO:
                                d = _reach(grid, fields, a, m)
                                total += fields.velocity[w, a, m]
                                ratio += wp.clamp((ONE - d) / d, ZERO, ONE)
                                count += ONE
                    if count > ZERO:
                        u = _wall_speed(grid, solids, fields, bodies, w, i, j, k, a, c)
                        beside = total / count - u
                        mirrored = u - beside * ratio / count
                        fields.velocity[w, a, c] = felt * mirrored + (ONE - felt) * (u + beside)
