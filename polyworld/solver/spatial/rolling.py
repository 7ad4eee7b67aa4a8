"""Rolling and spinning resistance at a contact."""

import warp as wp

from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.rows import push, velocity_along

NEAR_REST = wp.float64(4.0)  # times what it may change by in a step, below which a velocity may reverse
BRAKE_PART = wp.float64(1.0 / 32.0)  # of a step, in which it then reverses


@wp.func
def brake(
    before: wp.vec2d, free: wp.vec2d, kx: wp.float64, ky: wp.float64, coupling: wp.float64, bound: wp.float64
) -> wp.vec2d:
    """Return the impulse of a constant brake over a step, at most `bound`, on a velocity that would change evenly
    from `before` to `free`; kx, ky, coupling: velocity per impulse.

    The brake opposes the velocity as it is at the middle of the step; where this nearly stops or reverses, at each
    of several parts of the step.
    """
    change = free - before
    if wp.length(before) > NEAR_REST * (wp.length(change) + bound * wp.max(kx, ky)):
        return -bound * wp.normalize(before + change * wp.float64(0.5))
    det = kx * ky - coupling * coupling
    v = before
    most = bound * BRAKE_PART
    total = wp.vec2d()
    for _part in range(32):
        v += change * BRAKE_PART
        stop = wp.vec2d((coupling * v[1] - ky * v[0]) / det, (coupling * v[0] - kx * v[1]) / det)
        if wp.length(stop) <= most:
            total += stop
            v = wp.vec2d()
        else:
            impulse = -most * wp.normalize(v)
            total += impulse
            v += wp.vec2d(kx * impulse[0] + coupling * impulse[1], ky * impulse[1] + coupling * impulse[0])
    return total


@wp.func
def solve_rolling(
    state: wp.array[State], w: int, a: int, b: int, r: int, coupling: wp.float64, bound: wp.float64, before: wp.vec2d
) -> wp.float64:
    """Brake the two-dimensional angular velocity of rows r, r + 1, which was `before` at the start of the step, with an
    impulse of at most `bound`. Returns the velocity changed."""
    x = state[0].rows[w, r].impulse
    y = state[0].rows[w, r + 1].impulse
    if bound <= wp.float64(0.0) and x == wp.float64(0.0) and y == wp.float64(0.0):
        return wp.float64(0.0)
    kx = state[0].rows[w, r].k
    ky = state[0].rows[w, r + 1].k
    vx = velocity_along(state, w, a, b, r) - kx * x - coupling * y
    vy = velocity_along(state, w, a, b, r + 1) - ky * y - coupling * x
    impulse = brake(before, wp.vec2d(vx, vy), kx, ky, coupling, bound)
    push(state, w, a, b, r, impulse[0] - x)
    push(state, w, a, b, r + 1, impulse[1] - y)
    return wp.max(wp.abs(impulse[0] - x) * kx, wp.abs(impulse[1] - y) * ky)


@wp.func
def solve_spin(state: wp.array[State], w: int, a: int, b: int, r: int, bound: wp.float64) -> wp.float64:
    """Stop the angular velocity along row r with an impulse of at most `bound`. Returns the velocity changed."""
    spin = state[0].rows[w, r].impulse
    wanted = wp.clamp(spin - velocity_along(state, w, a, b, r) / state[0].rows[w, r].k, -bound, bound)
    push(state, w, a, b, r, wanted - spin)
    return wp.abs(wanted - spin) * state[0].rows[w, r].k
