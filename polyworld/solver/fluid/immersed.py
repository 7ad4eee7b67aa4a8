"""Ropes, cloth and soft bodies in a liquid: what they give to the grid and take from it.

Soft bodies share the grid's momentum and pressure: where they touch liquid both move together. Ropes and sheets are
thinner than a cell: they exchange momentum by drag, which for a sheet stops all flow across it, and the pressure
gradient lifts their volume. Every exchange is pairwise: what nodes gain, the liquid loses.
"""

import warp as wp

from polyworld.solver.coupled.nodes import Nodes
from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Pace
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO, Stencil, gather, scatter, stencil

wp.set_module_options(OPTIONS)

SOFT = 0
SHEET = 1
LINE = 2

OPEN = wp.float64(1.0e-3)
SPARSE = wp.float64(0.02)  # faces with this part of a cell of liquid are none to push against
WET = wp.float64(0.1)  # a soft body with this part of liquid somewhere around it takes part in the grid


@wp.struct
class Samples:
    """Points (S,) between nodes that stand for a share of an object's volume.

    node (S, 4), weight (S, 4): its place. part (S, 4): share of each node's mass. volume [m^3], per metre in a plane.
    area: of a sheet, or of a line its length times its diameter [m^2]. along, across: drag coefficients; across is
    negative where nothing flows through. object (S,): row of first, last, kind, share (O,): metres of the object for
    one metre of the slice. wet (W, O). solid_mass, solid_momentum (W, 3, C): of soft bodies on the faces.
    """

    node: wp.array2d[wp.int32]
    weight: wp.array2d[wp.float64]
    part: wp.array2d[wp.float64]
    volume: wp.array[wp.float64]
    area: wp.array[wp.float64]
    along: wp.array[wp.float64]
    across: wp.array[wp.float64]
    object: wp.array[wp.int32]
    first: wp.array[wp.int32]
    last: wp.array[wp.int32]
    kind: wp.array[wp.int32]
    share: wp.array[wp.float64]
    wet: wp.array2d[wp.int32]
    solid_mass: wp.array3d[wp.float64]
    solid_momentum: wp.array3d[wp.float64]


@wp.func
def _place(samples: Samples, nodes: Nodes, w: int, s: int) -> wp.vec3d:
    x = wp.vec3d()
    for n in range(4):
        x = x + samples.weight[s, n] * nodes.x[w, samples.node[s, n]]
    return x


@wp.func
def _inside(grid: Grid, x: wp.vec3d) -> int:
    for a in range(3):
        if grid.wide[a] == 1 and (x[a] < grid.box_lower[a] or x[a] > grid.box_upper[a]):
            return 0
    return 1


