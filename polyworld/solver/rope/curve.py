"""Rods that are curved at rest: bending and twist about material frames.

After Bergou et al. (2010, ACM Trans. Graph. 29, 116).

Every segment has a reference direction across it, carried along in time without turning about the segment, and an
angle theta from it to the material's. The curvature binormal, seen in the material frames on both sides of a node, less
that at rest, gives the bending energy; the difference of the angles, with what the reference directions turn from
segment to segment, the twist. Twist waves are as fast as sound: the angles are kept in equilibrium, by one
Gauss-Newton step in every inner step.
"""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.bending import couple, damping_torque
from polyworld.solver.rope.ends import twist_body
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.rope.twist import FOLDED, TURN, binormal, carried, end_vector, is_clamped
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)

# Twist stiffness that a rod has at least, over its bending stiffness: without any, its angles would be undetermined.
LEAST_TWIST = wp.constant(wp.float64(1.0e-3))
LARGEST_STEP = wp.constant(wp.float64(0.5))  # of an angle in one inner step [rad]


@wp.func
def angle_between(t: wp.vec3d, u: wp.vec3d, director: wp.vec3d, before: wp.float64) -> wp.float64:
    """Angle about t from u to a director, nearest to the one before [rad]."""
    angle = wp.atan2(wp.dot(t, wp.cross(u, director)), wp.dot(u, director))
    return angle + TURN * wp.round((before - angle) / TURN)


@wp.func
def material(state: RopeState, w: int, k: int) -> wp.vec3d:
    """First direction of a segment's material frame."""
    t = state.direction[w, k]
    u = state.reference[w, k]
    return u * wp.cos(state.theta[w, k]) + wp.cross(t, u) * wp.sin(state.theta[w, k])


@wp.func
def carry_frames(
    ropes: Ropes, state: RopeState, x: wp.array2d[wp.vec3d], w: int, r: int, start: bool, end: bool
) -> None:
    """Bring the reference directions along with the segments, and see how they turn from one to the next."""
    first = ropes.first_link[r]
    base = ropes.first_node[r]
    count = ropes.nodes[r] - 1
    t = wp.vec3d()
    u = wp.vec3d()
    if start:
        t = end_vector(ropes, state.bodies, w, r, 0, ropes.end_direction)
        u = end_vector(ropes, state.bodies, w, r, 0, ropes.end_director)
    for j in range(count):
        k = first + j
        following = wp.normalize(x[w, base + j + 1] - x[w, base + j])
        d = carried(state.heading[w, k], following, state.reference[w, k])
        d = wp.normalize(d - following * wp.dot(following, d))
        if j > 0 or start:
            state.reference_twist[w, k] = angle_between(
                following, carried(t, following, u), d, state.reference_twist[w, k]
            )
        state.reference[w, k] = d
        state.heading[w, k] = following
        state.direction[w, k] = following
        t = following
        u = d
    if end:
        held = end_vector(ropes, state.bodies, w, r, 1, ropes.end_direction)
        director = end_vector(ropes, state.bodies, w, r, 1, ropes.end_director)
        state.twist[w, r] = angle_between(held, carried(t, held, u), director, state.twist[w, r])


@wp.func
def turn_frames(
    ropes: Ropes,
    state: RopeState,
    w: int,
    r: int,
    bending: wp.float64,
    twisting: wp.float64,
    start: bool,
    end: bool,
) -> None:
    """One Gauss-Newton step of the angles towards equilibrium; the ends' cells have half the length."""
    first = ropes.first_link[r]
    count = ropes.nodes[r] - 1
    half = wp.float64(0.5)
    two = wp.float64(2.0)
    for k in range(first, first + count):
        state.diagonal[w, k] = wp.float64(1.0e-9) * bending
        state.coupled[w, k] = wp.float64(0.0)
        state.right[w, k] = wp.float64(0.0)
    if start:
        state.diagonal[w, first] = two * twisting
        state.right[w, first] = -two * twisting * (state.theta[w, first] + state.reference_twist[w, first])
    for k in range(first + 1, first + count):
        kb = binormal(state.direction[w, k - 1], state.direction[w, k])
        p1 = material(state, w, k - 1)
        q1 = material(state, w, k)
        p2 = wp.cross(state.direction[w, k - 1], p1)
        q2 = wp.cross(state.direction[w, k], q1)
        off1 = half * wp.dot(kb, p2 + q2) - ropes.curvature[k][0]
        off2 = -half * wp.dot(kb, p1 + q1) - ropes.curvature[k][1]
        twist = state.theta[w, k] - state.theta[w, k - 1] + state.reference_twist[w, k]
        a1 = -half * wp.dot(kb, p1)
        a2 = -half * wp.dot(kb, p2)
        b1 = -half * wp.dot(kb, q1)
        b2 = -half * wp.dot(kb, q2)
        state.diagonal[w, k - 1] = state.diagonal[w, k - 1] + bending * (a1 * a1 + a2 * a2) + twisting
        state.diagonal[w, k] = state.diagonal[w, k] + bending * (b1 * b1 + b2 * b2) + twisting
        state.coupled[w, k - 1] = bending * (a1 * b1 + a2 * b2) - twisting
        state.right[w, k - 1] = state.right[w, k - 1] - bending * (off1 * a1 + off2 * a2) + twisting * twist
        state.right[w, k] = state.right[w, k] - bending * (off1 * b1 + off2 * b2) - twisting * twist
    last = first + count - 1
    if end:
        state.diagonal[w, last] = state.diagonal[w, last] + two * twisting
        state.right[w, last] = state.right[w, last] + two * twisting * (
            state.twist[w, r] - ropes.twist_at_start[r] - state.theta[w, last]
        )
    passed = wp.float64(0.0)
    known = wp.float64(0.0)
    lower = wp.float64(0.0)
    for k in range(first, first + count):
        scale = wp.float64(1.0) / (state.diagonal[w, k] - lower * passed)
        passed = state.coupled[w, k] * scale
        known = (state.right[w, k] - lower * known) * scale
        lower = state.coupled[w, k]
        state.forward[w, k] = passed
        state.change[w, k] = known
    known = wp.float64(0.0)
    for j in range(count):
        k = last - j
        known = state.change[w, k] - state.forward[w, k] * known
        state.theta[w, k] = state.theta[w, k] + wp.clamp(known, -LARGEST_STEP, LARGEST_STEP)


