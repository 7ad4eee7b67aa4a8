"""Bodies at the start of a run, under forces alone, and where they are lost."""

import warp as wp

from polyworld.effects import Motion
from polyworld.solver.effect_forces import effect_forces
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
def load_bodies(geometry: Geometry, parameters: Parameters, state: State, w: int, k: int) -> None:
    """Row k of the state: the bodies of world w in their initial state; objects start inactive."""
    one = wp.float64(1.0)
    for i in range(state.objects):
        b = Body()
        b.x = parameters.position[w % parameters.position.shape[0], i]
        b.q = wp.normalize(parameters.orientation[w % parameters.orientation.shape[0], i])
        b.v = parameters.velocity[w % parameters.velocity.shape[0], i]
        b.w = parameters.angular_velocity[w % parameters.angular_velocity.shape[0], i]
        b.rotation = wp.quat_to_matrix(b.q)
        b.mass = parameters.mass[w % parameters.mass.shape[0], i]
        b.inverse_mass = one / b.mass
        b.inertia = geometry.inertia[i]
        b.inverse_inertia = geometry.inverse_inertia[i]
        b.radius = geometry.radius[i]
        spread = wp.max(
            wp.abs(b.inertia[0, 0] - b.inertia[1, 1]) + wp.abs(b.inertia[0, 0] - b.inertia[2, 2]),
            wp.abs(b.inertia[0, 1]) + wp.abs(b.inertia[0, 2]) + wp.abs(b.inertia[1, 2]),
        )
        if spread < wp.float64(1.0e-12) * b.inertia[0, 0]:
            b.isotropic = 1
        if wp.dot(geometry.lock, geometry.lock) > wp.float64(0.5):
            b = locked(b, geometry.lock)
        b.friction = parameters.friction[w % parameters.friction.shape[0], i]
        b.restitution = parameters.restitution[w % parameters.restitution.shape[0], i]
        b.rolling = parameters.rolling_resistance[w % parameters.rolling_resistance.shape[0], i]
        b.torsion = parameters.torsional_radius[w % parameters.torsional_radius.shape[0], i]
        b.linear_damping = parameters.linear_damping[w % parameters.linear_damping.shape[0], i]
        b.angular_damping = parameters.angular_damping[w % parameters.angular_damping.shape[0], i]
        state.bodies[k, i] = b
        state.reaction[k, i] = wp.vec3d()
        state.reaction_turning[k, i] = wp.vec3d()
    for s in range(state.statics):
        b = Body()
        b.x = parameters.static_position[w % parameters.static_position.shape[0], s]
        b.q = parameters.static_orientation[w % parameters.static_orientation.shape[0], s]
        state.planes[k, s] = parameters.static_plane[w % parameters.static_plane.shape[0], s]
        b.rotation = wp.quat_to_matrix(b.q)
        b.friction = parameters.static_friction[w % parameters.static_friction.shape[0], s]
        b.restitution = parameters.static_restitution[w % parameters.static_restitution.shape[0], s]
        b.isotropic = 1
        b.active = 1
        state.bodies[k, state.objects + s] = b
    world = Body()
    world.q = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), one)
    world.rotation = wp.quat_to_matrix(world.q)
    world.isotropic = 1
    world.active = 1
    state.bodies[k, state.objects + state.statics] = world
    state.manifold_count[k, 0] = 0
    state.manifold_count[k, 1] = 0
    state.contact_count[k, 0] = 0
    state.contact_count[k, 1] = 0
    state.crowded[k] = 0


@wp.func
def sweep_bodies(geometry: Geometry, state: State, k: int, fall: wp.float64, h: wp.float64) -> None:
    """How far any point of each body may move within h."""
    for i in range(state.objects):
        state.bodies[k, i].swept = h * (
            wp.length(state.bodies[k, i].v) + wp.length(state.bodies[k, i].w) * geometry.bound[i] + fall
        )


@wp.func
def touches(state: State, k: int, half: int, i: int, slowest: wp.float64) -> wp.float64:
    """1 where body i touches another that it does not part from faster than `slowest` [m/s], else 0."""
    base = half * state.max_manifolds
    for m in range(base, base + state.manifold_count[k, half]):
        if state.manifolds[k, m].a == i or state.manifolds[k, m].b == i:
            first = state.manifolds[k, m].first
            for c in range(first, first + state.manifolds[k, m].count):
                if state.contacts[k, c].gap <= state.manifolds[k, m].close and state.contacts[k, c].speed <= slowest:
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
    geometry: Geometry,
    parameters: Parameters,
    state: State,
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
    b = state.bodies[k, i]
    until = wp.float64(0.5) * h
    motion = Motion()
    motion.mass = b.mass
    motion.radius = b.radius
    motion.x = b.x
    motion.v = b.v
    motion.omega = b.w
    origin = parameters.time_origin[w % parameters.time_origin.shape[0]]
    motion.t = origin + time
    motion.contact = touches(state, k, half, i, slowest)
    motion.gravity = gravity
    kinds = parameters.effect_kind
    acts = parameters.effect_acts
    values = parameters.effect_parameters
    programs = parameters.effect_programs
    total = wp.spatial_vectord()
    for _pass in range(2):
        if _pass == 1:
            force = wp.spatial_top(total) + b.push
            torque = wp.spatial_bottom(total) + b.push_torque
            a = gravity + force * b.inverse_mass - b.v * b.linear_damping + state.reaction[k, i]
            a = a - geometry.lock * wp.dot(geometry.lock, a)
            motion.v = b.v + a * until
            motion.x = b.x + (b.v + motion.v) * (wp.float64(0.5) * until)
            motion.omega = b.w + (turning_of(b, torque) + state.reaction_turning[k, i]) * until
            motion.t = origin + time + until
        total = effect_forces(kinds, acts, values, programs, w, i, motion)
    return total


@wp.func
def predict(
    geometry: Geometry,
    parameters: Parameters,
    state: State,
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
    lock = geometry.lock
    for i in range(state.objects):
        b = state.bodies[k, i]
        if b.active == 0:
            continue
        force = b.push
        torque = b.push_torque
        if parameters.effect_kind.shape[0] > 0:
            wrench = effects_on(geometry, parameters, state, w, k, i, half, slowest, gravity, time, h)
            force += wp.spatial_top(wrench)
            torque += wp.spatial_bottom(wrench)
        if wp.dot(lock, lock) > wp.float64(0.5):
            b.v -= lock * wp.dot(lock, b.v)
            b.w = lock * wp.dot(lock, b.w)
            force -= lock * (wp.dot(lock, force) + wp.dot(lock, gravity) * b.mass)
        state.bodies[k, i] = move_freely(b, force, torque, gravity, h)


@wp.func
def note_reactions(state: State, k: int, h: wp.float64) -> None:
    """Keep what contacts and joints did to the bodies in a step of length h for the next."""
    rate = wp.float64(1.0) / h
    for i in range(state.objects):
        if state.bodies[k, i].active == 1:
            state.reaction[k, i] = (state.bodies[k, i].v - state.bodies[k, i].v_free) * rate
            state.reaction_turning[k, i] = (state.bodies[k, i].w - state.bodies[k, i].w_free) * rate


@wp.func
def first_diverged(state: State, k: int) -> int:
    """Index of the first object whose state cannot be trusted, -1 for none."""
    for i in range(state.objects):
        if out_of_bounds(state.bodies[k, i]):
            return i
    return -1
