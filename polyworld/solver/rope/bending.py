"""Bending of ropes: discrete curvature at the nodes, a half cell at clamped ends.

The curvature binormal of Bergou et al. (2008, ACM Trans. Graph. 27, 63) has the length 2 tan(phi/2), phi being the
angle between two segments. The energy EI |kappa b|^2 / (2 l) depends on c = cos(phi) alone, since |kappa b|^2 =
4 (1 - c)/(1 + c). At a clamped end the first segment is bent against the held direction over a cell of length l/2.
"""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.ends import end_node, point_velocity, push_body, twist_body
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.rope.wheels import is_off, rim_point
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)

SHARPEST = wp.constant(wp.float64(-0.999))  # cosine at which a fold counts as complete
STRAIGHT = wp.constant(wp.float64(4.0e-4))  # |kappa b|^2 below which a bend has no plane of its own

UNSTABLE = wp.constant(wp.float64(1.0))  # (inner step times frequency)^2 that one bend may have: together less than 4
OVERDAMPED = wp.constant(
    wp.float64(0.5)
)  # inner step times rate at which one bend's motion may decay: together less than 2
TINY = wp.constant(wp.float64(1.0e-30))


@wp.func
def bend_slope(stiffness: wp.float64, cell: wp.float64, cosine: wp.float64) -> wp.float64:
    """Energy per cosine of the angle, negated [J]."""
    c = wp.float64(1.0) + wp.max(cosine, SHARPEST)
    return wp.float64(4.0) * stiffness / (cell * c * c)


@wp.func
def couple(torque: wp.vec3d, direction: wp.vec3d, length: wp.float64) -> wp.vec3d:
    """Force on the head of a segment, and negated on its tail, that turns it with a torque across it."""
    return wp.cross(torque, direction) / length


@wp.func
def damping_torque(
    rate: wp.float64, t1: wp.vec3d, t2: wp.vec3d, u1: wp.vec3d, u2: wp.vec3d, length1: wp.float64, length2: wp.float64
) -> wp.vec3d:
    """Torque on the first of two segments, `rate` times the rate at which the second turns away from it.

    u1, u2: velocities of head less tail. A bent pair is resisted in its own plane only: out of it the pair turns as
    a whole, which resists nothing. A straight pair has no plane, and is resisted in all directions.
    """
    turning = wp.cross(t2, u2) / length2 - wp.cross(t1, u1) / length1
    normal = wp.cross(t1, t2)
    square = wp.length_sq(normal)
    in_plane = wp.vec3d()
    if square > wp.float64(1.0e-24):
        in_plane = normal * (wp.dot(normal, turning) / square)
    share = STRAIGHT / (STRAIGHT + square)
    return (in_plane + (turning - in_plane) * (share * share)) * rate


@wp.func
def resolved(
    stiffness: wp.float64, cell: wp.float64, cosine: wp.float64, mobility: wp.float64, h: wp.float64
) -> wp.float64:
    """Return the part of a bend's stiffness that the inner step can follow: 1 but at folds and in very short segments.

    mobility: squared rate of the angle per impulse [1/(kg m^2)]. Three bends act on a node: each may have h^2 omega^2
    of up to UNSTABLE.
    """
    c = wp.float64(1.0) + wp.max(cosine, SHARPEST)
    square = wp.float64(4.0) * stiffness / cell * (wp.float64(3.0) - c) / (c * c) * mobility * h * h
    return UNSTABLE / wp.max(square, UNSTABLE)


@wp.func
def push(
    ropes: Ropes,
    state: RopeState,
    f: wp.array2d[wp.vec3d],
    w: int,
    r: int,
    element: int,
    force: wp.vec3d,
    h: wp.float64,
) -> None:
    """Add a force to a node, or to the carrier of a wheel; it acts across the rope, through the wheel's axis."""
    if element >= 0:
        i = ropes.first_node[r] + element
        f[w, i] = f[w, i] + force
        return
    p = ropes.first_wheel[r] - 1 - element
    b = ropes.wheel_body[p]
    if b >= 0:
        push_body(state.mechanisms, state.bodies, w, b, state.bodies[w, b].rotation * ropes.wheel_centre[p], force * h)


