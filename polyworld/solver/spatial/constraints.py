"""Contacts over a step: the rows of their impulses, targets of their velocities, forces kept, and overlaps."""

import warp as wp

from polyworld.solver.spatial.layout import Row, State
from polyworld.solver.spatial.rows import make_row, push, world_inverse_inertia

OVERLAP_SWEEPS = 3
OVERLAP_SHARE = wp.float64(0.05)  # of an overlap, removed in a sweep
OVERLAP_SPEED = wp.float64(0.5)  # at most [m/s]
NO_TARGET = wp.float64(-1.0e30)  # a normal velocity that is always reached
ROWS = 3  # normal and two tangents; as many of spin and rolling follow those of all contacts


@wp.func
def build_rows(state: wp.array[State], w: int, half: int, lock: wp.vec3d) -> None:
    """Write the rows of all contacts in this half. Friction acts at the anchors, normal forces at the points."""
    base = half * state[0].max_manifolds
    offset = half * state[0].max_contacts
    bodies = state[0].bodies[w]
    contacts = state[0].contacts[w]
    rows = state[0].rows[w]
    turning_rows = state[0].turning_rows
    state[0].resisting[w] = 0
    for i in range(base, base + state[0].manifold_count[w, half]):
        m = state[0].manifolds[w, i]
        moving = m.b < state[0].objects
        xa = bodies[m.a].x
        xb = bodies[m.b].x
        ia = world_inverse_inertia(state[0].bodies, w, m.a)
        ib = wp.mat33d()
        if moving:
            ib = world_inverse_inertia(state[0].bodies, w, m.b)
        apart = bodies[m.a].v - bodies[m.b].v
        wa = bodies[m.a].w
        wb = bodies[m.b].w
        masses = bodies[m.a].inverse_mass + bodies[m.b].inverse_mass
        centre = wp.vec3d()
        touching = wp.int32(0)
        for c in range(m.first, m.first + m.count):
            if contacts[c].gap <= m.close:
                centre += contacts[c].point
                touching += 1
        if touching > 0:
            centre = centre / wp.float64(touching)
        for c in range(m.first, m.first + m.count):
            r = ROWS * (c - offset)
            p = contacts[c].point
            n = make_row(m.normal, wp.cross(p - xa, m.normal), wp.cross(p - xb, m.normal), ia, ib, masses, lock)
            if touching > 1:
                p = centre + (p - centre) * m.anchor
            pa = p - xa
            pb = p - xb
            x = make_row(m.t1, wp.cross(pa, m.t1), wp.cross(pb, m.t1), ia, ib, masses, lock)
            y = make_row(m.t2, wp.cross(pa, m.t2), wp.cross(pb, m.t2), ia, ib, masses, lock)
            rows[r] = n
            rows[r + 1] = x
            rows[r + 2] = y
            contacts[c].speed = wp.dot(n.d, apart) + wp.dot(n.ja, wa) - wp.dot(n.jb, wb)
            contacts[c].slip = wp.vec2d(
                wp.dot(x.d, apart) + wp.dot(x.ja, wa) - wp.dot(x.jb, wb),
                wp.dot(y.d, apart) + wp.dot(y.ja, wa) - wp.dot(y.jb, wb),
            )
            contacts[c].coupling_normal = wp.vec2d(coupling(x, n, masses), coupling(y, n, masses))
            # The inverse of the tangential velocities per impulse, and that of the largest of them.
            xy = coupling(x, y, masses)
            scale = wp.float64(1.0) / (x.k * y.k - xy * xy)
            contacts[c].mass = wp.vec3d(y.k * scale, -xy * scale, x.k * scale)
            apart_k = wp.float64(0.5) * (x.k - y.k)
            contacts[c].relaxation = wp.float64(1.0) / (
                wp.float64(0.5) * (x.k + y.k) + wp.sqrt(apart_k * apart_k + xy * xy)
            )
            if m.torsion > wp.float64(0.0) or m.rolling > wp.float64(0.0):
                state[0].resisting[w] = 1
                s = turning_rows + r
                zero = wp.vec3d()
                x = make_row(zero, m.t1, m.t1, ia, ib, masses, lock)
                y = make_row(zero, m.t2, m.t2, ia, ib, masses, lock)
                rows[s] = make_row(zero, m.normal, m.normal, ia, ib, masses, lock)
                rows[s + 1] = x
                rows[s + 2] = y
                contacts[c].turning = wp.vec2d(wp.dot(x.ja, wa) - wp.dot(x.jb, wb), wp.dot(y.ja, wa) - wp.dot(y.jb, wb))
                contacts[c].coupling_rolling = wp.dot(m.t1, y.wa) + wp.dot(m.t1, y.wb)


@wp.func
def coupling(r: Row, s: Row, masses: wp.float64) -> wp.float64:
    """Return the velocity along row r of a unit impulse along row s of the same contact."""
    return masses * wp.dot(r.d, s.d) + wp.dot(r.ja, s.wa) + wp.dot(r.jb, s.wb)


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
    bodies = state[0].bodies[w]
    contacts = state[0].contacts[w]
    rows = state[0].rows[w]
    zero = wp.float64(0.0)
    for i in range(base, base + state[0].manifold_count[w, half]):
        m = state[0].manifolds[w, i]
        pushed = wp.vec3d()
        turned_a = wp.vec3d()
        turned_b = wp.vec3d()
        for c in range(m.first, m.first + m.count):
            r = ROWS * (c - offset)
            # The gap closes by the mean of the velocities before and after; what approaches at no gap just stops.
            needed = -wp.max(contacts[c].gap, zero) / h
            target = wp.min(needed, wp.float64(2.0) * needed - contacts[c].speed)
            if contacts[c].gap > m.close and contacts[c].speed < -threshold:
                target = NO_TARGET
            contacts[c].target = target
            s = state[0].turning_rows + r
            if state[0].resisting[w] == 1:
                clear_impulses(state, w, s)
            normal = wp.max(contacts[c].force_n * h, zero)
            x = zero
            y = zero
            if normal > zero:
                f = contacts[c].force_t * h
                x = wp.dot(f, m.t1)
                y = wp.dot(f, m.t2)
                pushed += rows[r].d * normal + rows[r + 1].d * x + rows[r + 2].d * y
                turned_a += rows[r].wa * normal + rows[r + 1].wa * x + rows[r + 2].wa * y
                turned_b += rows[r].wb * normal + rows[r + 1].wb * x + rows[r + 2].wb * y
                if m.torsion > zero:
                    push(state, w, m.a, m.b, s, contacts[c].force_spin * h)
                if m.rolling > zero:
                    g = contacts[c].force_roll * h
                    push(state, w, m.a, m.b, s + 1, wp.dot(g, m.t1))
                    push(state, w, m.a, m.b, s + 2, wp.dot(g, m.t2))
            rows[r].impulse = normal
            rows[r + 1].impulse = x
            rows[r + 2].impulse = y
        bodies[m.a].v += pushed * bodies[m.a].inverse_mass
        bodies[m.a].w += turned_a
        bodies[m.b].v -= pushed * bodies[m.b].inverse_mass
        bodies[m.b].w -= turned_b


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
            if m.torsion > wp.float64(0.0) or m.rolling > wp.float64(0.0):
                s = state[0].turning_rows + r
                state[0].contacts[w, c].force_spin = state[0].rows[w, s].impulse * rate
                state[0].contacts[w, c].force_roll = (
                    m.t1 * state[0].rows[w, s + 1].impulse + m.t2 * state[0].rows[w, s + 2].impulse
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
