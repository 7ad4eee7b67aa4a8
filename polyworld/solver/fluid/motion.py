"""From the grid back to particles, which then move; solids keep them out."""

import warp as wp

from polyworld.solver.fluid.distance import nearest, to_solid
from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Liquids, Pace, Particles, Solids, Wetted
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO, centre, gather, gather_slope, stencil
from polyworld.solver.spatial.layout import Body

wp.set_module_options(OPTIONS)

LAYERS = 3  # faces beyond the liquid that its velocity is continued to
SKIN = wp.float64(0.02)  # particles keep this many edges from solids
SHUT = wp.float64(1.0e-3)
SLID = -1  # in place of the layer in which a face's velocity is known: it slides along a solid


@wp.struct
class Motion:
    """Position and velocity; or, of the nearest solid, its outward normal, its velocity, its body, -1 for none,
    and its distance."""

    x: wp.vec3d
    v: wp.vec3d
    body: int
    distance: wp.float64


@wp.func
def _motion(x: wp.vec3d, v: wp.vec3d) -> Motion:
    m = Motion()
    m.x = x
    m.v = v
    m.body = -1
    return m


@wp.func
def _velocity(grid: Grid, fields: Fields, w: int, x: wp.vec3d) -> wp.vec3d:
    v = wp.vec3d()
    for a in range(3):
        if grid.wide[a] == 1:
            v[a] = gather(grid, fields.velocity[w, a], stencil(grid, x, a))
    return v


