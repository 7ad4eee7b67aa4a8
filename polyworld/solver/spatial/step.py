"""The kernel: one thread a world, the time loop inside, each stage a function of its own module."""

import warp as wp

from polyworld.solver.effect_forces import effect_forces
from polyworld.solver.spatial.constraints import (
    aim_contacts,
    build_rows,
    note_forces,
    separate_overlaps,
    solve_contacts,
)
from polyworld.solver.spatial.contacts import find_contacts
from polyworld.solver.spatial.episodes import record_contacts
from polyworld.solver.spatial.impacts import resolve_impacts, time_to_impact
from polyworld.solver.spatial.joint_axes import time_to_stop
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.joint_step import (
    begin_joints,
    finish_joints,
    load_joints,
    longest_part,
    settle_joints,
    solve_joints,
)
from polyworld.solver.spatial.layout import (
    OPTIONS,
    Body,
    Geometry,
    Log,
    Parameters,
    Samples,
    Schedule,
    State,
)
from polyworld.solver.spatial.motion import (
    FASTEST,
    end_orientation,
    end_position,
    locked,
    move_freely,
    out_of_bounds,
    place,
)

wp.set_module_options(OPTIONS)

MAX_IMPACTS = 32  # parts into which impacts may cut a step; what is left then is solved without rebound
# Approaches slower than one step's fall do not rebound: a body at rest would else never come to rest.
SLOWEST_IMPACT = wp.float64(1.0e-4)  # without gravity [m/s]


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
def advance(
    geometry: Geometry,
    parameters: Parameters,
    joints: Joints,
    state: State,
    log: Log,
    w: int,
    k: int,
    previous_half: int,
    gravity: wp.vec3d,
    begin: wp.float64,
    h: wp.float64,
) -> int:
    """One step of length h from time `begin`, in as many parts as impacts cut it into.

    Returns which half of the contact arrays holds the step's contacts.
    """
    fall = wp.length(gravity) * h
    threshold = fall + SLOWEST_IMPACT
    time = begin
    left = h
    impacts = wp.int32(0)
    half = wp.int32(previous_half)
    while left > wp.float64(0.0):
        sweep_bodies(geometry, state, k, fall, left)
        half = 1 - half
        if joints.count > 0:
            settle_joints(joints, state, k, geometry.lock)
        find_contacts(geometry, state, k, half)
        build_rows(state, k, half, geometry.lock)
        part = left
        if joints.count > 0:
            part = longest_part(joints, state, k, left)
        slowest = threshold
        if impacts < MAX_IMPACTS:
            if resolve_impacts(joints, state, k, half, threshold) > 0:
                impacts += 1
                continue  # the bodies now move elsewhere: look again what they may hit
            whole = part
            part = time_to_impact(state, k, half, part, threshold, gravity)
            if joints.count > 0:
                part = time_to_stop(joints, state, k, part)
            if part < whole:
                impacts += 1
        else:
            slowest = FASTEST
        if joints.count > 0:
            begin_joints(joints, state, k, time, part)
        predict(geometry, parameters, state, w, k, gravity, time, part)
        aim_contacts(state, k, half, part, slowest)
        if joints.count > 0:
            solve_joints(joints, state, k, half, part)
        else:
            solve_contacts(joints, state, k, half, part)
        note_forces(state, k, half, part)
        separate_overlaps(state, k, half, part)
        for i in range(state.objects):
            if state.bodies[k, i].active == 1 and (joints.count == 0 or joints.jointed[i] == 0):
                b = state.bodies[k, i]
                state.bodies[k, i] = place(b, end_position(b, part), end_orientation(b, part))
        if joints.count > 0:
            finish_joints(joints, state, k, half, part, geometry.lock)
        if log.record == 1:
            record_contacts(log, state, w, k, half, time, part)
        left -= part
        time += part
    return half


@wp.func
def first_diverged(state: State, k: int) -> int:
    """Index of the first object whose state cannot be trusted, -1 for none."""
    for i in range(state.objects):
        if out_of_bounds(state.bodies[k, i]):
            return i
    return -1


@wp.kernel
def roll_out(
    geometry: Geometry,
    parameters: Parameters,
    schedule: Schedule,
    joints: Joints,
    state: State,
    samples: Samples,
    log: Log,
    first: int,
    slot: int,
    segments: int,
) -> None:
    """Roll world first + tid out through the given number of segments, working in row `slot` of the state.

    On a CPU the threads of a launch run one after the other, so one row serves them all and stays in the cache.
    """
    w = first + wp.tid()
    k = slot
    scale = parameters.time_scale[w % parameters.time_scale.shape[0]]
    gravity = parameters.gravity[w % parameters.gravity.shape[0]]
    load_bodies(geometry, parameters, state, w, k)
    load_joints(joints, state, w, k)
    time = wp.float64(0.0)
    half = wp.int32(0)
    for segment in range(segments):
        for i in range(state.objects):
            if schedule.joins[i] == segment:
                state.bodies[k, i].active = 1
        end = schedule.end[segment] * scale
        steps = schedule.steps[segment]
        for step in range(steps):
            h = (end - time) / wp.float64(steps - step)
            half = advance(geometry, parameters, joints, state, log, w, k, half, gravity, time, h)
            time += h
            lost = first_diverged(state, k)
            if lost >= 0:
                samples.diverged_object[w] = lost
                samples.diverged_time[w] = time
                return
            if state.crowded[k] == 1:
                samples.crowded[w] = 1
                return
        time = end
        sample = schedule.sample[segment]
        if sample >= 0:
            for i in range(state.objects):
                samples.position[w, sample, i] = state.bodies[k, i].x
                samples.orientation[w, sample, i] = state.bodies[k, i].q
                samples.velocity[w, sample, i] = state.bodies[k, i].v
                samples.angular_velocity[w, sample, i] = state.bodies[k, i].w
