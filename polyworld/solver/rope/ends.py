"""Ends of ropes that rigid bodies hold: an end node and the body's point move as one."""

import warp as wp

from polyworld.solver.coupled.mechanism import Mechanisms, point_response, push_mechanism
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.spatial.layout import OPTIONS, Body

wp.set_module_options(OPTIONS)


@wp.func
def body_inverse_inertia(bodies: wp.array2d[Body], w: int, b: int) -> wp.mat33d:
    """Inverse inertia about the centre of mass, world axes [1/(kg m^2)]."""
    rotation = bodies[w, b].rotation
    return rotation * bodies[w, b].inverse_inertia * wp.transpose(rotation) * bodies[w, b].inverse_mass


@wp.func
def point_mobility(m: Mechanisms, bodies: wp.array2d[Body], w: int, b: int, arm: wp.vec3d) -> wp.mat33d:
    """Velocity per impulse of the body's point at `arm` from its centre of mass [1/kg]."""
    if bodies[w, b].active == 0:
        return wp.mat33d()
    if m.first[b] >= 0:
        return point_response(m, w, b, arm)
    light = bodies[w, b].inverse_mass
    zero = wp.float64(0.0)
    return wp.mat33d(light, zero, zero, zero, light, zero, zero, zero, light) - wp.skew(arm) * body_inverse_inertia(
        bodies, w, b
    ) * wp.skew(arm)


@wp.func
def point_velocity(bodies: wp.array2d[Body], w: int, b: int, arm: wp.vec3d) -> wp.vec3d:
    """Velocity of the body's point at `arm` from its centre of mass."""
    return bodies[w, b].v + wp.cross(bodies[w, b].w, arm)


@wp.func
def push_body(m: Mechanisms, bodies: wp.array2d[Body], w: int, b: int, arm: wp.vec3d, impulse: wp.vec3d) -> None:
    """Apply an impulse at `arm` from the centre of mass."""
    if bodies[w, b].active == 0:
        return
    if m.first[b] >= 0:
        push_mechanism(m, bodies, w, b, impulse, wp.cross(arm, impulse))
        return
    bodies[w, b].v = bodies[w, b].v + impulse * bodies[w, b].inverse_mass
    bodies[w, b].w = bodies[w, b].w + body_inverse_inertia(bodies, w, b) * wp.cross(arm, impulse)


@wp.func
def twist_body(m: Mechanisms, bodies: wp.array2d[Body], w: int, b: int, angular_impulse: wp.vec3d) -> None:
    """Apply an angular impulse."""
    if bodies[w, b].active == 1 and m.first[b] >= 0:
        push_mechanism(m, bodies, w, b, wp.vec3d(), angular_impulse)
    elif bodies[w, b].active == 1:
        bodies[w, b].w = bodies[w, b].w + body_inverse_inertia(bodies, w, b) * angular_impulse


@wp.func
def end_arm(ropes: Ropes, bodies: wp.array2d[Body], w: int, r: int, end: int) -> wp.vec3d:
    """Return the moment arm from the centre of mass of the body that holds an end to the point where it does."""
    return bodies[w, ropes.end_body[r, end]].rotation * ropes.end_anchor[r, end]


@wp.func
def end_node(ropes: Ropes, r: int, end: int) -> int:
    return ropes.first_node[r] + end * (ropes.nodes[r] - 1)


@wp.func
def prepare_end(
    ropes: Ropes, state: RopeState, inverse_mass: wp.array2d[wp.float64], half_fall: wp.vec3d, w: int, r: int, end: int
) -> None:
    """Mobility of an end node: alone, or together with the body whose point it is; how its motion lags its velocity.

    A node of mass m on a point of mobility K moves with K (1 + m K)^-1, and the body takes (1 + m K)^-1 of the
    impulse.
    """
    share = inverse_mass[w % inverse_mass.shape[0], end_node(ropes, r, end)]
    zero = wp.float64(0.0)
    unit = wp.mat33d(wp.float64(1.0), zero, zero, zero, wp.float64(1.0), zero, zero, zero, wp.float64(1.0))
    if state.attached[w, r, end] == 0 or share <= zero:
        state.end_mobility[w, r, end] = unit * share
        state.end_lag[w, r, end] = wp.vec3d()
        if share > zero:
            state.end_lag[w, r, end] = half_fall
        return
    b = ropes.end_body[r, end]
    state.end_lag[w, r, end] = (state.bodies[w, b].v - state.end_kept[w, r, end]) * wp.float64(0.5)
    mobility = (
        point_mobility(state.mechanisms, state.bodies, w, b, end_arm(ropes, state.bodies, w, r, end))
        * ropes.end_share[r, end]
    )
    split = wp.inverse(unit + mobility * (wp.float64(1.0) / share))
    state.end_split[w, r, end] = split
    state.end_mobility[w, r, end] = mobility * split


@wp.func
def join_end(ropes: Ropes, state: RopeState, nodes: Nodes, w: int, r: int, end: int) -> None:
    """Give the end node and the body's point one velocity, by equal and opposite impulses."""
    i = end_node(ropes, r, end)
    share = nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i]
    if state.attached[w, r, end] == 0 or share <= wp.float64(0.0):
        return
    b = ropes.end_body[r, end]
    arm = end_arm(ropes, state.bodies, w, r, end)
    apart = point_velocity(state.bodies, w, b, arm) - nodes.v[w, i]
    impulse = state.end_split[w, r, end] * apart * (wp.float64(1.0) / share)
    nodes.v[w, i] = nodes.v[w, i] + impulse * share
    push_body(state.mechanisms, state.bodies, w, b, arm, -impulse)


@wp.func
def push_end(
    ropes: Ropes, state: RopeState, v: wp.array2d[wp.vec3d], w: int, r: int, end: int, impulse: wp.vec3d
) -> None:
    """Apply an impulse to an end node, and to the body that holds it."""
    i = end_node(ropes, r, end)
    v[w, i] = v[w, i] + state.end_mobility[w, r, end] * impulse
    if state.attached[w, r, end] == 1:
        b = ropes.end_body[r, end]
        push_body(
            state.mechanisms,
            state.bodies,
            w,
            b,
            end_arm(ropes, state.bodies, w, r, end),
            state.end_split[w, r, end] * impulse,
        )


@wp.kernel
def hold_ends(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Free the released ends, put the others where their bodies are, and store the bodies' velocities."""
    w, r = wp.tid()
    if clock.dt[w] <= wp.float64(0.0) or nodes.active[w, ropes.first_node[r]] == 0:
        return
    for end in range(2):
        if state.attached[w, r, end] == 1:
            k = ropes.first_link[r] + end * (state.elements[w, r] - 2)
            if clock.time[w] >= ropes.end_release[r, end] or state.tension[w, k] > ropes.end_strength[r, end]:
                state.attached[w, r, end] = 0
            else:
                b = ropes.end_body[r, end]
                state.end_kept[w, r, end] = state.bodies[w, b].v
                nodes.x[w, end_node(ropes, r, end)] = state.bodies[w, b].x + end_arm(ropes, state.bodies, w, r, end)
    for p in range(ropes.first_wheel[r], ropes.first_wheel[r] + ropes.wheels[r]):
        if ropes.wheel_body[p] >= 0:
            state.wheels[w, p].kept = state.bodies[w, ropes.wheel_body[p]].v