@wp.kernel
def continue_velocity(grid: Grid, fields: Fields, layer: int, pace: Pace) -> None:
    """Velocity of faces outside the liquid: the mean of their neighbours known up to a layer."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for a in range(3):
        if grid.wide[a] == 0:
            continue
        known = fields.known[w, a]
        velocity = fields.velocity[w, a]
        for i in range(lo[0], hi[0]):
            for j in range(lo[1], hi[1]):
                for k in range(lo[2], hi[2]):
                    c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                    if known[c] > 0:
                        continue
                    index = wp.vec3i(i, j, k)
                    total = wp.float64(0.0)
                    count = wp.int32(0)
                    for b in range(3):
                        if grid.wide[b] == 0:
                            continue
                        if index[b] > lo[b]:
                            d = c - grid.stride[b]
                            n = known[d]
                            if n > 0 and n <= layer:
                                total += velocity[d]
                                count += 1
                        if index[b] + 1 < hi[b]:
                            d = c + grid.stride[b]
                            n = known[d]
                            if n > 0 and n <= layer:
                                total += velocity[d]
                                count += 1
                    if count > 0:
                        velocity[c] = total / wp.float64(count)
                        known[c] = layer + 1


@wp.func(inline=False)
def solid_at(solids: Solids, bodies: wp.array2d[Body], w: int, p: wp.vec3d, statics: int) -> Motion:
    """Outward normal of the solid closest to p, its velocity there, and its body; with or without statics."""
    best = wp.float64(1.0e6)
    owner = wp.int32(-1)
    normal = wp.vec3d()
    velocity = wp.vec3d()
    still = wp.vec3d()
    axes = wp.identity(n=3, dtype=wp.float64)
    for s in range(solids.solids.shape[0]):
        b = solids.solids[s].body
        x = still
        r = axes
        if b >= 0:
            if bodies[w, b].active == 0:
                continue
            x = bodies[w, b].x
            r = bodies[w, b].rotation
        elif statics == 0:
            continue
        near = nearest(solids, s, to_solid(solids.solids[s], x, r, p))
        if near[3] < best:
            best = near[3]
            owner = b
            normal = r * (solids.solids[s].rotation * wp.vec3d(near[0], near[1], near[2]))
            velocity = still
            if b >= 0:
                velocity = bodies[w, b].v + wp.cross(bodies[w, b].w, p - x)
    found = _motion(normal, velocity)
    found.body = owner
    found.distance = best
    return found


@wp.kernel
def slide_along_solids(
    grid: Grid, solids: Solids, fields: Fields, wetted: Wetted, bodies: wp.array2d[Body], pace: Pace
) -> None:
    """Find the velocity of faces that solids shut, that of the liquid beside them less its part into the solid.

    It is left in `push`, with `known` SLID, until that of all is found.

    Walls of about an edge's thickness are shut at a face near their surface, on which half a cell of liquid hangs that
    the pressure at the cell's centre does not bear: force and torque of `wetted` take the momentum that it loses.
    """
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
                for a in range(3):
                    if grid.wide[a] == 1 and fields.static_open[a, c] < ONE and fields.mass[w, a, c] > ZERO:
                        pace.touching[w] = 1
                    if grid.wide[a] == 0 or fields.open[w, a, c] > SHUT or fields.known[w, a, c] == 0:
                        continue
                    if grid.closed == 1 and (index[a] <= grid.lower[a] or index[a] >= grid.upper[a]):
                        fields.push[w, a, c] = ZERO
                        fields.known[w, a, c] = SLID
                        continue
                    p = centre(grid, i, j, k, a)
                    outside = wp.int32(0)
                    for b in range(3):
                        if grid.wide[b] == 1 and (index[b] < grid.lower[b] or index[b] >= grid.upper[b]):
                            outside = 1
                    if outside == 1 and grid.closed == 1:
                        continue
                    near = solid_at(solids, bodies, w, p, 1)
                    u = _velocity(grid, fields, w, p)
                    into = wp.dot(u - near.v, near.x)
                    slid = u[a] - into * near.x[a]
                    fields.push[w, a, c] = slid
                    fields.known[w, a, c] = SLID
                    shallow = near.distance > -wp.float64(0.49) * grid.cell
                    if near.body >= 0 and fields.mass[w, a, c] > ZERO and shallow:
                        momentum_loss = wp.vec3d()
                        momentum_loss[a] = fields.mass[w, a, c] * (fields.shift[w, a, c] - slid)
                        b = near.body
                        wp.atomic_add(wetted.force, w, b, momentum_loss)
                        wp.atomic_add(wetted.torque, w, b, wp.cross(p - bodies[w, b].x, momentum_loss))


@wp.kernel
def take_slid(grid: Grid, fields: Fields, pace: Pace) -> None:
    """Velocity of the faces that solids shut, once all of them are found from those of the liquid."""
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
                    if fields.known[w, a, c] == SLID:
                        fields.velocity[w, a, c] = fields.push[w, a, c]


@wp.func
def _keep_out(
    grid: Grid,
    solids: Solids,
    bodies: wp.array2d[Body],
    wetted: Wetted,
    w: int,
    particle: Motion,
    mass: wp.float64,
    last: int,
) -> Motion:
    """Position and velocity of a particle once solids [0, last) have pushed it out; bodies feel its impulse."""
    x = particle.x
    v = particle.v
    skin = SKIN * grid.cell
    for s in range(last):
        b = solids.solids[s].body
        position = wp.vec3d()
        r = wp.identity(n=3, dtype=wp.float64)
        if b >= 0:
            if bodies[w, b].active == 0:
                continue
            position = bodies[w, b].x
            reach = solids.solids[s].bound + wp.length(solids.solids[s].position) + skin
            away = x - position
            if grid.thin >= 0:
                away[grid.thin] = ZERO
            if wp.dot(away, away) > reach * reach:
                continue
            r = bodies[w, b].rotation
        near = nearest(solids, s, to_solid(solids.solids[s], position, r, x))
        if near[3] < skin:
            n = r * (solids.solids[s].rotation * wp.vec3d(near[0], near[1], near[2]))
            u = wp.vec3d()
            if b >= 0:
                u = bodies[w, b].v + wp.cross(bodies[w, b].w, x - position)
            into = wp.dot(v - u, n)
            if into < ZERO:
                v = v - n * into
                if b >= 0:
                    impulse = n * (mass * into)
                    wp.atomic_add(wetted.force, w, b, impulse)
                    wp.atomic_add(wetted.torque, w, b, wp.cross(x - position, impulse))
            x = x + n * (skin - near[3])
    return _motion(x, v)


@wp.kernel
def move_particles(
    grid: Grid,
    solids: Solids,
    particles: Particles,
    liquids: Liquids,
    fields: Fields,
    wetted: Wetted,
    bodies: wp.array2d[Body],
    pace: Pace,
) -> None:
    """Particles take the grid's velocity and its gradient, and move with it (midpoint rule).

    Impulses of particles that run into bodies are added to force and torque of `wetted`, masses and gains of momentum
    but for gravity's to whole and gained of `pace`.
    """
    w = wp.tid()
    dt = pace.dt[w]
    if dt <= ZERO:
        return
    skin = SKIN * grid.cell
    fall = liquids.gravity[w % liquids.gravity.shape[0]] * dt
    whole = wp.float64(0.0)
    gained = wp.vec3d()
    for p in range(particles.used[w]):
        if particles.fluid[w, p] < 0:
            continue
        x = particles.x[w, p]
        v = wp.vec3d()
        gradient = wp.mat33d()
        shift = wp.vec3d()
        for a in range(3):
            if grid.wide[a] == 0:
                continue
            s = stencil(grid, x, a)
            v[a] = gather(grid, fields.velocity[w, a], s)
            slope = gather_slope(grid, fields.velocity[w, a], s)
            for b in range(3):
                gradient[a, b] = slope[b]
            shift[a] = gather(grid, fields.shift[w, a], s)
        fluid = particles.fluid[w, p]
        mass = particles.volume * liquids.density[w % liquids.density.shape[0], fluid]
        was = particles.v[w, p] + fall
        u = v + gradient * (v * (HALF * dt))  # at the middle of the path
        x = x + u * dt + shift
        gone = wp.int32(0)
        for a in range(3):
            if grid.wide[a] == 0:
                continue
            if grid.closed == 0:
                if x[a] <= grid.box_lower[a] or x[a] >= grid.box_upper[a]:
                    gone = 1
                continue
            if x[a] < grid.box_lower[a] + skin:
                x[a] = grid.box_lower[a] + skin
                v[a] = wp.max(v[a], ZERO)
            if x[a] > grid.box_upper[a] - skin:
                x[a] = grid.box_upper[a] - skin
                v[a] = wp.min(v[a], ZERO)
        if gone == 1:
            particles.fluid[w, p] = -1
            wp.atomic_min(particles.free, w, p)
            continue
        g = (x - grid.origin) / grid.cell
        c = wp.int32(0)
        for a in range(3):
            if grid.wide[a] == 1:
                c += wp.clamp(wp.int32(g[a]), 0, grid.count[a] - 1) * grid.stride[a]
        last = solids.moving
        if fields.static_distance[c] < wp.float64(1.5) * grid.cell:
            last = solids.solids.shape[0]
        if last > 0:
            for _ in range(2):
                kept = _keep_out(grid, solids, bodies, wetted, w, _motion(x, v), mass, last)
                x = kept.x
                v = kept.v
        whole += mass
        gained = gained + mass * (v - was)
        particles.x[w, p] = x
        particles.v[w, p] = v
        particles.gradient[w, p] = gradient
    wp.atomic_add(pace.whole, w, whole)
    wp.atomic_add(pace.gained, w, gained)


@wp.kernel
def restore_momentum(grid: Grid, particles: Particles, wetted: Wetted, bodies: int, pace: Pace) -> None:
    """Remove what the free surface's ghost values have added to the momentum, where only gravity acts from outside."""
    w = wp.tid()
    whole = pace.whole[w]
    if pace.dt[w] <= ZERO or pace.touching[w] == 1 or whole <= ZERO:
        return
    gained = pace.gained[w]
    for b in range(bodies):
        gained = gained + wetted.force[w, b]
    gained = gained + pace.given[w]
    if grid.thin >= 0:
        gained[grid.thin] = ZERO
    for p in range(particles.used[w]):
        if particles.fluid[w, p] >= 0:
            particles.v[w, p] = particles.v[w, p] - gained / whole