@wp.func
def push_edge(f: wp.array2d[wp.vec3d], w: int, tail: int, force: wp.vec3d) -> None:
    """Add a force to the head of a segment, and its opposite to the tail."""
    f[w, tail] = f[w, tail] - force
    f[w, tail + 1] = f[w, tail + 1] + force


@wp.kernel
def bend_curved(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Add bending and twist forces of one rope that is curved at rest."""
    w, r = wp.tid()
    x = nodes.x
    v = nodes.v
    h = clock.dt[w]
    if ropes.curved[r] == 0 or h <= wp.float64(0.0) or nodes.active[w, ropes.first_node[r]] == 0:
        return
    cell = ropes.segment_length[r]
    stiffness = ropes.bending_stiffness[w % ropes.bending_stiffness.shape[0], r]
    damping = stiffness * ropes.bending_damping[w % ropes.bending_damping.shape[0], r] / cell
    bending = stiffness / cell
    twisting = ropes.twist_stiffness[w % ropes.twist_stiffness.shape[0], r] / cell + LEAST_TWIST * bending
    if bending <= wp.float64(0.0):
        return
    start = is_clamped(ropes, state, nodes.inverse_mass, w, r, 0)
    end = is_clamped(ropes, state, nodes.inverse_mass, w, r, 1)
    carry_frames(ropes, state, x, w, r, start, end)
    turn_frames(ropes, state, w, r, bending, twisting, start, end)
    first = ropes.first_link[r]
    base = ropes.first_node[r]
    count = ropes.nodes[r] - 1
    half = wp.float64(0.5)
    one = wp.float64(1.0)
    shortest = wp.float64(0.1) * cell
    if start:
        held = end_vector(ropes, state.bodies, w, r, 0, ropes.end_direction)
        moment = wp.float64(2.0) * twisting * (state.theta[w, first] + state.reference_twist[w, first])
        kb = binormal(held, state.direction[w, first]) * (half * moment)
        push_edge(nodes.f, w, base, -kb / wp.max(wp.length(x[w, base + 1] - x[w, base]), shortest))
        if ropes.end_body[r, 0] >= 0:
            twist_body(
                state.mechanisms, state.bodies, w, ropes.end_body[r, 0], (held * moment - wp.cross(held, kb)) * h
            )
    for j in range(1, count):
        k = first + j
        i = base + j - 1
        t1 = state.direction[w, k - 1]
        t2 = state.direction[w, k]
        length1 = wp.max(wp.length(x[w, i + 1] - x[w, i]), shortest)
        length2 = wp.max(wp.length(x[w, i + 2] - x[w, i + 1]), shortest)
        kb = binormal(t1, t2)
        p = material(state, w, k - 1)
        q = material(state, w, k)
        first_sum = p + q
        second_sum = wp.cross(t1, p) + wp.cross(t2, q)
        kappa1 = half * wp.dot(kb, second_sum)
        kappa2 = -half * wp.dot(kb, first_sum)
        m1 = bending * (kappa1 - ropes.curvature[k][0])
        m2 = bending * (kappa2 - ropes.curvature[k][1])
        moment = twisting * (state.theta[w, k] - state.theta[w, k - 1] + state.reference_twist[w, k])
        scale = one / (one + wp.max(wp.dot(t1, t2), FOLDED))
        along = (t1 + t2) * (scale * (m1 * kappa1 + m2 * kappa2))
        across = (second_sum * m1 - first_sum * m2) * scale
        slope1 = (wp.cross(t2, across) - along + kb * (half * moment)) / length1
        slope2 = (kb * (half * moment) - along - wp.cross(t1, across)) / length2
        if damping > wp.float64(0.0):
            torque = damping_torque(damping, t1, t2, v[w, i + 1] - v[w, i], v[w, i + 2] - v[w, i + 1], length1, length2)
            slope1 = slope1 - couple(torque, t1, length1)
            slope2 = slope2 + couple(torque, t2, length2)
        push_edge(nodes.f, w, i, -slope1)
        push_edge(nodes.f, w, i + 1, -slope2)
    if end:
        k = first + count - 1
        held = end_vector(ropes, state.bodies, w, r, 1, ropes.end_direction)
        moment = wp.float64(2.0) * twisting * (state.twist[w, r] - ropes.twist_at_start[r] - state.theta[w, k])
        kb = binormal(state.direction[w, k], held) * (half * moment)
        i = base + count - 1
        push_edge(nodes.f, w, i, -kb / wp.max(wp.length(x[w, i + 1] - x[w, i]), shortest))
        if ropes.end_body[r, 1] >= 0:
            twist_body(
                state.mechanisms, state.bodies, w, ropes.end_body[r, 1], -(held * moment + wp.cross(held, kb)) * h
            )
