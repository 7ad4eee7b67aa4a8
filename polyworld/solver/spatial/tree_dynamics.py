"""Kinematics and accelerations of the links of a tree: the articulated-body algorithm.

Of each link in turn, from the leaves on, its freedoms are eliminated, so that its parent feels what is left of its
inertia and force (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 7; a joint of several freedoms counts as
several of one, with nothing between).
"""

import warp as wp

from polyworld.effects import Motion
from polyworld.effects.law import wrench
from polyworld.solver.core.effect_forces import effect_forces
from polyworld.solver.spatial.joint_layout import BALL, HINGE, SLIDER, Joints
from polyworld.solver.spatial.layout import Parameters, State
from polyworld.solver.spatial.motion import rotated
from polyworld.solver.spatial.prediction import turning_of
from polyworld.solver.spatial.tree_layout import FREE, Link

SERIES = wp.float64(1.0e-2)  # rotations below this [rad] are small


@wp.func
def unit_vector(m: int) -> wp.vec3d:
    e = wp.vec3d()
    e[m] = wp.float64(1.0)
    return e


@wp.func
def linear(motion: wp.spatial_vectord) -> wp.vec3d:
    return wp.vec3d(motion[0], motion[1], motion[2])


@wp.func
def angular(motion: wp.spatial_vectord) -> wp.vec3d:
    return wp.vec3d(motion[3], motion[4], motion[5])


@wp.func
def rotation_rate(rotation: wp.vec3d, omega: wp.vec3d) -> wp.vec3d:
    """Return the rate of a rotation vector at the angular velocity omega (Iserles et al. 2000, Acta Num. 9)."""
    square = wp.dot(rotation, rotation)
    factor = wp.float64(1.0 / 12.0) + square * wp.float64(1.0 / 720.0)
    if square > SERIES * SERIES:
        half = wp.float64(0.5) * wp.sqrt(square)
        factor = (wp.float64(1.0) - half / wp.tan(half)) / square
    across = wp.cross(rotation, omega)
    return omega - wp.float64(0.5) * across + factor * wp.cross(rotation, across)