@wp.kernel
def widen_window(grid: Grid, fields: Fields, samples: Samples, nodes: Nodes, pace: Pace) -> None:
    """Widen the window of cells to the whole of the soft bodies that reach into it."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    for o in range(samples.kind.shape[0]):
        if samples.kind[o] != SOFT or nodes.active[w, samples.node[samples.first[o], 0]] == 0:
            continue
        lo = grid.count
        hi = wp.vec3i(0, 0, 0)
        for s in range(samples.first[o], samples.last[o]):
            x = _place(samples, nodes, w, s)
            if _inside(grid, x) == 0:
                continue
            g = (x - grid.origin) / grid.cell
            for a in range(3):
                i = wp.int32(wp.floor(g[a]))
                lo[a] = wp.min(lo[a], i - 2)
                hi[a] = wp.max(hi[a], i + 3)
        apart = wp.int32(0)
        for a in range(3):
            if grid.wide[a] == 1 and (lo[a] >= fields.window[w, 3 + a] or hi[a] <= fields.window[w, a]):
                apart = 1
        if apart == 1:
            continue
        for a in range(3):
            if grid.wide[a] == 1:
                fields.window[w, a] = wp.max(wp.min(fields.window[w, a], lo[a]), 0)
                fields.window[w, 3 + a] = wp.min(wp.max(fields.window[w, 3 + a], hi[a]), grid.count[a])


@wp.kernel
def immerse_soft(grid: Grid, fields: Fields, samples: Samples, nodes: Nodes, pace: Pace) -> None:
    """Adds mass, volume and momentum of the soft bodies that touch liquid to the faces."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    for i in range(fields.window[w, 0], fields.window[w, 3]):
        for j in range(fields.window[w, 1], fields.window[w, 4]):
            for k in range(fields.window[w, 2], fields.window[w, 5]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                fields.liquid[w, c] = fields.content[w, c]
                for a in range(3):
                    samples.solid_mass[w, a, c] = ZERO
                    samples.solid_momentum[w, a, c] = ZERO
    for o in range(samples.kind.shape[0]):
        samples.wet[w, o] = 0
        if samples.kind[o] != SOFT:
            continue
        for s in range(samples.first[o], samples.last[o]):
            x = _place(samples, nodes, w, s)
            if nodes.active[w, samples.node[s, 0]] == 0:
                break
            if _inside(grid, x) == 0 or _in_window(grid, fields, w, x) == 0:
                continue
            if gather(grid, fields.content[w], stencil(grid, x, 3)) > WET * grid.volume:
                samples.wet[w, o] = 1
                break
    for o in range(samples.kind.shape[0]):
        if samples.wet[w, o] == 0:
            continue
        for s in range(samples.first[o], samples.last[o]):
            x = _place(samples, nodes, w, s)
            if _inside(grid, x) == 0 or _in_window(grid, fields, w, x) == 0:
                continue
            mass = wp.float64(0.0)
            momentum = wp.vec3d()
            for n in range(4):
                m = samples.part[s, n] * nodes.mass[w % nodes.mass.shape[0], samples.node[s, n]] / samples.share[o]
                mass += m
                momentum = momentum + m * nodes.v[w, samples.node[s, n]]
            for a in range(3):
                if grid.wide[a] == 0:
                    continue
                at = stencil(grid, x, a)
                scatter(grid, fields.velocity[w, a], at, momentum[a])
                scatter(grid, fields.mass[w, a], at, mass)
                scatter(grid, fields.bulk[w, a], at, samples.volume[s])
                scatter(grid, samples.solid_momentum[w, a], at, momentum[a])
                scatter(grid, samples.solid_mass[w, a], at, mass)
            scatter(grid, fields.content[w], stencil(grid, x, 3), samples.volume[s])


@wp.func
def _in_window(grid: Grid, fields: Fields, w: int, x: wp.vec3d) -> int:
    """Check whether the samples around x lie among the cells that are looked at."""
    g = (x - grid.origin) / grid.cell
    for a in range(3):
        if grid.wide[a] == 1:
            i = wp.int32(wp.floor(g[a]))
            if i - 1 < fields.window[w, a] or i + 2 > fields.window[w, 3 + a]:
                return 0
    return 1


@wp.kernel
def lift_soft(grid: Grid, fields: Fields, samples: Samples, nodes: Nodes, pace: Pace) -> None:
    """Soft bodies take the change of the grid's velocity, through the same weights as they gave."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    # solid_momentum becomes the change of velocity on each face.
    for i in range(fields.window[w, 0], fields.window[w, 3]):
        for j in range(fields.window[w, 1], fields.window[w, 4]):
            for k in range(fields.window[w, 2], fields.window[w, 5]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                for a in range(3):
                    change = wp.float64(0.0)
                    if samples.solid_mass[w, a, c] > ZERO and fields.open[w, a, c] > OPEN:
                        change = (
                            fields.velocity[w, a, c] - samples.solid_momentum[w, a, c] / samples.solid_mass[w, a, c]
                        )
                    samples.solid_momentum[w, a, c] = change
    for o in range(samples.kind.shape[0]):
        if samples.wet[w, o] == 0:
            continue
        for s in range(samples.first[o], samples.last[o]):
            x = _place(samples, nodes, w, s)
            if _inside(grid, x) == 0 or _in_window(grid, fields, w, x) == 0:
                continue
            gained = wp.vec3d()
            for a in range(3):
                if grid.wide[a] == 1:
                    gained[a] = gather(grid, samples.solid_momentum[w, a], stencil(grid, x, a))
            for n in range(4):
                node = samples.node[s, n]
                if nodes.inverse_mass[w % nodes.inverse_mass.shape[0], node] > ZERO:
                    nodes.v[w, node] = nodes.v[w, node] + samples.part[s, n] * gained
                m = samples.part[s, n] * nodes.mass[w % nodes.mass.shape[0], node] / samples.share[o]
                pace.given[w] = pace.given[w] + m * gained


@wp.kernel
def shift_soft(grid: Grid, fields: Fields, samples: Samples, nodes: Nodes, pace: Pace) -> None:
    """Soft bodies take their part in the shift that evens out the content where they and liquid overlap or part."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    for o in range(samples.kind.shape[0]):
        if samples.wet[w, o] == 0:
            continue
        for s in range(samples.first[o], samples.last[o]):
            x = _place(samples, nodes, w, s)
            if _inside(grid, x) == 0 or _in_window(grid, fields, w, x) == 0:
                continue
            move = wp.vec3d()
            for a in range(3):
                if grid.wide[a] == 1:
                    move[a] = gather(grid, fields.shift[w, a], stencil(grid, x, a))
            for n in range(4):
                node = samples.node[s, n]
                if nodes.inverse_mass[w % nodes.inverse_mass.shape[0], node] > ZERO:
                    nodes.x[w, node] = nodes.x[w, node] + samples.part[s, n] * move


@wp.func
def _corner(grid: Grid, at: Stencil, n: int) -> int:
    return at.base + (n // 4) * grid.stride[0] + ((n // 2) % 2) * grid.stride[1] + (n % 2) * grid.stride[2]


@wp.func
def _corner_weight(at: Stencil, n: int) -> wp.float64:
    x = wp.float64(n // 4)
    y = wp.float64((n // 2) % 2)
    z = wp.float64(n % 2)
    return (ONE - wp.abs(x - at.f[0])) * (ONE - wp.abs(y - at.f[1])) * (ONE - wp.abs(z - at.f[2]))


@wp.func
def _holds(grid: Grid, fields: Fields, w: int, a: int, c: int) -> int:
    """Check whether a face has enough liquid around it, and is open enough: a spray's face would fly off."""
    if fields.bulk[w, a, c] > SPARSE * grid.volume and fields.open[w, a, c] > OPEN:
        return 1
    return 0


@wp.func(inline=False)
def _surroundings(grid: Grid, fields: Fields, w: int, a: int, at: Stencil) -> wp.vec3d:
    """Velocity of the liquid around a point, and velocity there per impulse given to it; these and the share of the
    weights that it holds, which `_kick` gives by: the three agree, so that an exchange cannot overshoot."""
    held = wp.float64(0.0)
    soft = wp.float64(0.0)
    u = wp.float64(0.0)
    for n in range(8):
        weight = _corner_weight(at, n)
        c = _corner(grid, at, n)
        if weight > ZERO and _holds(grid, fields, w, a, c) == 1:
            held += weight
            soft += weight * weight / fields.mass[w, a, c]
            u += weight * fields.velocity[w, a, c]
    if held <= ZERO:
        return wp.vec3d(ZERO, ZERO, ZERO)
    return wp.vec3d(u / held, soft / (held * held), held)


@wp.func(inline=False)
def _kick(grid: Grid, fields: Fields, w: int, a: int, at: Stencil, impulse: wp.float64) -> None:
    """Give an impulse to the liquid around a point that `_surroundings` has looked at."""
    held = wp.float64(0.0)
    for n in range(8):
        c = _corner(grid, at, n)
        if _holds(grid, fields, w, a, c) == 1:
            held += _corner_weight(at, n)
    for n in range(8):
        c = _corner(grid, at, n)
        if _holds(grid, fields, w, a, c) == 1:
            share = _corner_weight(at, n) / held
            fields.velocity[w, a, c] = fields.velocity[w, a, c] + share * impulse / fields.mass[w, a, c]


@wp.func(inline=False)
def _direction(samples: Samples, nodes: Nodes, w: int, s: int, kind: int) -> wp.vec3d:
    """Normal of a sheet, or direction of a line, at a sample."""
    a = nodes.x[w, samples.node[s, 0]]
    b = nodes.x[w, samples.node[s, 1]]
    if kind == LINE:
        return wp.normalize(b - a)
    return wp.normalize(wp.cross(b - a, nodes.x[w, samples.node[s, 2]] - a))


@wp.func(inline=False)
def _exchange(grid: Grid, fields: Fields, samples: Samples, nodes: Nodes, w: int, dt: wp.float64) -> wp.vec3d:
    """Momentum that sheets and lines get from the liquid around them, which loses it, sample by sample.

    Each impulse is at most what brings both to one velocity, with what nodes and faces weigh in it: never more energy
    than before. In a time dt there is drag; across a sheet nothing flows, however short that is.
    """
    given = wp.vec3d()
    for s in range(samples.object.shape[0]):
        o = samples.object[s]
        kind = samples.kind[o]
        if kind == SOFT or nodes.active[w, samples.node[s, 0]] == 0:
            continue
        x = _place(samples, nodes, w, s)
        if _inside(grid, x) == 0 or _in_window(grid, fields, w, x) == 0:
            continue
        liquid = wp.vec3d()
        soft = wp.vec3d()
        density = wp.float64(0.0)
        dry = wp.int32(0)
        for a in range(3):
            if grid.wide[a] == 0:
                continue
            at = stencil(grid, x, a)
            found = _surroundings(grid, fields, w, a, at)
            liquid[a] = found[0]
            soft[a] = found[1]
            if found[2] < HALF:
                dry = 1
            bulk = gather(grid, fields.bulk[w, a], at)
            if bulk > ZERO:
                density = gather(grid, fields.mass[w, a], at) / bulk
        if dry == 1:
            continue
        v = wp.vec3d()
        inverse = wp.float64(0.0)
        for n in range(4):
            node = samples.node[s, n]
            v = v + samples.weight[s, n] * nodes.v[w, node]
            inverse += (
                samples.weight[s, n] * samples.weight[s, n] * nodes.inverse_mass[w % nodes.inverse_mass.shape[0], node]
            )
        inverse *= samples.share[o]
        relative = v - liquid
        if grid.thin >= 0:
            relative[grid.thin] = ZERO
        d = _direction(samples, nodes, w, s, kind)
        over = d * wp.dot(relative, d)  # across a sheet, along a line
        if kind == LINE:
            over = relative - over
        beside = relative - over
        yielding = inverse + wp.max(soft[0], wp.max(soft[1], soft[2]))
        half = HALF * density * samples.area[s]
        drag = half * samples.along[s] * wp.length(beside) * dt
        impulse = beside * (-drag / (ONE + drag * yielding))
        if samples.across[s] < ZERO:
            impulse = impulse - over / yielding
        else:
            drag = half * samples.across[s] * wp.length(over) * dt
            impulse = impulse - over * (drag / (ONE + drag * yielding))
        for a in range(3):
            if grid.wide[a] == 1:
                _kick(grid, fields, w, a, stencil(grid, x, a), -impulse[a])
        _push_nodes(samples, nodes, w, s, impulse * samples.share[o])
        given = given + impulse
    return given


@wp.kernel
def drag_thin(grid: Grid, fields: Fields, samples: Samples, nodes: Nodes, pace: Pace) -> None:
    """Implicit exchange of momentum between sheets and lines and the liquid around them."""
    w = wp.tid()
    if pace.dt[w] > ZERO:
        pace.given[w] = pace.given[w] + _exchange(grid, fields, samples, nodes, w, pace.dt[w])


@wp.func
def _push_nodes(samples: Samples, nodes: Nodes, w: int, s: int, impulse: wp.vec3d) -> None:
    for n in range(4):
        node = samples.node[s, n]
        m = nodes.inverse_mass[w % nodes.inverse_mass.shape[0], node]
        nodes.v[w, node] = nodes.v[w, node] + impulse * (samples.weight[s, n] * m)


@wp.kernel
def lift_thin(grid: Grid, fields: Fields, samples: Samples, nodes: Nodes, pace: Pace) -> None:
    """Buoyancy of sheets and lines: the pressure gradient times their volume, its reaction on the liquid, and the
    exchange that follows across sheets."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    for s in range(samples.object.shape[0]):
        o = samples.object[s]
        if samples.kind[o] == SOFT or nodes.active[w, samples.node[s, 0]] == 0:
            continue
        x = _place(samples, nodes, w, s)
        if _inside(grid, x) == 0 or _in_window(grid, fields, w, x) == 0:
            continue
        impulse = wp.vec3d()
        for a in range(3):
            if grid.wide[a] == 0:
                continue
            at = stencil(grid, x, a)
            if _surroundings(grid, fields, w, a, at)[2] >= HALF:  # as for the exchange
                wet = wp.min(gather(grid, fields.bulk[w, a], at) / grid.volume, ONE)
                impulse[a] = wet * samples.volume[s] * gather(grid, fields.push[w, a], at)
                _kick(grid, fields, w, a, at, -impulse[a])
        _push_nodes(samples, nodes, w, s, impulse * samples.share[o])
        pace.given[w] = pace.given[w] + impulse
    # A light sheet, lifted by many times its weight, takes the liquid on both sides with it.
    pace.given[w] = pace.given[w] + _exchange(grid, fields, samples, nodes, w, ZERO)
