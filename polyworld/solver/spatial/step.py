"""Bodies at the start of a run, under forces alone, and where they are lost."""

import warp as wp

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
    for s in range(state.statics):
        b = Body()
        b.x = geometry.fixed_position[s]
        b.q = geometry.fixed_orientation[s]
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
def predict(
    geometry: Geometry,
    parameters: Parameters,
    state: State,
    w: int,
    k: int,
    gravity: wp.vec3d,
    time: wp.float64,
    h: wp.float64,
) -> None:
    """Free motion of all bodies over h; effects act with their values at the middle of the step."""
    half = wp.float64(0.5) * h
    lock = geometry.lock
    for i in range(state.objects):
        b = state.bodies[k, i]
        if b.active == 0:
            continue
        force = wp.vec3d()
        torque = wp.vec3d()
        if parameters.effect_kind.shape[0] > 0:
            for _pass in range(2):
                v = b.v + (gravity + force * b.inverse_mass) * half
                x = b.x + (b.v + v) * (wp.float64(0.5) * half)
                if _pass == 0:
                    v = b.v
                    x = b.x
                wrench = effect_forces(
                    parameters.effect_kind,
                    parameters.effect_acts,
                    parameters.effect_parameters,
                    w,
                    i,
                    b.mass,
                    b.radius,
                    x,
                    v,
                    b.w,
                    time + half,
                )
                force = wp.spatial_top(wrench)
                torque = wp.spatial_bottom(wrench)
        force += b.push
        torque += b.push_torque
        if wp.dot(lock, lock) > wp.float64(0.5):
            b.v -= lock * wp.dot(lock, b.v)
            b.w = lock * wp.dot(lock, b.w)
            force -= lock * (wp.dot(lock, force) + wp.dot(lock, gravity) * b.mass)
        state.bodies[k, i] = move_freely(b, force, torque, gravity, h)


@wp.func
def first_diverged(state: State, k: int) -> int:
    """Index of the first object whose state cannot be trusted, -1 for none."""
    for i in range(state.objects):
        if out_of_bounds(state.bodies[k, i]):
            return i
    return -1