@wp.func(inline=False)
def begin_links(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Set links to the poses and speeds of their bodies, no freedom moved."""
    zero = wp.float64(0.0)
    for n in range(joints[0].tree.count):
        d = joints[0].tree.kinds[n]
        x = state[0].bodies[k, d.body].x
        q = state[0].bodies[k, d.body].q
        v = state[0].bodies[k, d.body].v
        omega = state[0].bodies[k, d.body].w
        link = Link()
        link.start_x = x
        link.origin = x
        link.relative_q = q
        speed = wp.vec3d()
        if d.kind == FREE:
            for m in range(3):
                joints[0].tree.coordinates[k, d.first + 3 + m].start_speed = v[m]
            speed = omega
        else:
            joint = joints[0].joint[k, d.joint]
            xp = wp.vec3d()
            qp = wp.quat_identity(dtype=wp.float64)
            rp = wp.identity(n=3, dtype=wp.float64)
            vp = wp.vec3d()
            omega_p = wp.vec3d()
            if d.parent >= 0:
                p = joints[0].tree.kinds[d.parent].body
                link.origin = joints[0].tree.links[k, d.parent].origin
                xp = state[0].bodies[k, p].x
                qp = state[0].bodies[k, p].q
                rp = state[0].bodies[k, p].rotation
                vp = state[0].bodies[k, p].v
                omega_p = state[0].bodies[k, p].w
            link.relative_q = wp.normalize(wp.quat_inverse(qp) * q)
            frame = joint.frame_b
            link.arm = joint.arm_a
            link.other_arm = joint.arm_b
            if d.sign < zero:
                frame = joint.frame_a
                link.arm = joint.arm_b
                link.other_arm = joint.arm_a
            link.axis = wp.vec3d(frame[0, 0], frame[1, 0], frame[2, 0])
            along = rp * link.axis
            arm = state[0].bodies[k, d.body].rotation * link.arm
            if d.kind == HINGE:
                speed[0] = wp.dot(omega - omega_p, along)
            elif d.kind == SLIDER:
                link.travel = wp.dot(x + arm - xp - rp * link.other_arm, along)
                # Relative to the point of the parent that is where the body's is.
                speed[0] = wp.dot(v - vp - wp.cross(omega_p, x - xp), along)
            elif d.kind == BALL:
                speed = omega - omega_p
        joints[0].tree.links[k, n] = link
        for m in range(wp.min(d.freedoms, 3)):
            joints[0].tree.coordinates[k, d.first + m].start_speed = speed[m]
        for m in range(d.freedoms):
            joints[0].tree.coordinates[k, d.first + m].position = zero
            joints[0].tree.coordinates[k, d.first + m].speed = joints[0].tree.coordinates[k, d.first + m].start_speed


@wp.func(inline=False)
def update_links(joints: wp.array[Joints], k: int, slope: int) -> None:
    """Compute poses and motions of the links from the positions and speeds of their freedoms.

    Also the rates of the positions, kept from `slope` on.
    """
    for n in range(joints[0].tree.count):
        d = joints[0].tree.kinds[n]
        xp = wp.vec3d()
        qp = wp.quat_identity(dtype=wp.float64)
        rp = wp.identity(n=3, dtype=wp.float64)
        motion = wp.spatial_vectord()
        if d.parent >= 0:
            xp = joints[0].tree.links[k, d.parent].x
            qp = joints[0].tree.links[k, d.parent].q
            rp = joints[0].tree.links[k, d.parent].rotation
            motion = joints[0].tree.links[k, d.parent].motion
        vp = linear(motion)
        omega = angular(motion)
        origin = joints[0].tree.links[k, n].origin
        position = wp.vec3d()
        speed = wp.vec3d()
        for m in range(wp.min(d.freedoms, 3)):
            position[m] = joints[0].tree.coordinates[k, d.first + m].position
            speed[m] = joints[0].tree.coordinates[k, d.first + m].speed
        along = rp * joints[0].tree.links[k, n].axis
        x = joints[0].tree.links[k, n].start_x
        q = wp.normalize(qp * joints[0].tree.links[k, n].relative_q)
        joint_point = xp + rp * joints[0].tree.links[k, n].other_arm
        if d.kind == HINGE:
            q = rotated(q, along * position[0])
        elif d.kind == BALL:
            q = rotated(q, rp * position)
        elif d.kind == FREE:
            q = rotated(q, position)
        rotation = wp.quat_to_matrix(q)
        if d.kind == FREE:
            for m in range(3):
                x[m] = x[m] + joints[0].tree.coordinates[k, d.first + 3 + m].position
        else:
            x = joint_point - rotation * joints[0].tree.links[k, n].arm
            if d.kind == SLIDER:
                x += along * (joints[0].tree.links[k, n].travel + position[0])
        bias = wp.spatial_vectord()
        rate = speed
        if d.kind == HINGE:
            p = joint_point - origin
            set_axis(joints, k, d.first, wp.cross(p, along), along)
            turning = wp.cross(omega, along)
            going = vp + wp.cross(omega, p)
            bias = wrench(wp.cross(going, along) + wp.cross(p, turning), turning) * speed[0]
        elif d.kind == SLIDER:
            set_axis(joints, k, d.first, along, wp.vec3d())
            bias = wrench(wp.cross(omega, along), wp.vec3d()) * speed[0]
        elif d.kind == BALL:
            p = joint_point - origin
            for m in range(3):
                set_axis(joints, k, d.first + m, wp.cross(p, unit_vector(m)), unit_vector(m))
            bias = wrench(wp.cross(vp + wp.cross(omega, p), speed), wp.vec3d())
            rate = rotation_rate(position, wp.transpose(rp) * speed)
        elif d.kind == FREE:
            v = wp.vec3d()
            for m in range(3):
                set_axis(joints, k, d.first + m, wp.cross(x - origin, unit_vector(m)), unit_vector(m))
                set_axis(joints, k, d.first + 3 + m, unit_vector(m), wp.vec3d())
                v[m] = joints[0].tree.coordinates[k, d.first + 3 + m].speed
                joints[0].tree.slopes[k, slope + d.first + 3 + m] = v[m]
            bias = wrench(wp.cross(v, speed), wp.vec3d())
            rate = rotation_rate(position, speed)
        for m in range(wp.min(d.freedoms, 3)):
            joints[0].tree.slopes[k, slope + d.first + m] = rate[m]
        for m in range(d.freedoms):
            coordinate = d.first + m
            motion += joints[0].tree.coordinates[k, coordinate].along * joints[0].tree.coordinates[k, coordinate].speed
        joints[0].tree.links[k, n].x = x
        joints[0].tree.links[k, n].q = q
        joints[0].tree.links[k, n].rotation = rotation
        joints[0].tree.links[k, n].motion = motion
        joints[0].tree.links[k, n].bias = bias


@wp.func
def set_axis(joints: wp.array[Joints], k: int, coordinate: int, moving: wp.vec3d, turning: wp.vec3d) -> None:
    joints[0].tree.coordinates[k, coordinate].along = wrench(moving, turning)


@wp.func(inline=False)
def load_links(
    parameters: wp.array[Parameters],
    joints: wp.array[Joints],
    state: wp.array[State],
    w: int,
    k: int,
    gravity: wp.vec3d,
    time: wp.float64,
) -> None:
    """Inertia of each link by itself, and the force it takes to keep it from accelerating."""
    origin_of_time = parameters[0].time_origin[w % parameters[0].time_origin.shape[0]]
    for n in range(joints[0].tree.count):
        i = joints[0].tree.kinds[n].body
        rotation = joints[0].tree.links[k, n].rotation
        motion = joints[0].tree.links[k, n].motion
        omega = angular(motion)
        rel = joints[0].tree.links[k, n].x - joints[0].tree.links[k, n].origin
        v = linear(motion) + wp.cross(omega, rel)
        mass = state[0].bodies[k, i].mass
        own = rotation * (state[0].bodies[k, i].inertia * wp.transpose(rotation)) * mass
        force = gravity * mass - v * (mass * state[0].bodies[k, i].linear_damping) + state[0].bodies[k, i].push
        torque = state[0].bodies[k, i].push_torque
        if parameters[0].forces > 0:
            b = Motion()
            b.mass = mass
            b.radius = state[0].bodies[k, i].radius
            b.x = joints[0].tree.links[k, n].x
            b.v = v
            b.omega = omega
            b.t = origin_of_time + time
            b.gravity = gravity
            laws = effect_forces(parameters[0].effects, w, i, b)
            force += linear(laws)
            torque += angular(laws)
            note_free(joints, state, k, n, force, torque, omega)
        torque -= own * omega * state[0].bodies[k, i].angular_damping
        spin = own * omega + wp.cross(rel, v * mass)
        push = wp.cross(omega, v * mass) - force
        twist = wp.cross(omega, spin) + wp.cross(linear(motion), v * mass) - torque - wp.cross(rel, force)
        joints[0].tree.links[k, n].force = wrench(push, twist)
        first_moment = wp.skew(rel) * mass
        about = own - wp.skew(rel) * first_moment
        inertia = wp.spatial_matrixd()
        for r in range(3):
            inertia[r, r] = mass
            for c in range(3):
                inertia[r, c + 3] = -first_moment[r, c]
                inertia[r + 3, c] = first_moment[r, c]
                inertia[r + 3, c + 3] = about[r, c]
        joints[0].tree.inertia[k, n] = inertia


@wp.func
def note_free(
    joints: wp.array[Joints],
    state: wp.array[State],
    k: int,
    n: int,
    force: wp.vec3d,
    torque: wp.vec3d,
    omega: wp.vec3d,
) -> None:
    """Store how the link would accelerate if it hung on nothing: the rest is what joints do."""
    b = state[0].bodies[k, joints[0].tree.kinds[n].body]
    b.w = omega
    b.rotation = joints[0].tree.links[k, n].rotation
    joints[0].tree.links[k, n].free = force * b.inverse_mass
    joints[0].tree.links[k, n].free_turning = turning_of(b, torque)


@wp.func
def push_along(joints: wp.array[Joints], k: int, n: int, m: int, time: wp.float64) -> wp.float64:
    """Return the effort of damping, dry friction and a motor along freedom m of link n [N or N m]."""
    zero = wp.float64(0.0)
    d = joints[0].tree.kinds[n]
    if d.kind == FREE:
        return zero
    damping = joints[0].joint[k, d.joint].damping
    friction = joints[0].joint[k, d.joint].friction
    speed = joints[0].tree.coordinates[k, d.first + m].speed
    total = -damping * speed
    if friction > zero:
        if d.kind == BALL:
            all_ = wp.vec3d()
            for c in range(3):
                all_[c] = joints[0].tree.coordinates[k, d.first + c].speed
            total -= friction * speed / wp.max(wp.length(all_), wp.float64(1.0e-300))
        else:
            total -= friction * joints[0].tree.coordinates[k, d.first + m].direction
    if d.kind != BALL and joints[0].kinds[d.joint].driven == 1 and motor_on(joints, k, d.joint, time) == 1:
        total += d.sign * joints[0].joint[k, d.joint].effort
    return total


@wp.func
def motor_on(joints: wp.array[Joints], k: int, j: int, time: wp.float64) -> int:
    delay = joints[0].joint[k, j].delay
    if time >= joints[0].kinds[j].switched_on + delay and time < joints[0].kinds[j].switched_off + delay:
        return 1
    return 0


@wp.func(inline=False)
def accelerate(joints: wp.array[Joints], k: int, stage: int, time: wp.float64) -> None:
    """Accelerations along all freedoms, kept as those of a stage; those of the links, about their tree's origin.

    time: at which motors are on or off.
    """
    count = joints[0].tree.count
    for back in range(count):
        n = count - 1 - back
        d = joints[0].tree.kinds[n]
        inertia = joints[0].tree.inertia[k, n]
        force = joints[0].tree.links[k, n].force
        for m in range(d.freedoms):
            coordinate = d.first + m
            along = joints[0].tree.coordinates[k, coordinate].along
            felt = inertia * along
            weight = wp.dot(along, felt)
            push = push_along(joints, k, n, m, time) - wp.dot(along, force)
            joints[0].tree.coordinates[k, coordinate].inertial = felt
            joints[0].tree.coordinates[k, coordinate].weight = weight
            joints[0].tree.coordinates[k, coordinate].push = push
            inertia = inertia - wp.outer(felt, felt * (wp.float64(1.0) / weight))
            force = force + felt * (push / weight)
        if d.parent >= 0:
            joints[0].tree.inertia[k, d.parent] = joints[0].tree.inertia[k, d.parent] + inertia
            joints[0].tree.links[k, d.parent].force = (
                joints[0].tree.links[k, d.parent].force + force + inertia * joints[0].tree.links[k, n].bias
            )
    at = stage * joints[0].tree.freedoms
    for n in range(count):
        d = joints[0].tree.kinds[n]
        a = joints[0].tree.links[k, n].bias
        if d.parent >= 0:
            a = a + joints[0].tree.links[k, d.parent].acceleration
        for back in range(d.freedoms):
            coordinate = d.first + d.freedoms - 1 - back
            rest = joints[0].tree.coordinates[k, coordinate].push - wp.dot(
                joints[0].tree.coordinates[k, coordinate].inertial, a
            )
            rate = rest / joints[0].tree.coordinates[k, coordinate].weight
            joints[0].tree.rates[k, at + coordinate] = rate
            a = a + joints[0].tree.coordinates[k, coordinate].along * rate
        joints[0].tree.links[k, n].acceleration = a
