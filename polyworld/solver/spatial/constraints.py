"""Contact forces: non-penetration, exact Coulomb friction, rolling and spinning resistance; overlaps.

Projected Gauss-Seidel over contacts (Moreau 1988; Jourdan, Alart & Jean 1998, Comput. Methods Appl. Mech. Eng.
155, 31), warm started and stopped when it has converged. Friction projects on the disc, not on a pyramid, and its
fixed point opposes the sliding velocity exactly.
"""

from typing import Any

import warp as wp

from polyworld.solver.core.friction import friction_impulse
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.rows import make_row, push, velocity_along, world_inverse_inertia

ITERATIONS = 200
CONVERGED = wp.float64(1.0e-7)  # largest velocity change in a sweep that counts as none [m/s]
OVERLAP_SWEEPS = 3
OVERLAP_SHARE = wp.float64(0.05)  # of an overlap, removed in a sweep
OVERLAP_SPEED = wp.float64(0.5)  # at most [m/s]
NEAR_REST = wp.float64(4.0)  # times what it may change by in a step, below which a velocity may reverse
BRAKE_PART = wp.float64(1.0 / 32.0)  # of a step, in which it then reverses
NO_TARGET = wp.float64(-1.0e30)  # a normal velocity that is always reached
ROWS = 6  # normal, two tangents, spin, two of rolling


@wp.func
def build_rows(state: wp.array[State], w: int, half: int, lock: wp.vec3d) -> None:
    """Write the rows of all contacts in this half. Friction acts at the anchors, normal forces at the points."""
    base = half * state[0].max_manifolds
    offset = half * state[0].max_contacts
    for i in range(base, base + state[0].manifold_count[w, half]):
        m = state[0].manifolds[w, i]
        xa = state[0].bodies[w, m.a].x
        xb = state[0].bodies[w, m.b].x
        ia = world_inverse_inertia(state[0].bodies, w, m.a)
        ib = world_inverse_inertia(state[0].bodies, w, m.b)
        masses = state[0].bodies[w, m.a].inverse_mass + state[0].bodies[w, m.b].inverse_mass
        centre = wp.vec3d()
        touching = wp.int32(0)
        for c in range(m.first, m.first + m.count):
            if state[0].contacts[w, c].gap <= m.close:
                centre += state[0].contacts[w, c].point
                touching += 1
        if touching > 0:
            centre = centre / wp.float64(touching)
        for c in range(m.first, m.first + m.count):
            r = ROWS * (c - offset)
            p = state[0].contacts[w, c].point
            state[0].rows[w, r] = make_row(
                m.normal, wp.cross(p - xa, m.normal), wp.cross(p - xb, m.normal), ia, ib, masses, lock
            )
            if touching > 1:
                p = centre + (p - centre) * m.anchor
            pa = p - xa
            pb = p - xb
            state[0].rows[w, r + 1] = make_row(m.t1, wp.cross(pa, m.t1), wp.cross(pb, m.t1), ia, ib, masses, lock)
            state[0].rows[w, r + 2] = make_row(m.t2, wp.cross(pa, m.t2), wp.cross(pb, m.t2), ia, ib, masses, lock)
            state[0].contacts[w, c].speed = velocity_along(state, w, m.a, m.b, r)
            state[0].contacts[w, c].slip = wp.vec2d(
                velocity_along(state, w, m.a, m.b, r + 1), velocity_along(state, w, m.a, m.b, r + 2)
            )
            state[0].contacts[w, c].coupling = wp.dot(state[0].rows[w, r + 1].ja, state[0].rows[w, r + 2].wa) + wp.dot(
                state[0].rows[w, r + 1].jb, state[0].rows[w, r + 2].wb
            )
            if m.torsion > wp.float64(0.0):
                state[0].rows[w, r + 3] = make_row(wp.vec3d(), m.normal, m.normal, ia, ib, masses, lock)
            if m.rolling > wp.float64(0.0):
                state[0].rows[w, r + 4] = make_row(wp.vec3d(), m.t1, m.t1, ia, ib, masses, lock)
                state[0].rows[w, r + 5] = make_row(wp.vec3d(), m.t2, m.t2, ia, ib, masses, lock)
                state[0].contacts[w, c].turning = wp.vec2d(
                    velocity_along(state, w, m.a, m.b, r + 4), velocity_along(state, w, m.a, m.b, r + 5)
                )
                state[0].contacts[w, c].coupling_rolling = wp.dot(m.t1, state[0].rows[w, r + 5].wa) + wp.dot(
                    m.t1, state[0].rows[w, r + 5].wb
                )


