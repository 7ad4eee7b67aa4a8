"""Bending of ropes: discrete curvature at the nodes, a half cell at clamped ends.

The curvature binormal of Bergou et al. (2008, ACM Trans. Graph. 27, 63) has the length 2 tan(phi/2), phi being the
angle between two segments. The energy EI |kappa b|^2 / (2 l) depends on c = cos(phi) alone, since |kappa b|^2 =
4 (1 - c)/(1 + c). At a clamped end the first segment is bent against the held direction over a cell of length l/2.
"""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.ends import end_node, twist_body
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)

SHARPEST = wp.constant(wp.float64(-0.999))  # cosine at which a fold counts as complete
STRAIGHT = wp.constant(wp.float64(4.0e-4))  # |kappa b|^2 below which a bend has no plane of its own


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


@wp.kernel
def bend(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Add bending forces of one rope; segments next to a wheel bend freely."""
    w, r = wp.tid()
    x = nodes.x
    v = nodes.v
    f = nodes.f
    h = clock.dt[w]
    stiffness = ropes.bending_stiffness[w % ropes.bending_stiffness.shape[0], r]
    if h <= wp.float64(0.0) or stiffness <= wp.float64(0.0) or nodes.active[w, ropes.first_node[r]] == 0:
        return
    if ropes.curved[r] == 1:
        return
    damping = ropes.bending_damping[w % ropes.bending_damping.shape[0], r]
    rest = ropes.segment_length[r]
    shortest = rest * wp.float64(0.1)
    base = ropes.first_node[r]
    order = ropes.first_link[r] + r
    i = wp.int32(-1)  # the nodes before
    j = wp.int32(-1)
    t1 = wp.vec3d()
    length1 = wp.float64(0.0)
    for e in range(state.elements[w, r]):
        k = state.order[w, order + e]
        if k < 0:
            i = -1
            j = -1
            continue
        k = base + k
        if j >= 0:
            span = x[w, k] - x[w, j]
            length2 = wp.length(span)
            t2 = span / wp.max(length2, wp.float64(1.0e-12))
            length2 = wp.max(length2, shortest)
            if i >= 0:
                c = wp.dot(t1, t2)
                slope = bend_slope(stiffness, rest, c)
                # Force on the head of each segment: the energy falls as the cosine grows.
                f1 = (t2 - t1 * c) * (slope / length1)
                f2 = (t1 - t2 * c) * (slope / length2)
                if damping > wp.float64(0.0):
                    torque = damping_torque(
                        stiffness * damping / rest, t1, t2, v[w, j] - v[w, i], v[w, k] - v[w, j], length1, length2
                    )
                    f1 = f1 + couple(torque, t1, length1)
                    f2 = f2 - couple(torque, t2, length2)
                f[w, i] = f[w, i] - f1
                f[w, j] = f[w, j] + f1 - f2
                f[w, k] = f[w, k] + f2
            t1 = t2
            length1 = length2
        i = j
        j = k


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
        head = state.order[w, first + 1]
        if end == 1:
            tail = state.order[w, first + state.elements[w, r] - 2]
            head = state.order[w, first + state.elements[w, r] - 1]
        if tail < 0 or head < 0:
            continue
        i = ropes.first_node[r] + tail
        j = ropes.first_node[r] + head
        span = nodes.x[w, j] - nodes.x[w, i]
        length = wp.max(wp.length(span), ropes.segment_length[r] * wp.float64(0.1))
        t = wp.normalize(span)
        c = wp.dot(held, t)
        force = (held - t * c) * (bend_slope(stiffness, cell, c) / length)
        if damping > wp.float64(0.0):
            turning = wp.cross(t, nodes.v[w, j] - nodes.v[w, i]) / length - (spin - t * wp.dot(t, spin))
            force -= couple(turning * (stiffness * damping / cell), t, length)
        nodes.f[w, i] = nodes.f[w, i] - force
        nodes.f[w, j] = nodes.f[w, j] + force
        if b >= 0:
            twist_body(state.mechanisms, state.bodies, w, b, wp.cross(t, force) * (-length * h))
