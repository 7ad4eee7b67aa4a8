"""Bodies at the start of a run, under forces alone, and the check for divergence."""

import warp as wp

from polyworld.effects import Motion
from polyworld.solver.core.effect_forces import effect_forces, half_step
from polyworld.solver.spatial.layout import (
    OPTIONS,
    Body,
    Geometry,
    Parameters,
    State,
)
from polyworld.solver.spatial.motion import (
    locked,
    move_freely,
    out_of_bounds,
)

wp.set_module_options(OPTIONS)


@wp.func
def load_bodies(
    geometry: wp.array[Geometry], parameters: wp.array[Parameters], state: wp.array[State], w: int, k: int
) -> None:
    """Row k of the state: the bodies of world w in their initial state; objects start inactive."""
    one = wp.float64(1.0)
    for i in range(state[0].objects):
        b = Body()
        b.x = parameters[0].position[w % parameters[0].position.shape[0], i]
        b.q = wp.normalize(parameters[0].orientation[w % parameters[0].orientation.shape[0], i])
        b.v = parameters[0].velocity[w % parameters[0].velocity.shape[0], i]
        b.w = parameters[0].angular_velocity[w % parameters[0].angular_velocity.shape[0], i]
        b.rotation = wp.quat_to_matrix(b.q)
        b.mass = parameters[0].mass[w % parameters[0].mass.shape[0], i]
        b.inverse_mass = one / b.mass
        b.inertia = geometry[0].inertia[i]
        b.inverse_inertia = geometry[0].inverse_inertia[i]
        b.radius = geometry[0].radius[i]
        spread = wp.max(
            wp.abs(b.inertia[0, 0] - b.inertia[1, 1]) + wp.abs(b.inertia[0, 0] - b.inertia[2, 2]),
            wp.abs(b.inertia[0, 1]) + wp.abs(b.inertia[0, 2]) + wp.abs(b.inertia[1, 2]),
        )
        if spread < wp.float64(1.0e-12) * b.inertia[0, 0]:
            b.isotropic = 1
        if wp.dot(geometry[0].lock, geometry[0].lock) > wp.float64(0.5):
            b = locked(b, geometry[0].lock)
        b.friction = parameters[0].friction[w % parameters[0].friction.shape[0], i]
        b.restitution = parameters[0].restitution[w % parameters[0].restitution.shape[0], i]
        b.rolling = parameters[0].rolling_resistance[w % parameters[0].rolling_resistance.shape[0], i]
        b.torsion = parameters[0].torsional_radius[w % parameters[0].torsional_radius.shape[0], i]
        b.linear_damping = parameters[0].linear_damping[w % parameters[0].linear_damping.shape[0], i]
        b.angular_damping = parameters[0].angular_damping[w % parameters[0].angular_damping.shape[0], i]
        state[0].bodies[k, i] = b
        state[0].reaction[k, i] = wp.vec3d()
        state[0].reaction_turning[k, i] = wp.vec3d()
    for s in range(state[0].statics):
        b = Body()
        b.x = parameters[0].static_position[w % parameters[0].static_position.shape[0], s]
        b.q = parameters[0].static_orientation[w % parameters[0].static_orientation.shape[0], s]
        state[0].planes[k, s] = parameters[0].static_plane[w % parameters[0].static_plane.shape[0], s]
        b.rotation = wp.quat_to_matrix(b.q)
        b.friction = parameters[0].static_friction[w % parameters[0].static_friction.shape[0], s]
        b.restitution = parameters[0].static_restitution[w % parameters[0].static_restitution.shape[0], s]
        b.isotropic = 1
        b.active = 1
        state[0].bodies[k, state[0].objects + s] = b
    world = Body()
    world.q = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), one)
    world.rotation = wp.quat_to_matrix(world.q)
    world.isotropic = 1
    world.active = 1
    state[0].bodies[k, state[0].objects + state[0].statics] = world
    state[0].manifold_count[k, 0] = 0
    state[0].manifold_count[k, 1] = 0
    state[0].contact_count[k, 0] = 0
    state[0].contact_count[k, 1] = 0
    state[0].overflowed[k] = 0
    state[0].skin[k] = wp.float64(0.0)


@wp.func
def sweep_bodies(geometry: wp.array[Geometry], state: wp.array[State], k: int, fall: wp.float64, h: wp.float64) -> None:
    """Bound how far any point of each body may move within h."""
    for i in range(state[0].objects):
        state[0].bodies[k, i].swept = h * (
            wp.length(state[0].bodies[k, i].v) + wp.length(state[0].bodies[k, i].w) * geometry[0].bound[i] + fall
        )