@wp.func
def solve_disc(
    state: wp.array[State],
    w: int,
    a: int,
    b: int,
    r: int,
    coupling: wp.float64,
    bound: wp.float64,
    target_velocity: wp.vec2d,
) -> wp.float64:
    """Bring the two-dimensional velocity of rows r, r + 1 towards `target_velocity` with an impulse of at most `bound`.

    Returns the velocity changed.
    """
    x = state[0].rows[w, r].impulse
    y = state[0].rows[w, r + 1].impulse
    if bound <= wp.float64(0.0) and x == wp.float64(0.0) and y == wp.float64(0.0):
        return wp.float64(0.0)
    vx = velocity_along(state, w, a, b, r) - target_velocity[0]
    vy = velocity_along(state, w, a, b, r + 1) - target_velocity[1]
    kx = state[0].rows[w, r].k
    ky = state[0].rows[w, r + 1].k
    impulse = friction_impulse(wp.vec2d(x, y), wp.vec2d(vx, vy), wp.vec3d(kx, coupling, ky), bound)
    push(state, w, a, b, r, impulse[0] - x)
    push(state, w, a, b, r + 1, impulse[1] - y)
    return wp.max(wp.abs(impulse[0] - x) * kx, wp.abs(impulse[1] - y) * ky)


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
def clear_impulses(state: wp.array[State], w: int, r: int) -> None:
    for k in range(ROWS):
        state[0].rows[w, r + k].impulse = wp.float64(0.0)


@wp.func
def set_contact_targets(state: wp.array[State], w: int, half: int, h: wp.float64, threshold: wp.float64) -> None:
    """Set the contacts' target velocities at the end of a step of length h; warm-start with the last step's forces.

    Open contacts that close faster than the threshold are left to the impact that follows.
    """
    base = half * state[0].max_manifolds
    offset = half * state[0].max_contacts
    last = base + state[0].manifold_count[w, half]
    for i in range(base, last):
        m = state[0].manifolds[w, i]
        for c in range(m.first, m.first + m.count):
            r = ROWS * (c - offset)
            # The gap closes by the mean of the velocities before and after; what approaches at no gap just stops.
            needed = -wp.max(state[0].contacts[w, c].gap, wp.float64(0.0)) / h
            state[0].contacts[w, c].target = wp.min(needed, wp.float64(2.0) * needed - state[0].contacts[w, c].speed)
            if state[0].contacts[w, c].gap > m.close and state[0].contacts[w, c].speed < -threshold:
                state[0].contacts[w, c].target = NO_TARGET
            clear_impulses(state, w, r)
            normal = state[0].contacts[w, c].force_n * h
            if normal > wp.float64(0.0):
                push(state, w, m.a, m.b, r, normal)
                f = state[0].contacts[w, c].force_t * h
                push(state, w, m.a, m.b, r + 1, wp.dot(f, m.t1))
                push(state, w, m.a, m.b, r + 2, wp.dot(f, m.t2))
                if m.torsion > wp.float64(0.0):
                    push(state, w, m.a, m.b, r + 3, state[0].contacts[w, c].force_spin * h)
                if m.rolling > wp.float64(0.0):
                    g = state[0].contacts[w, c].force_roll * h
                    push(state, w, m.a, m.b, r + 4, wp.dot(g, m.t1))
                    push(state, w, m.a, m.b, r + 5, wp.dot(g, m.t2))


@wp.func
def note_forces(state: wp.array[State], w: int, half: int, h: wp.float64) -> None:
    """Store the contact forces of a step of length h for the next."""
    base = half * state[0].max_manifolds
    offset = half * state[0].max_contacts
    last = base + state[0].manifold_count[w, half]
    rate = wp.float64(1.0) / h
    for i in range(base, last):
        m = state[0].manifolds[w, i]
        for c in range(m.first, m.first + m.count):
            r = ROWS * (c - offset)
            state[0].contacts[w, c].force_n = state[0].rows[w, r].impulse * rate
            state[0].contacts[w, c].force_t = (
                m.t1 * state[0].rows[w, r + 1].impulse + m.t2 * state[0].rows[w, r + 2].impulse
            ) * rate
            state[0].contacts[w, c].force_spin = state[0].rows[w, r + 3].impulse * rate
            state[0].contacts[w, c].force_roll = (
                m.t1 * state[0].rows[w, r + 4].impulse + m.t2 * state[0].rows[w, r + 5].impulse
            ) * rate