@wp.func
def span_between(ropes: Ropes, state: RopeState, x: wp.array2d[wp.vec3d], w: int, r: int, a: int, b: int) -> wp.vec3d:
    """Return the way from an element to the next, one of which is a node; wheels where the rope touches them."""
    base = ropes.first_node[r]
    if a < 0:
        return x[w, base + b] - rim_point(ropes, state, w, ropes.first_wheel[r] - 1 - a, x[w, base + b], -1)
    if b < 0:
        return rim_point(ropes, state, w, ropes.first_wheel[r] - 1 - b, x[w, base + a], 1) - x[w, base + a]
    return x[w, base + b] - x[w, base + a]


@wp.func
def velocity_of(ropes: Ropes, state: RopeState, v: wp.array2d[wp.vec3d], w: int, r: int, element: int) -> wp.vec3d:
    if element >= 0:
        return v[w, ropes.first_node[r] + element]
    p = ropes.first_wheel[r] - 1 - element
    b = ropes.wheel_body[p]
    if b < 0:
        return wp.vec3d()
    return point_velocity(state.bodies, w, b, state.bodies[w, b].rotation * ropes.wheel_centre[p])


@wp.func
def lightness(nodes: Nodes, ropes: Ropes, w: int, r: int, element: int) -> wp.float64:
    """Inverse mass of a node, 0 of a wheel [1/kg]."""
    if element < 0:
        return wp.float64(0.0)
    return nodes.inverse_mass[w % nodes.inverse_mass.shape[0], ropes.first_node[r] + element]


@wp.struct
class Run:
    """Rope between two nodes over and past wheels: its way and how taut it is.

    a, b: the nodes. t_a, t_b: directions at them, along the rope. share: q^4 where the way is only q < 1 times the rope
    along it, else 1. Slack rope is not straight: bends with it count by that share.
    """

    a: int
    b: int
    t_a: wp.vec3d
    t_b: wp.vec3d
    way: wp.float64
    share: wp.float64


@wp.func
def run_from(ropes: Ropes, state: RopeState, x: wp.array2d[wp.vec3d], w: int, r: int, index: int) -> Run:
    """Return the run that begins at an element, a node."""
    run = Run()
    order = ropes.first_link[r] + r
    run.a = state.order[w, order + index]
    at = run.a  # the element before that the rope touches
    material = wp.float64(0.0)
    e = index
    while e == index or state.order[w, order + e] < 0:
        material += state.rest[w, ropes.first_link[r] + e]
        e += 1
        k = state.order[w, order + e]
        if k < 0 and is_off(ropes, state, w, ropes.first_wheel[r] - 1 - k):
            continue
        span = wp.vec3d()
        if at < 0 and k < 0:
            span = state.wheels[w, ropes.first_wheel[r] - 1 - k].arrives
            span -= state.wheels[w, ropes.first_wheel[r] - 1 - at].leaves
        else:
            span = span_between(ropes, state, x, w, r, at, k)
        run.way += wp.length(span)
        t = wp.normalize(span)
        if at == run.a:
            run.t_a = t
        run.t_b = t
        if k < 0:
            p = ropes.first_wheel[r] - 1 - k
            run.way += ropes.wheel_radius[p] * state.wheels[w, p].wrap
        at = k
        run.b = k
    run.share = wp.min(run.way / material, wp.float64(1.0))
    run.share = run.share * run.share * run.share * run.share
    return run