@wp.func
def touches(state: wp.array[State], k: int, half: int, i: int, slowest: wp.float64) -> wp.float64:
    """1 where body i touches another that it does not part from faster than `slowest` [m/s], else 0."""
    base = half * state[0].max_manifolds
    for m in range(base, base + state[0].manifold_count[k, half]):
        if state[0].manifolds[k, m].a == i or state[0].manifolds[k, m].b == i:
            first = state[0].manifolds[k, m].first
            for c in range(first, first + state[0].manifolds[k, m].count):
                if (
                    state[0].contacts[k, c].gap <= state[0].manifolds[k, m].close
                    and state[0].contacts[k, c].speed <= slowest
                ):
                    return wp.float64(1.0)
    return wp.float64(0.0)


@wp.func
def turning_of(b: Body, torque: wp.vec3d) -> wp.vec3d:
    """Angular acceleration, world axes: Euler's equations [rad/s^2]."""
    if b.isotropic == 1:
        return b.inverse_inertia * torque * b.inverse_mass - b.w * b.angular_damping
    w = wp.transpose(b.rotation) * b.w
    spinning = wp.cross(b.inertia * w, w) + wp.transpose(b.rotation) * torque * b.inverse_mass
    return b.rotation * (b.inverse_inertia * spinning) - b.w * b.angular_damping


@wp.func
def effects_on(
    geometry: wp.array[Geometry],
    parameters: wp.array[Parameters],
    state: wp.array[State],
    w: int,
    k: int,
    i: int,
    half: int,
    slowest: wp.float64,
    gravity: wp.vec3d,
    time: wp.float64,
    h: wp.float64,
) -> wp.spatial_vectord:
    """Force and torque of the effects on body i at the middle of a step of length h: the midpoint rule, second order.

    What contacts and joints will do until then is what they did in the last step.
    """
    b = state[0].bodies[k, i]
    until = wp.float64(0.5) * h
    motion = Motion()
    motion.mass = b.mass
    motion.radius = b.radius
    motion.x = b.x
    motion.v = b.v
    motion.omega = b.w
    origin = parameters[0].time_origin[w % parameters[0].time_origin.shape[0]]
    motion.t = origin + time
    motion.contact = touches(state, k, half, i, slowest)
    motion.gravity = gravity
    total = wp.spatial_vectord()
    for _pass in range(2):
        if _pass == 1:
            force = wp.spatial_top(total) + b.push
            torque = wp.spatial_bottom(total) + b.push_torque
            a = gravity + force * b.inverse_mass - b.v * b.linear_damping + state[0].reaction[k, i]
            a = a - geometry[0].lock * wp.dot(geometry[0].lock, a)
            x, v = half_step(b.x, b.v, a, until)
            motion.x = x
            motion.v = v
            motion.omega = b.w + (turning_of(b, torque) + state[0].reaction_turning[k, i]) * until
            motion.t = origin + time + until
        total = effect_forces(parameters[0].effects, w, i, motion)
    return total


@wp.func
def predict(
    geometry: wp.array[Geometry],
    parameters: wp.array[Parameters],
    state: wp.array[State],
    w: int,
    k: int,
    half: int,
    slowest: wp.float64,
    gravity: wp.vec3d,
    time: wp.float64,
    h: wp.float64,
) -> None:
    """Free motion of all bodies over h; effects act with their values at the middle of the step.

    Bodies that part faster than `slowest` [m/s] do not touch.
    """
    lock = geometry[0].lock
    for i in range(state[0].objects):
        if state[0].bodies[k, i].active == 0:
            continue
        force = state[0].bodies[k, i].push
        torque = state[0].bodies[k, i].push_torque
        if parameters[0].forces > 0:
            wrench = effects_on(geometry, parameters, state, w, k, i, half, slowest, gravity, time, h)
            force += wp.spatial_top(wrench)
            torque += wp.spatial_bottom(wrench)
        if wp.dot(lock, lock) > wp.float64(0.5):
            state[0].bodies[k, i].v -= lock * wp.dot(lock, state[0].bodies[k, i].v)
            state[0].bodies[k, i].w = lock * wp.dot(lock, state[0].bodies[k, i].w)
            force -= lock * (wp.dot(lock, force) + wp.dot(lock, gravity) * state[0].bodies[k, i].mass)
        move_freely(state[0].bodies, k, i, force, torque, gravity, h)


@wp.func
def note_reactions(state: wp.array[State], k: int, h: wp.float64) -> None:
    """Keep what contacts and joints did to the bodies in a step of length h for the next."""
    rate = wp.float64(1.0) / h
    for i in range(state[0].objects):
        if state[0].bodies[k, i].active == 1:
            state[0].reaction[k, i] = (state[0].bodies[k, i].v - state[0].bodies[k, i].v_free) * rate
            state[0].reaction_turning[k, i] = (state[0].bodies[k, i].w - state[0].bodies[k, i].w_free) * rate


@wp.func
def first_diverged(state: wp.array[State], k: int) -> int:
    """Index of the first object whose state cannot be trusted, -1 for none."""
    for i in range(state[0].objects):
        if out_of_bounds(state[0].bodies, k, i):
            return i
    return -1
