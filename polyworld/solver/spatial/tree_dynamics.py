"""Kinematics and accelerations of the links of a tree: the articulated-body algorithm.

Of each link in turn, from the leaves on, its freedoms are eliminated, so that its parent feels what is left of its
inertia and force (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 7; a joint of several freedoms counts as
several of one, with nothing between).
"""

import warp as wp

from polyworld.effects import Motion
from polyworld.effects.law import wrench
from polyworld.solver.core.effect_forces import effect_forces
from polyworld.solver.spatial.joint_layout import BALL, FIXED, HINGE, SLIDER, Joints
from polyworld.solver.spatial.layout import Parameters, State
from polyworld.solver.spatial.motion import rotated
from polyworld.solver.spatial.prediction import turning_of
from polyworld.solver.spatial.tree_layout import FREE, Link, angular, linear
from polyworld.solver.spatial.tree_springs import pull_springs

SERIES = wp.float64(1.0e-2)  # rotations below this [rad] are small


@wp.func
def unit_vector(m: int) -> wp.vec3d:
    e = wp.vec3d()
    e[m] = wp.float64(1.0)
    return e


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
        link.bend = joints[0].tree.links[k, n].bend
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
    kinds = joints[0].tree.kinds
    links = joints[0].tree.links
    coordinates = joints[0].tree.coordinates
    slopes = joints[0].tree.slopes
    half = wp.float64(0.5)
    for n in range(joints[0].tree.count):
        kind = kinds[n].kind
        parent = kinds[n].parent
        first = kinds[n].first
        xp = wp.vec3d()
        qp = wp.quat_identity(dtype=wp.float64)
        rp = wp.identity(n=3, dtype=wp.float64)
        vp = wp.vec3d()
        omega = wp.vec3d()
        if parent >= 0:
            xp = links[k, parent].x
            qp = links[k, parent].q
            rp = links[k, parent].rotation
            vp = linear(links[k, parent].motion)
            omega = angular(links[k, parent].motion)
        v = vp
        w = omega
        origin = links[k, n].origin
        joint_point = xp + rp * links[k, n].other_arm
        p = joint_point - origin
        relative = links[k, n].relative_q
        q = qp * relative
        x = joint_point
        bias = wp.spatial_vectord()
        if kind == HINGE:
            position = coordinates[k, first].position
            speed = coordinates[k, first].speed
            axis = links[k, n].axis
            along = rp * axis
            turn = axis * wp.sin(half * position)
            q = qp * (wp.quatd(turn[0], turn[1], turn[2], wp.cos(half * position)) * relative)
            moving = wp.cross(p, along)
            coordinates[k, first].along = wrench(moving, along)
            turning = wp.cross(omega, along)
            going = vp + wp.cross(omega, p)
            bias = wrench(wp.cross(going, along) + wp.cross(p, turning), turning) * speed
            slopes[k, slope + first] = speed
            v += moving * speed
            w += along * speed
        elif kind == SLIDER:
            speed = coordinates[k, first].speed
            along = rp * links[k, n].axis
            x += along * (links[k, n].travel + coordinates[k, first].position)
            coordinates[k, first].along = wrench(along, wp.vec3d())
            bias = wrench(wp.cross(omega, along), wp.vec3d()) * speed
            slopes[k, slope + first] = speed
            v += along * speed
        elif kind != FIXED:
            positions = wp.vec3d()
            speeds = wp.vec3d()
            for m in range(3):
                positions[m] = coordinates[k, first + m].position
                speeds[m] = coordinates[k, first + m].speed
            if kind == BALL:
                q = rotated(q, rp * positions)
                for m in range(3):
                    coordinates[k, first + m].along = wrench(wp.cross(p, unit_vector(m)), unit_vector(m))
                bias = wrench(wp.cross(vp + wp.cross(omega, p), speeds), wp.vec3d())
                rate = rotation_rate(positions, wp.transpose(rp) * speeds)
                v += wp.cross(p, speeds)
            else:
                q = rotated(q, positions)
                going = wp.vec3d()
                x = links[k, n].start_x
                for m in range(3):
                    x[m] = x[m] + coordinates[k, first + 3 + m].position
                    going[m] = coordinates[k, first + 3 + m].speed
                    slopes[k, slope + first + 3 + m] = going[m]
                for m in range(3):
                    coordinates[k, first + m].along = wrench(wp.cross(x - origin, unit_vector(m)), unit_vector(m))
                    coordinates[k, first + 3 + m].along = wrench(unit_vector(m), wp.vec3d())
                bias = wrench(wp.cross(going, speeds), wp.vec3d())
                rate = rotation_rate(positions, speeds)
                v = going + wp.cross(x - origin, speeds)
            for m in range(3):
                slopes[k, slope + first + m] = rate[m]
            w += speeds
        q = wp.normalize(q)
        rotation = wp.quat_to_matrix(q)
        if kind != FREE:
            x -= rotation * links[k, n].arm
        links[k, n].x = x
        links[k, n].q = q
        links[k, n].rotation = rotation
        links[k, n].motion = wrench(v, w)
        links[k, n].bias = bias


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
    kinds = joints[0].tree.kinds
    links = joints[0].tree.links
    inertias = joints[0].tree.inertia
    bodies = state[0].bodies
    one = wp.float64(1.0)
    for n in range(joints[0].tree.count):
        i = kinds[n].body
        rotation = links[k, n].rotation
        x = links[k, n].x
        start_v = linear(links[k, n].motion)
        omega = angular(links[k, n].motion)
        rel = x - links[k, n].origin
        v = start_v + wp.cross(omega, rel)
        mass = bodies[k, i].mass
        own = rotation * (bodies[k, i].inertia * wp.transpose(rotation)) * mass
        force = gravity * mass - v * (mass * bodies[k, i].linear_damping) + bodies[k, i].push
        torque = bodies[k, i].push_torque
        if parameters[0].forces > 0:
            b = Motion()
            b.mass = mass
            b.radius = bodies[k, i].radius
            b.x = x
            b.v = v
            b.omega = omega
            b.t = origin_of_time + time
            b.gravity = gravity
            laws = effect_forces(parameters[0].effects, w, i, b)
            force += linear(laws)
            torque += angular(laws)
            note_free(joints, state, k, n, force, torque, omega)
        about = own * omega
        torque -= about * bodies[k, i].angular_damping
        momentum = v * mass
        push = wp.cross(omega, momentum) - force
        twist = wp.cross(omega, about + wp.cross(rel, momentum)) + wp.cross(start_v, momentum) - torque
        links[k, n].force = wrench(push, twist - wp.cross(rel, force))
        first_moment = rel * mass
        inertias[k, n].mass = wp.diag(wp.vec3d(one, one, one) * mass)
        inertias[k, n].moment = wp.skew(-first_moment)
        square = wp.dot(rel, first_moment)
        inertias[k, n].about = own + wp.diag(wp.vec3d(square, square, square)) - wp.outer(rel, first_moment)
    pull_springs(joints, state, k)


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
    kinds = joints[0].tree.kinds
    links = joints[0].tree.links
    coordinates = joints[0].tree.coordinates
    inertias = joints[0].tree.inertia
    rates = joints[0].tree.rates
    for back in range(count):
        n = count - 1 - back
        parent = kinds[n].parent
        mass = inertias[k, n].mass
        moment = inertias[k, n].moment
        about = inertias[k, n].about
        force = linear(links[k, n].force)
        torque = angular(links[k, n].force)
        for m in range(kinds[n].freedoms):
            coordinate = kinds[n].first + m
            moving = linear(coordinates[k, coordinate].along)
            turning = angular(coordinates[k, coordinate].along)
            pushed = mass * moving + moment * turning
            twisted = moving * moment + about * turning
            light = wp.float64(1.0) / (wp.dot(moving, pushed) + wp.dot(turning, twisted))
            push = push_along(joints, k, n, m, time) - wp.dot(moving, force) - wp.dot(turning, torque)
            coordinates[k, coordinate].inertial = wrench(pushed, twisted)
            coordinates[k, coordinate].light = light
            coordinates[k, coordinate].push = push
            force += pushed * (push * light)
            torque += twisted * (push * light)
            if parent >= 0 or m + 1 < kinds[n].freedoms:
                mass -= wp.outer(pushed, pushed * light)
                moment -= wp.outer(pushed, twisted * light)
                about -= wp.outer(twisted, twisted * light)
        if parent >= 0:
            inertias[k, parent].mass += mass
            inertias[k, parent].moment += moment
            inertias[k, parent].about += about
            going = linear(links[k, n].bias)
            turning = angular(links[k, n].bias)
            force += linear(links[k, parent].force) + mass * going + moment * turning
            torque += angular(links[k, parent].force) + going * moment + about * turning
            links[k, parent].force = wrench(force, torque)
    at = stage * joints[0].tree.freedoms
    for n in range(count):
        parent = kinds[n].parent
        a = links[k, n].bias
        if parent >= 0:
            a = a + links[k, parent].acceleration
        freedoms = kinds[n].freedoms
        for back in range(freedoms):
            coordinate = kinds[n].first + freedoms - 1 - back
            rest = coordinates[k, coordinate].push - wp.dot(coordinates[k, coordinate].inertial, a)
            rate = rest * coordinates[k, coordinate].light
            rates[k, at + coordinate] = rate
            a = a + coordinates[k, coordinate].along * rate
        links[k, n].acceleration = a