@wp.func
def tighten(
    ropes: Ropes, state: RopeState, nodes: Nodes, w: int, r: int, run: Run, energy: wp.float64, h: wp.float64
) -> None:
    """Add the tension of a slack run by which a bend with it loses energy as it gets shorter."""
    if run.share < wp.float64(1.0):
        pull = wp.float64(4.0) * energy / wp.max(run.way, wp.float64(1.0e-3) * ropes.segment_length[r])
        push(ropes, state, nodes.f, w, r, run.a, run.t_a * pull, h)
        push(ropes, state, nodes.f, w, r, run.b, -run.t_b * pull, h)


@wp.kernel
def bend(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Add bending forces of one rope. It bends freely where it touches a wheel, and runs straight to there.

    A node that passes a wheel is put on the straight way to the next one: no bend appears or grows. A bend next to a
    wheel has the energy EI (1 - c)/l, which is bounded, as the way from the wheel turns round where a node flies by.
    """
    w, r = wp.tid()
    x = nodes.x
    v = nodes.v
    h = clock.dt[w]
    stiffness = ropes.bending_stiffness[w % ropes.bending_stiffness.shape[0], r]
    if h <= wp.float64(0.0) or stiffness <= wp.float64(0.0) or nodes.active[w, ropes.first_node[r]] == 0:
        return
    if ropes.curved[r] == 1:
        return
    one = wp.float64(1.0)
    zero = wp.float64(0.0)
    damping = ropes.bending_damping[w % ropes.bending_damping.shape[0], r]
    rest = ropes.segment_length[r]
    order = ropes.first_link[r] + r
    elements = wp.int32(0)  # so far
    i = wp.int32(0)  # the elements before
    j = wp.int32(0)
    t1 = wp.vec3d()
    length1 = -one  # of the segment before, negative where it is not there or runs from wheel to wheel
    share1 = one
    runs1 = wp.int32(0)  # 1 where it is part of a run
    run = Run()
    before = Run()  # that which ends at j
    since = wp.int32(0)  # index of j
    for e in range(state.elements[w, r]):
        k = state.order[w, order + e]
        if k < 0 and is_off(ropes, state, w, ropes.first_wheel[r] - 1 - k):
            continue
        if elements > 0:
            t2 = wp.vec3d()
            length2 = -one
            share2 = one
            runs2 = wp.int32(0)
            if j < 0 or k < 0 or e > since + 1:
                runs2 = 1
                if j >= 0:
                    run = run_from(ropes, state, x, w, r, since)
                share2 = run.share
            if j >= 0 or k >= 0:
                span = span_between(ropes, state, x, w, r, j, k)
                length2 = wp.length(span)
                t2 = span / wp.max(length2, wp.float64(1.0e-12))
                length2 = wp.max(length2, rest * wp.float64(0.1))
            if j >= 0 and length1 > zero and length2 > zero:
                c = wp.dot(t1, t2)
                both = one / length1 + one / length2
                mobility = (
                    lightness(nodes, ropes, w, r, i) / (length1 * length1)
                    + lightness(nodes, ropes, w, r, j) * (both * both)
                    + lightness(nodes, ropes, w, r, k) / (length2 * length2)
                )
                stiff = stiffness * (share1 * share2)
                at_wheel = runs1 + runs2 > 0
                slope = stiff / rest
                if not at_wheel:
                    slope = bend_slope(stiff, rest, c)
                slope = slope * resolved(stiff, rest, wp.where(at_wheel, one, c), mobility, h)
                # Force on the head of each segment: the energy falls as the cosine grows.
                f1 = (t2 - t1 * c) * (slope / length1)
                f2 = (t1 - t2 * c) * (slope / length2)
                if damping > zero:
                    rate = wp.min(stiff * damping / rest, OVERDAMPED / (h * wp.max(mobility, TINY)))
                    u1 = velocity_of(ropes, state, v, w, r, j) - velocity_of(ropes, state, v, w, r, i)
                    u2 = velocity_of(ropes, state, v, w, r, k) - velocity_of(ropes, state, v, w, r, j)
                    torque = damping_torque(rate, t1, t2, u1, u2, length1, length2)
                    f1 = f1 + couple(torque, t1, length1)
                    f2 = f2 - couple(torque, t2, length2)
                push(ropes, state, nodes.f, w, r, i, -f1, h)
                push(ropes, state, nodes.f, w, r, j, f1, h)
                push(ropes, state, nodes.f, w, r, j, -f2, h)
                push(ropes, state, nodes.f, w, r, k, f2, h)
                if runs1 == 1:
                    tighten(ropes, state, nodes, w, r, before, slope * (one - c), h)
                if runs2 == 1:
                    tighten(ropes, state, nodes, w, r, run, slope * (one - c), h)
            t1 = t2
            length1 = length2
            share1 = share2
            runs1 = runs2
        if k >= 0:
            before = run
            since = e
        i = j
        j = k
        elements += 1


@wp.func
def beside(ropes: Ropes, state: RopeState, w: int, r: int, index: int, step: int) -> int:
    """Return the first element from one on that the rope touches."""
    k = state.order[w, ropes.first_link[r] + r + index]
    while k < 0 and is_off(ropes, state, w, ropes.first_wheel[r] - 1 - k):
        index += step
        k = state.order[w, ropes.first_link[r] + r + index]
    return k


@wp.kernel
def bend_clamped_ends(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Add the forces that hold the direction of clamped ends, and the moments on the bodies that hold them."""
    w, r = wp.tid()
    h = clock.dt[w]
    stiffness = ropes.bending_stiffness[w % ropes.bending_stiffness.shape[0], r]
    if h <= wp.float64(0.0) or stiffness <= wp.float64(0.0) or nodes.active[w, ropes.first_node[r]] == 0:
        return
    damping = ropes.bending_damping[w % ropes.bending_damping.shape[0], r]
    cell = wp.float64(0.5) * ropes.segment_length[r]
    for end in range(2):
        if ropes.clamped[r, end] == 0:
            continue
        b = ropes.end_body[r, end]
        held = ropes.end_direction[r, end]
        spin = wp.vec3d()
        if b >= 0 and state.attached[w, r, end] == 0:
            continue
        if b < 0 and nodes.inverse_mass[w % nodes.inverse_mass.shape[0], end_node(ropes, r, end)] > wp.float64(0.0):
            continue  # the world has released it
        if b >= 0:
            held = state.bodies[w, b].rotation * held
            spin = state.bodies[w, b].w
        first = ropes.first_link[r] + r
        tail = state.order[w, first]
        head = beside(ropes, state, w, r, 1, 1)
        if end == 1:
            tail = beside(ropes, state, w, r, state.elements[w, r] - 2, -1)
            head = state.order[w, first + state.elements[w, r] - 1]
        span = span_between(ropes, state, nodes.x, w, r, tail, head)
        length = wp.max(wp.length(span), ropes.segment_length[r] * wp.float64(0.1))
        t = wp.normalize(span)
        c = wp.dot(held, t)
        mobility = (lightness(nodes, ropes, w, r, tail) + lightness(nodes, ropes, w, r, head)) / (length * length)
        force = (held - t * c) * (bend_slope(stiffness, cell, c) * resolved(stiffness, cell, c, mobility, h) / length)
        if damping > wp.float64(0.0):
            apart = velocity_of(ropes, state, nodes.v, w, r, head) - velocity_of(ropes, state, nodes.v, w, r, tail)
            turning = wp.cross(t, apart) / length - (spin - t * wp.dot(t, spin))
            rate = wp.min(stiffness * damping / cell, OVERDAMPED / (h * wp.max(mobility, TINY)))
            force -= couple(turning * rate, t, length)
        push(ropes, state, nodes.f, w, r, tail, -force, h)
        push(ropes, state, nodes.f, w, r, head, force, h)
        if b >= 0:
            twist_body(state.mechanisms, state.bodies, w, b, wp.cross(t, force) * (-length * h))
