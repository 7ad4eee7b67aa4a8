"""Bending of ropes: discrete curvature at the nodes, a half cell at clamped ends.

The curvature binormal of Bergou et al. (2008, ACM Trans. Graph. 27, 63) has the length 2 tan(phi/2), phi being the
angle between two segments. The energy EI |kappa b|^2 / (2 l) depends on c = cos(phi) alone, since |kappa b|^2 =
4 (1 - c)/(1 + c). At a clamped end the first segment is bent against the held direction over a cell of length l/2.
"""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.ends import end_node, point_velocity, push_body, twist_body
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.rope.wheels import BEYOND, is_off, on_wheel, rim_point, wheel_centre
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
class Segment:
    """A straight part of a rope at a bend.

    t: direction. length: for levers [m], negative where it runs from wheel to wheel. share: of a bend with it that
    counts, 1 but for slack rope next to a wheel; slackening: gradient of that at its head, negated [1/m]. material:
    its rest length.
    """

    t: wp.vec3d
    length: wp.float64
    share: wp.float64
    slackening: wp.vec3d
    material: wp.float64
    slack: int
    at_wheel: int  # 1 where it begins or ends at a wheel, or runs past one


@wp.func
def segment_between(
    ropes: Ropes,
    state: RopeState,
    x: wp.array2d[wp.vec3d],
    w: int,
    r: int,
    a: int,
    b: int,
    material: wp.float64,
    loose: int,
) -> Segment:
    """Return the segment from an element to the next.

    loose: 1 where it runs past a wheel that it has come off. Slack rope next to a wheel is not straight: the less so,
    the shorter the way is, q, over the rope along it. Bends with it count by q^4.
    """
    s = Segment()
    s.length = wp.float64(-1.0)
    s.share = wp.float64(1.0)
    if a < 0 and b < 0:
        return s
    cell = ropes.segment_length[r]
    span = span_between(ropes, state, x, w, r, a, b)
    length = wp.length(span)
    s.t = span / wp.max(length, wp.float64(1.0e-12))
    if a >= 0 and b >= 0 and loose == 0:
        s.length = wp.max(length, cell * wp.float64(0.1))
        return s
    s.at_wheel = 1
    s.length = wp.max(length, cell * wp.float64(1.0e-3))
    if loose == 0:
        material -= wp.float64(0.5) * on_wheel(ropes, state, w, ropes.first_wheel[r] - 1 - wp.min(a, b))
    s.material = wp.max(material, BEYOND * cell)
    q = length / s.material
    if q < wp.float64(1.0):
        one = wp.float64(1.0)
        s.slack = 1
        s.share = q * q * q * q
        gradient = s.t
        if loose == 0:
            # The point where the rope touches the wheel moves with the node, and takes rope along.
            node = wp.max(a, b)
            p = ropes.first_wheel[r] - 1 - wp.min(a, b)
            out = (x[w, ropes.first_node[r] + node] - wheel_centre(ropes, state, w, p)) / s.length
            if b < 0:
                out = -out
            gradient = gradient * q + out * (one - q)
        s.slackening = gradient * (wp.float64(-4.0) * q * q * q / s.material)
    return s


@wp.func
def push_flow(
    ropes: Ropes,
    state: RopeState,
    w: int,
    r: int,
    i: int,
    k: int,
    first: Segment,
    second: Segment,
    energy: wp.float64,
) -> None:
    """Add the force on the flow of rope over the wheels next to a bend: slack that flows in straightens it [N]."""
    four = wp.float64(4.0)
    if i < 0 and first.slack == 1:
        p = ropes.first_wheel[r] - 1 - i
        state.wheels[w, p].push = state.wheels[w, p].push + four * energy / first.material
    if k < 0 and second.slack == 1:
        p = ropes.first_wheel[r] - 1 - k
        state.wheels[w, p].push = state.wheels[w, p].push - four * energy / second.material


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
    for p in range(ropes.first_wheel[r], ropes.first_wheel[r] + ropes.wheels[r]):
        state.wheels[w, p].push = wp.float64(0.0)
    one = wp.float64(1.0)
    damping = ropes.bending_damping[w % ropes.bending_damping.shape[0], r]
    rest = ropes.segment_length[r]
    order = ropes.first_link[r] + r
    elements = wp.int32(0)  # so far
    i = wp.int32(0)  # the elements before
    j = wp.int32(0)
    first = Segment()  # the two at j
    second = Segment()
    material = wp.float64(0.0)  # rest length since j
    loose = wp.int32(0)  # 1 where a wheel that the rope has come off lies there
    for e in range(state.elements[w, r]):
        k = state.order[w, order + e]
        if e > 0:
            material += state.rest[w, ropes.first_link[r] + e - 1]
        if k < 0 and is_off(ropes, state, w, ropes.first_wheel[r] - 1 - k):
            loose = 1
            continue
        if elements > 0:
            second = segment_between(ropes, state, x, w, r, j, k, material, loose)
            if j >= 0 and first.length > wp.float64(0.0) and second.length > wp.float64(0.0):
                c = wp.dot(first.t, second.t)
                both = one / first.length + one / second.length
                mobility = (
                    lightness(nodes, ropes, w, r, i) / (first.length * first.length)
                    + lightness(nodes, ropes, w, r, j) * (both * both)
                    + lightness(nodes, ropes, w, r, k) / (second.length * second.length)
                )
                at_wheel = first.at_wheel + second.at_wheel > 0
                stiff = stiffness * (first.share * second.share)
                slope = stiff / rest
                if not at_wheel:
                    slope = bend_slope(stiff, rest, c)
                slope = slope * resolved(stiff, rest, wp.where(at_wheel, one, c), mobility, h)
                # Force on the head of each segment: the energy falls as the cosine grows.
                f1 = (second.t - first.t * c) * (slope / first.length)
                f2 = (first.t - second.t * c) * (slope / second.length)
                if damping > wp.float64(0.0):
                    rate = wp.min(stiff * damping / rest, OVERDAMPED / (h * wp.max(mobility, TINY)))
                    u1 = velocity_of(ropes, state, v, w, r, j) - velocity_of(ropes, state, v, w, r, i)
                    u2 = velocity_of(ropes, state, v, w, r, k) - velocity_of(ropes, state, v, w, r, j)
                    torque = damping_torque(rate, first.t, second.t, u1, u2, first.length, second.length)
                    f1 = f1 + couple(torque, first.t, first.length)
                    f2 = f2 - couple(torque, second.t, second.length)
                if at_wheel:
                    energy = slope * (one - c)
                    f1 = f1 + first.slackening * (energy / wp.max(first.share, TINY))
                    f2 = f2 + second.slackening * (energy / wp.max(second.share, TINY))
                    push_flow(ropes, state, w, r, i, k, first, second, energy)
                push(ropes, state, nodes.f, w, r, i, -f1, h)
                push(ropes, state, nodes.f, w, r, j, f1, h)
                push(ropes, state, nodes.f, w, r, j, -f2, h)
                push(ropes, state, nodes.f, w, r, k, f2, h)
            first = second
        i = j
        j = k
        elements += 1
        material = wp.float64(0.0)
        loose = 0


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
