"""Twist of ropes whose both ends are clamped.

Twist waves are as fast as sound, so the twist is taken to be in equilibrium: the same everywhere along a rope that has
no curve of its own. Its angle is that from the director of one clamped end, carried along the rope without turning
about it (parallel transport), to the director of the other, counted through full turns. The moment GJ angle / L acts on
the bodies that hold the ends, and on the centreline through the gradient of the angle (Bergou et al. 2008): with
edges e1, e2 at a node and their curvature binormal kappa b, it is kappa b/(2 |e1|) and kappa b/(2 |e2|).
"""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.ends import end_node, twist_body
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.spatial.layout import OPTIONS, Body

wp.set_module_options(OPTIONS)

TURN = wp.constant(wp.float64(6.283185307179586))
FOLDED = wp.constant(wp.float64(-0.999))


@wp.func
def carried(t1: wp.vec3d, t2: wp.vec3d, u: wp.vec3d) -> wp.vec3d:
    """u turned by the least rotation that takes direction t1 into t2."""
    axis = wp.cross(t1, t2)
    cosine = wp.max(wp.dot(t1, t2), FOLDED)
    return u * cosine + wp.cross(axis, u) + axis * (wp.dot(axis, u) / (wp.float64(1.0) + cosine))


@wp.func
def binormal(t1: wp.vec3d, t2: wp.vec3d) -> wp.vec3d:
    """Curvature binormal, of length 2 tan(phi/2)."""
    return wp.cross(t1, t2) * (wp.float64(2.0) / (wp.float64(1.0) + wp.max(wp.dot(t1, t2), FOLDED)))


@wp.func
def end_vector(
    ropes: Ropes, bodies: wp.array2d[Body], w: int, r: int, end: int, vectors: wp.array2d[wp.vec3d]
) -> wp.vec3d:
    """Return a vector kept in the axes of what holds an end, in world axes."""
    b = ropes.end_body[r, end]
    if b < 0:
        return vectors[r, end]
    return bodies[w, b].rotation * vectors[r, end]


@wp.func
def is_clamped(ropes: Ropes, state: RopeState, inverse_mass: wp.array2d[wp.float64], w: int, r: int, end: int) -> bool:
    """Check whether an end's direction is held at this moment."""
    if ropes.clamped[r, end] == 0:
        return False
    if ropes.end_body[r, end] >= 0:
        return state.attached[w, r, end] == 1
    return inverse_mass[w % inverse_mass.shape[0], end_node(ropes, r, end)] <= wp.float64(0.0)


@wp.func
def twist_angle(ropes: Ropes, state: RopeState, x: wp.array2d[wp.vec3d], w: int, r: int) -> wp.float64:
    """Angle from the carried director to that of the far end, nearest to the angle before [rad]."""
    first = ropes.first_node[r]
    t = end_vector(ropes, state.bodies, w, r, 0, ropes.end_direction)
    u = end_vector(ropes, state.bodies, w, r, 0, ropes.end_director)
    for k in range(ropes.nodes[r] - 1):
        following = wp.normalize(x[w, first + k + 1] - x[w, first + k])
        u = carried(t, following, u)
        t = following
    held = end_vector(ropes, state.bodies, w, r, 1, ropes.end_direction)
    u = carried(t, held, u)
    director = end_vector(ropes, state.bodies, w, r, 1, ropes.end_director)
    angle = wp.atan2(wp.dot(held, wp.cross(u, director)), wp.dot(u, director))
    before = state.twist[w, r]
    return angle + TURN * wp.round((before - angle) / TURN)


@wp.kernel
def twist(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Add the forces of the twist of one rope, and its moments on the bodies at its ends."""
    w, r = wp.tid()
    h = clock.dt[w]
    stiffness = ropes.twist_stiffness[w % ropes.twist_stiffness.shape[0], r]
    if (
        h <= wp.float64(0.0)
        or stiffness <= wp.float64(0.0)
        or ropes.wheels[r] > 0
        or nodes.active[w, ropes.first_node[r]] == 0
    ):
        return
    if ropes.curved[r] == 1:
        return
    if not (
        is_clamped(ropes, state, nodes.inverse_mass, w, r, 0) and is_clamped(ropes, state, nodes.inverse_mass, w, r, 1)
    ):
        return
    angle = twist_angle(ropes, state, nodes.x, w, r)
    state.twist[w, r] = angle
    count = ropes.nodes[r] - 1
    moment = stiffness * (angle - ropes.twist_at_start[r]) / (ropes.segment_length[r] * wp.float64(count))
    first = ropes.first_node[r]
    half = wp.float64(0.5) * moment
    start = end_vector(ropes, state.bodies, w, r, 0, ropes.end_direction)
    finish = end_vector(ropes, state.bodies, w, r, 1, ropes.end_direction)
    t = start
    before = wp.vec3d()  # what the node behind an edge gives it
    for k in range(count + 1):
        following = finish
        if k < count:
            following = wp.normalize(nodes.x[w, first + k + 1] - nodes.x[w, first + k])
        bend = binormal(t, following) * half
        if k == 0:
            if ropes.end_body[r, 0] >= 0:
                twist_body(
                    state.mechanisms,
                    state.bodies,
                    w,
                    ropes.end_body[r, 0],
                    (start * moment - wp.cross(start, bend)) * h,
                )
        else:
            length = wp.length(nodes.x[w, first + k] - nodes.x[w, first + k - 1])
            force = (before + bend) / length
            nodes.f[w, first + k] = nodes.f[w, first + k] - force
            nodes.f[w, first + k - 1] = nodes.f[w, first + k - 1] + force
        if k == count and ropes.end_body[r, 1] >= 0:
            twist_body(
                state.mechanisms, state.bodies, w, ropes.end_body[r, 1], -(finish * moment + wp.cross(finish, bend)) * h
            )
        before = bend
        t = following
