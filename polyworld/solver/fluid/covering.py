"""Fractions of faces and cells free of solids, and the faces that rigid bodies cover."""

import warp as wp

from polyworld.solver.fluid.distance import cover, nearest, to_solid
from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Pace, Solids, Wetted
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO, centre
from polyworld.solver.spatial.layout import Body

wp.set_module_options(OPTIONS)

REACH = wp.float64(1.5)  # a solid farther than this many edges from a cell's centre touches none of its faces
DEPTH = wp.float64(2.5)  # a cell deeper inside a body than this, and its neighbours, have no free face
QUARTER = wp.float64(0.25)


@wp.func
def _offset(grid: Grid, n: int, axis: int) -> wp.vec3d:
    """Return the n-th of eight points a quarter edge around a sample; those of a face lie in it."""
    o = wp.vec3d(
        QUARTER - HALF * wp.float64(n % 2),
        QUARTER - HALF * wp.float64((n // 2) % 2),
        QUARTER - HALF * wp.float64(n // 4),
    )
    for a in range(3):
        if a == axis or grid.wide[a] == 0:
            o[a] = ZERO
    return o * grid.cell


@wp.func
def _part(
    solids: Solids, first: int, last: int, x: wp.vec3d, r: wp.mat33d, p: wp.vec3d, h: wp.float64, flat: int
) -> wp.float64:
    """Part of p's surroundings that solids [first, last) take up."""
    total = wp.float64(0.0)
    for s in range(first, last):
        total += cover(solids, s, to_solid(solids.solids[s], x, r, p), h, flat)
    return wp.min(total, ONE)


@wp.func(inline=False)
def _mean_part(
    grid: Grid, solids: Solids, first: int, last: int, x: wp.vec3d, r: wp.mat33d, p: wp.vec3d, axis: int
) -> wp.float64:
    """Mean of `_part` over the face, or (axis 3) the cell around p."""
    flat = wp.int32(0)
    if grid.thin >= 0:
        flat = 1
    total = wp.float64(0.0)
    for n in range(8):
        total += _part(solids, first, last, x, r, p + _offset(grid, n, axis), grid.cell, flat)
    return total / wp.float64(8.0)


@wp.func
def _beyond_box(grid: Grid, p: wp.vec3d) -> wp.float64:
    """Part of p's surroundings, a cell wide, that lies outside the box."""
    inside = wp.float64(1.0)
    for a in range(3):
        if grid.wide[a] == 1:
            low = HALF - (p[a] - grid.box_lower[a]) / grid.cell
            high = HALF - (grid.box_upper[a] - p[a]) / grid.cell
            inside *= ONE - wp.clamp(low, ZERO, ONE) - wp.clamp(high, ZERO, ONE)
    return ONE - wp.max(inside, ZERO)


@wp.func(inline=False)
def _static_room(grid: Grid, solids: Solids, near: int, p: wp.vec3d) -> wp.float64:
    """Part of the cell around p, and of what is around it, that neither statics nor the box's walls take up.

    Statics often lie along the box's walls: what both take up is counted once.
    """
    flat = wp.int32(0)
    if grid.thin >= 0:
        flat = 1
    first = solids.moving
    last = solids.solids.shape[0]
    axes = wp.identity(n=3, dtype=wp.float64)
    total = wp.float64(0.0)
    for n in range(8):
        q = p + _offset(grid, n, 3)
        part = wp.float64(0.0)
        if near == 1:
            part = _part(solids, first, last, wp.vec3d(), axes, q, grid.cell, flat)
        if grid.closed == 1:
            part = wp.max(part, _beyond_box(grid, q))
        total += part
    return ONE - total / wp.float64(8.0)


@wp.func
def _closest(solids: Solids, first: int, last: int, x: wp.vec3d, r: wp.mat33d, p: wp.vec3d) -> wp.float64:
    d = wp.float64(1.0e6)
    for s in range(first, last):
        d = wp.min(d, nearest(solids, s, to_solid(solids.solids[s], x, r, p))[3])
    return d


@wp.kernel
def cover_by_statics(grid: Grid, solids: Solids, fields: Fields) -> None:
    """static_open, static_room, static_distance of every cell: box and static solids."""
    c = wp.tid()
    nyz = grid.count[1] * grid.count[2]
    index = wp.vec3i(c // nyz, (c // grid.count[2]) % grid.count[1], c % grid.count[2])
    p = centre(grid, index[0], index[1], index[2], 3)
    first = solids.moving
    last = solids.solids.shape[0]
    still = wp.vec3d()
    axes = wp.identity(n=3, dtype=wp.float64)
    d = _closest(solids, first, last, still, axes, p)
    near = wp.int32(0)
    if d < REACH * grid.cell:
        near = 1
    room = _static_room(grid, solids, near, p)
    outside = wp.int32(0)
    for a in range(3):
        fields.static_open[a, c] = ZERO
        if grid.wide[a] == 1 and (index[a] < grid.lower[a] or index[a] >= grid.upper[a]):
            outside = 1
    for a in range(3):
        if grid.wide[a] == 0:
            continue
        if grid.closed == 1:
            wall = wp.int32(0)
            if outside == 1 or index[a] == grid.lower[a]:
                wall = 1
            if wall == 1 or index[a] == grid.upper[a]:
                continue
        free = wp.float64(1.0)
        if near == 1:
            free -= _mean_part(grid, solids, first, last, still, axes, centre(grid, index[0], index[1], index[2], a), a)
        fields.static_open[a, c] = free
    if outside == 1 and grid.closed == 1:
        room = ZERO
        for a in range(3):
            fields.static_open[a, c] = ZERO
    fields.static_room[c] = room
    fields.static_distance[c] = d


@wp.kernel
def take_statics(grid: Grid, fields: Fields, pace: Pace) -> None:
    """open and room of the window's cells: box and statics."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                for a in range(3):
                    fields.open[w, a, c] = fields.static_open[a, c]
                fields.room[w, c] = fields.static_room[c]


@wp.kernel
def cover_by_bodies(
    grid: Grid, solids: Solids, fields: Fields, bodies: wp.array2d[Body], pace: Pace, wetted: Wetted
) -> None:
    """open and room of the window's cells less what bodies take, and the list of faces that they cover."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    first = wp.int32(0)
    for b in range(solids.bodies):
        reach = wp.float64(0.0)
        last = wp.int32(first)
        while last < solids.moving:
            if solids.solids[last].body != b:
                break
            reach = wp.max(reach, solids.solids[last].bound + wp.length(solids.solids[last].position))
            last += 1
        if bodies[w, b].active == 0:
            first = last
            continue
        x = bodies[w, b].x
        r = bodies[w, b].rotation
        g = (x - grid.origin) / grid.cell
        span = reach / grid.cell + wp.float64(2.0)
        begin = lo
        end = hi
        for a in range(3):
            if grid.wide[a] == 1:
                begin[a] = wp.max(lo[a], wp.int32(wp.max(g[a] - span, ZERO)))
                end[a] = wp.min(hi[a], wp.int32(wp.max(g[a] + span, -ONE)) + 1)
        for i in range(begin[0], end[0]):
            for j in range(begin[1], end[1]):
                for k in range(begin[2], end[2]):
                    c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                    p = centre(grid, i, j, k, 3)
                    d = _closest(solids, first, last, x, r, p)
                    if d > REACH * grid.cell:
                        continue
                    if d < -DEPTH * grid.cell:
                        fields.room[w, c] = ZERO
                        for a in range(3):
                            fields.open[w, a, c] = ZERO
                        continue
                    taken = _mean_part(grid, solids, first, last, x, r, p, 3)
                    fields.room[w, c] = wp.max(fields.room[w, c] - taken, ZERO)
                    for a in range(3):
                        free = fields.open[w, a, c]
                        if free <= ZERO:
                            continue
                        q = centre(grid, i, j, k, a)
                        part = wp.min(free, _mean_part(grid, solids, first, last, x, r, q, a))
                        if part <= wp.float64(1.0e-9):
                            continue
                        fields.open[w, a, c] = free - part
                        if wp.vec3i(i, j, k)[a] == lo[a]:
                            continue  # the window's border: no liquid beside it
                        count = wp.atomic_add(wetted.found, w, 1)
                        if count >= wetted.capacity:
                            wetted.full[w] = 1
                        else:
                            axis = wp.vec3d()
                            axis[a] = ONE
                            wetted.body[w, count] = b
                            wetted.axis[w, count] = a
                            wetted.face[w, count] = c
                            wetted.cover[w, count] = part
                            wetted.arm[w, count] = wp.cross(q - x, axis)
        first = last


@wp.kernel
def distances(
    solids: Solids,
    present: wp.array[wp.int32],
    position: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    points: wp.array[wp.vec3d],
    out: wp.array[wp.float64],
) -> None:
    """out: distance of points from the nearest solid, negative inside."""
    i = wp.tid()
    d = wp.float64(1.0e6)
    for s in range(solids.solids.shape[0]):
        x = wp.vec3d()
        r = wp.identity(n=3, dtype=wp.float64)
        b = solids.solids[s].body
        if b >= 0:
            if present[b] == 0:
                continue
            x = position[b]
            r = rotation[b]
        d = wp.min(d, nearest(solids, s, to_solid(solids.solids[s], x, r, points[i]))[3])
    out[i] = d
