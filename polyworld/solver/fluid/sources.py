"""Emitters and drains: particles come and go, each a fixed volume, fractions carried over to the next step."""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Grid, Particles
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO

wp.set_module_options(OPTIONS)

GOLDEN = wp.float64(0.7548776662466927)  # 1/p and 1/p^2 of the plastic number p: points that fill a square evenly
GOLDEN_2 = wp.float64(0.5698402909980532)
TURN = wp.float64(6.283185307179586)


@wp.struct
class Sources:
    """Emitters (E,) and drains (D,). first: rows of `times` and `factors`, their schedules: E emitters, then D drains.

    rate (R, E) volume per time; drain_rate (D,), negative for no limit. due (W, E): particles still to emit;
    allowed (W, D): particles that may still go. emitted, drained: particles so far. full (W,): 1 where there was no
    room for a particle.
    """

    fluid: wp.array[wp.int32]
    position: wp.array[wp.vec3d]
    direction: wp.array[wp.vec3d]
    radius: wp.array[wp.float64]
    rate: wp.array2d[wp.float64]
    lower: wp.array[wp.vec3d]
    upper: wp.array[wp.vec3d]
    drain_rate: wp.array[wp.float64]
    start: wp.array[wp.float64]
    end: wp.array[wp.float64]
    first: wp.array[wp.int32]
    times: wp.array[wp.float64]
    factors: wp.array[wp.float64]
    due: wp.array2d[wp.float64]
    allowed: wp.array2d[wp.float64]
    emitted: wp.array2d[wp.int32]
    drained: wp.array2d[wp.int32]
    full: wp.array[wp.int32]
    emitters: int
    drains: int


@wp.func
def opening(sources: Sources, s: int, time: wp.float64, h: wp.float64) -> wp.float64:
    """Seconds of [time, time + h] that source s runs at its full rate: its schedule's factor times time it is on."""
    begin = wp.max(time, sources.start[s])
    end = wp.min(time + h, sources.end[s])
    if end <= begin:
        return ZERO
    t = HALF * (begin + end)
    first = sources.first[s]
    last = sources.first[s + 1]
    factor = wp.float64(1.0)
    if last > first:
        factor = sources.factors[first]
        for i in range(first, last):
            if t >= sources.times[i]:
                factor = sources.factors[i]
                if i + 1 < last and t < sources.times[i + 1]:
                    share = (t - sources.times[i]) / (sources.times[i + 1] - sources.times[i])
                    factor += share * (sources.factors[i + 1] - sources.factors[i])
    return factor * (end - begin)


@wp.func
def _fraction(x: wp.float64) -> wp.float64:
    return x - wp.floor(x)


@wp.func
def _mouth(grid: Grid, sources: Sources, e: int, n: int) -> wp.vec3d:
    """Return where in the mouth the n-th particle leaves: evenly over the disc, or the slot of a plane."""
    d = sources.direction[e]
    u = _fraction(HALF + wp.float64(n) * GOLDEN)
    if grid.thin >= 0:
        across = wp.vec3d()
        across[grid.thin] = ONE
        return wp.cross(across, d) * (sources.radius[e] * (wp.float64(2.0) * u - ONE))
    side = wp.vec3d(ONE, ZERO, ZERO)
    if wp.abs(d[0]) > wp.float64(0.7):
        side = wp.vec3d(ZERO, ONE, ZERO)
    side = wp.normalize(wp.cross(d, side))
    other = wp.cross(d, side)
    angle = TURN * _fraction(HALF + wp.float64(n) * GOLDEN_2)
    r = sources.radius[e] * wp.sqrt(u)
    return side * (r * wp.cos(angle)) + other * (r * wp.sin(angle))


@wp.kernel
def emit_and_drain(
    grid: Grid, particles: Particles, sources: Sources, time: wp.array[wp.float64], step: wp.array[wp.float64]
) -> None:
    """Particles that enter and leave within [time, time + step]; those that enter are as far on as they have flown."""
    w = wp.tid()
    t = time[w]
    h = step[w]
    for d in range(sources.drains):
        s = sources.emitters + d
        on = opening(sources, s, t, h)
        limited = wp.int32(0)
        if sources.drain_rate[d] >= ZERO:
            limited = 1
            share = sources.drain_rate[d] * on / particles.volume
            # What was not drained when nothing came does not add up to more than one particle.
            sources.allowed[w, d] = wp.min(sources.allowed[w, d], ONE) + share
        if on <= ZERO:
            continue
        lower = sources.lower[d]
        upper = sources.upper[d]
        for p in range(particles.used[w]):
            if particles.fluid[w, p] < 0:
                continue
            if limited == 1 and sources.allowed[w, d] < ONE:
                break
            x = particles.x[w, p]
            inside = wp.int32(1)
            for a in range(3):
                if grid.wide[a] == 1 and (x[a] < lower[a] or x[a] > upper[a]):
                    inside = 0
            if inside == 1:
                particles.fluid[w, p] = -1
                particles.free[w] = wp.min(particles.free[w], p)
                sources.drained[w, d] = sources.drained[w, d] + 1
                if limited == 1:
                    sources.allowed[w, d] = sources.allowed[w, d] - ONE
    row = particles.free[w]
    capacity = particles.x.shape[1]
    for e in range(sources.emitters):
        on = opening(sources, e, t, h)
        rate = sources.rate[w % sources.rate.shape[0], e]
        more = rate * on / particles.volume
        was = sources.due[w, e]
        due = was + more
        mouth = wp.float64(0.5) * TURN * sources.radius[e] * sources.radius[e]
        if grid.thin >= 0:
            mouth = wp.float64(2.0) * sources.radius[e]
        factor = on / h
        speed = rate * factor / mouth
        v = sources.direction[e] * speed
        k = wp.int32(0)
        while due >= ONE - wp.float64(1.0e-9):  # rounding must not hold a particle back
            while row < capacity:
                if row >= particles.used[w] or particles.fluid[w, row] < 0:
                    break
                row += 1
            if row >= capacity:
                sources.full[w] = 1
                break
            k += 1
            since = h * (ONE - (wp.float64(k) - was) / more)
            x = sources.position[e] + _mouth(grid, sources, e, sources.emitted[w, e]) + v * since
            if grid.thin >= 0:
                x[grid.thin] = grid.origin[grid.thin] + HALF * grid.cell
            particles.x[w, row] = x
            particles.v[w, row] = v
            particles.gradient[w, row] = wp.mat33d()
            particles.fluid[w, row] = sources.fluid[e]
            particles.used[w] = wp.max(particles.used[w], row + 1)
            sources.emitted[w, e] = sources.emitted[w, e] + 1
            due -= ONE
        sources.due[w, e] = due
    particles.free[w] = row