@wp.func
def separate_overlaps(state: wp.array[State], w: int, half: int, h: wp.float64) -> None:
    """Move overlapping bodies apart by a fraction of the overlap, without giving them velocity.

    Contacts keep what is within the touching distance, so bodies at rest are not moved at all.
    """
    base = half * state[0].max_manifolds
    offset = half * state[0].max_contacts
    last = base + state[0].manifold_count[w, half]
    deepest = wp.float64(0.0)
    for i in range(base, last):
        close = state[0].manifolds[w, i].close
        start = state[0].manifolds[w, i].first
        for c in range(start, start + state[0].manifolds[w, i].count):
            deepest = wp.max(deepest, -close - state[0].contacts[w, c].gap)
    if deepest <= wp.float64(0.0):
        return
    for _sweep in range(OVERLAP_SWEEPS):
        for i in range(base, last):
            m = state[0].manifolds[w, i]
            for c in range(m.first, m.first + m.count):
                r = ROWS * (c - offset)
                gap = (
                    state[0].contacts[w, c].gap
                    + wp.max(state[0].contacts[w, c].speed, wp.float64(0.0)) * h  # it opens by itself
                    + wp.dot(m.normal, state[0].bodies[w, m.a].shift - state[0].bodies[w, m.b].shift)
                    + wp.dot(state[0].rows[w, r].ja, state[0].bodies[w, m.a].rotation_shift)
                    - wp.dot(state[0].rows[w, r].jb, state[0].bodies[w, m.b].rotation_shift)
                )
                depth = -m.close - gap
                if depth > wp.float64(0.0):
                    move = wp.min(depth * OVERLAP_SHARE, OVERLAP_SPEED * h) / state[0].rows[w, r].k
                    state[0].bodies[w, m.a].shift += m.normal * (move * state[0].bodies[w, m.a].inverse_mass)
                    state[0].bodies[w, m.a].rotation_shift += state[0].rows[w, r].wa * move
                    state[0].bodies[w, m.b].shift -= m.normal * (move * state[0].bodies[w, m.b].inverse_mass)
                    state[0].bodies[w, m.b].rotation_shift -= state[0].rows[w, r].wb * move


def contact_solver(hold: Any) -> tuple[Any, Any]:
    """Return the functions `solve_manifolds` and `solve_contacts`, for a function `hold` that solves the joints.

    hold(joints, state, w, h, contacts) is visited in every sweep over so many manifolds and returns the largest
    velocity it changed.
    """

    @wp.func(inline=False)
    def solve_manifolds(
        joints: wp.array[Joints],
        state: wp.array[State],
        w: int,
        first: int,
        last: int,
        offset: int,
        iterations: int,
        converged: wp.float64,
        h: wp.float64,
    ) -> None:
        """Sweep over the manifolds [first, last) and all joints until no velocity changes any more.

        Normal velocities approach targets. h is the length of the step, 0 for an impact, in which finite forces do
        nothing.
        """
        for _iteration in range(iterations):
            worst = wp.float64(0.0)
            for i in range(first, last):
                a = state[0].manifolds[w, i].a
                b = state[0].manifolds[w, i].b
                friction = state[0].manifolds[w, i].friction
                torsion = state[0].manifolds[w, i].torsion
                rolling = state[0].manifolds[w, i].rolling
                start = state[0].manifolds[w, i].first
                for c in range(start, start + state[0].manifolds[w, i].count):
                    r = ROWS * (c - offset)
                    k = state[0].rows[w, r].k
                    before = state[0].rows[w, r].impulse
                    lack = state[0].contacts[w, c].target - velocity_along(state, w, a, b, r)
                    normal = wp.max(before + lack / k, wp.float64(0.0))
                    if normal != before:
                        push(state, w, a, b, r, normal - before)
                        worst = wp.max(worst, wp.abs(normal - before) * k)
                    stick_impulse = state[0].contacts[w, c].stick_impulse
                    if friction > wp.float64(0.0) or stick_impulse > wp.float64(0.0):
                        coupling = state[0].contacts[w, c].coupling
                        bound = wp.max(friction * normal, stick_impulse)
                        target_velocity = state[0].contacts[w, c].target_velocity
                        worst = wp.max(worst, solve_disc(state, w, a, b, r + 1, coupling, bound, target_velocity))
                    if torsion > wp.float64(0.0):
                        bound = friction * normal * torsion
                        spin = state[0].rows[w, r + 3].impulse
                        rate = velocity_along(state, w, a, b, r + 3)
                        wanted = wp.clamp(spin - rate / state[0].rows[w, r + 3].k, -bound, bound)
                        push(state, w, a, b, r + 3, wanted - spin)
                        worst = wp.max(worst, wp.abs(wanted - spin) * state[0].rows[w, r + 3].k * torsion)
                    if rolling > wp.float64(0.0):
                        coupling = state[0].contacts[w, c].coupling_rolling
                        bound = rolling * normal
                        turning = state[0].contacts[w, c].turning
                        if h <= wp.float64(0.0):
                            turning = wp.vec2d()
                        changed = solve_rolling(state, w, a, b, r + 4, coupling, bound, turning)
                        worst = wp.max(worst, changed * rolling)
            worst = wp.max(worst, hold(joints, state, w, h, last - first))
            if worst < converged:
                break

    @wp.func
    def solve_contacts(joints: wp.array[Joints], state: wp.array[State], w: int, half: int, h: wp.float64) -> None:
        """Change the bodies' velocities at the end of a step of length h into admissible ones."""
        base = half * state[0].max_manifolds
        offset = half * state[0].max_contacts
        last = base + state[0].manifold_count[w, half]
        solve_manifolds(joints, state, w, base, last, offset, ITERATIONS, CONVERGED, h)

    return solve_manifolds, solve_contacts
