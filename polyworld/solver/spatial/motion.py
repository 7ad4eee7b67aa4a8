"""Motion between contacts: gravity, effects, damping and the torque-free top, then positions from velocities."""

import warp as wp

from polyworld.solver.spatial.layout import Body

FASTEST = wp.float64(1.0e6)  # a body beyond this speed [m/s] or distance [m] has diverged
FARTHEST = wp.float64(1.0e9)
FASTEST_SPIN = wp.float64(1.0e9)  # [rad/s]


@wp.func
def rotated(q: wp.quatd, rotation: wp.vec3d) -> wp.quatd:
    """q followed by a rotation vector in world axes [rad]."""
    angle = wp.length(rotation)
    half = wp.float64(0.5)
    scale = half  # sin(angle / 2) / angle at 0
    if angle > wp.float64(1.0e-8):
        scale = wp.sin(half * angle) / angle
    step = wp.quatd(rotation[0] * scale, rotation[1] * scale, rotation[2] * scale, wp.cos(half * angle))
    return wp.normalize(step * q)


@wp.func
def locked(b: Body, normal: wp.vec3d) -> Body:
    """Restrict a body to the freedoms of a plane: torques rotate it about the plane's unit normal, or not at all.

    Its inverse inertia is given in world axes, in which it stays the same.
    """
    axis = wp.transpose(b.rotation) * normal
    moment = wp.dot(axis, b.inertia * axis)
    b.inertia = wp.diag(wp.vec3d(moment, moment, moment))
    b.inverse_inertia = wp.outer(normal, normal) * (wp.float64(1.0) / moment)
    b.isotropic = 1
    b.v -= normal * wp.dot(normal, b.v)
    b.w = normal * wp.dot(normal, b.w)
    return b


@wp.func
def angular_velocity(b: Body, q: wp.quatd, momentum: wp.vec3d) -> wp.vec3d:
    """Angular velocity, world axes, of a body in orientation q with the given angular momentum."""
    r = wp.quat_to_matrix(q)
    return r * (b.inverse_inertia * (wp.transpose(r) * momentum)) * b.inverse_mass


@wp.func(inline=False)
def spun(b: Body, momentum: wp.vec3d, h: wp.float64) -> wp.quatd:
    """Orientation after time h of torque-free rotation: classical Runge-Kutta of dq/dt = omega(q) q / 2.

    The angular momentum is a constant of the motion, and stays one to the last bit.
    """
    half = wp.float64(0.5)
    total = wp.quatd()
    slope = wp.quatd()
    for stage in range(4):
        reach = half * h
        weight = wp.float64(2.0)
        if stage == 0:
            reach = wp.float64(0.0)
        if stage == 3:
            reach = h
        if stage == 0 or stage == 3:
            weight = wp.float64(1.0)
        q = b.q + slope * reach
        w = angular_velocity(b, wp.normalize(q), momentum)
        slope = wp.quatd(w[0], w[1], w[2], wp.float64(0.0)) * q * half
        total = total + slope * weight
    return wp.normalize(b.q + total * (h / wp.float64(6.0)))


@wp.func
def remaining(rate: wp.float64, h: wp.float64) -> wp.vec3d:
    """Of exponential damping over time h: exp(-c h), its mean over the step, and 2/h^2 times its double integral."""
    z = rate * h
    one = wp.float64(1.0)
    if z < wp.float64(1.0e-4):  # series, where the differences below would cancel
        return wp.vec3d(wp.exp(-z), one - z * wp.float64(0.5), one - z / wp.float64(3.0))
    left = wp.exp(-z)
    mean = (one - left) / z
    return wp.vec3d(left, mean, wp.float64(2.0) * (one - mean) / z)


@wp.func
def move_freely(
    bodies: wp.array2d[Body], k: int, i: int, force: wp.vec3d, torque: wp.vec3d, gravity: wp.vec3d, h: wp.float64
) -> None:
    """Note where a body would be after time h without contacts, exact for constant force and damping.

    It gets the velocities that it would then have, and stays where it is. Here and below a body is changed field by
    field where it lies: to copy all of it takes as long as to work all of this out.
    """
    v = bodies[k, i].v
    w = bodies[k, i].w
    light = bodies[k, i].inverse_mass
    a = gravity + force * light
    damped = remaining(bodies[k, i].linear_damping, h)
    bodies[k, i].dx = v * (h * damped[1]) + a * (wp.float64(0.5) * h * h * damped[2])
    v = v * damped[0] + a * (h * damped[1])
    bodies[k, i].v = v
    bodies[k, i].v_free = v
    left = wp.exp(-bodies[k, i].angular_damping * h)
    mean = remaining(bodies[k, i].angular_damping, h)[1]
    if bodies[k, i].isotropic == 1:
        turning = bodies[k, i].inverse_inertia * torque * (light * h)
        bodies[k, i].rotation_free = (w * mean + turning * wp.float64(0.5)) * h
        bodies[k, i].w_start = w
        w = w * left + turning
    else:
        b = bodies[k, i]
        start = b.rotation * (b.inertia * (wp.transpose(b.rotation) * w)) * b.mass
        q = spun(b, start * mean + torque * (wp.float64(0.5) * h), h)
        momentum = start * left + torque * h
        bodies[k, i].q_free = q
        bodies[k, i].angular_momentum = momentum
        w = angular_velocity(b, q, momentum)
    bodies[k, i].w = w
    bodies[k, i].w_free = w


@wp.func
def end_position(bodies: wp.array2d[Body], k: int, i: int, h: wp.float64) -> wp.vec3d:
    """Return where the step ends. Contact forces are constant over it, so the velocity they add acts half the time."""
    return bodies[k, i].x + bodies[k, i].dx + (bodies[k, i].v - bodies[k, i].v_free) * (wp.float64(0.5) * h)


@wp.func
def end_orientation(bodies: wp.array2d[Body], k: int, i: int, h: wp.float64) -> wp.quatd:
    """Orientation in which the step ends, by the same rule.

    Turns about changing axes do not commute: of an angular velocity that changes evenly their logarithm is taken to
    fourth order (Magnus 1954, Commun. Pure Appl. Math. 7, 649); where a torque-free rotation comes first, that of the
    product (Baker, Campbell & Hausdorff) is corrected by it.
    """
    change = bodies[k, i].w - bodies[k, i].w_free
    added = change * (wp.float64(0.5) * h)
    if bodies[k, i].isotropic == 1:
        bent = wp.cross(bodies[k, i].w, bodies[k, i].w_start) * (h * h / wp.float64(12.0))
        return rotated(bodies[k, i].q, bodies[k, i].rotation_free + added + bent)
    if wp.dot(change, change) > wp.float64(0.0):
        return rotated(bodies[k, i].q_free, added - wp.cross(change, bodies[k, i].w_free) * (h * h / wp.float64(6.0)))
    return bodies[k, i].q_free


@wp.func
def set_pose(bodies: wp.array2d[Body], k: int, i: int, x: wp.vec3d, q: wp.quatd) -> None:
    """Set a body's pose at the end of its step; the angular momentum is kept exactly."""
    if bodies[k, i].isotropic == 0:
        b = bodies[k, i]
        dw = b.w - b.w_free
        bodies[k, i].angular_momentum += b.rotation * (b.inertia * (wp.transpose(b.rotation) * dw)) * b.mass
    bodies[k, i].x = x + bodies[k, i].shift
    rotation = bodies[k, i].rotation_shift
    end = q
    if wp.dot(rotation, rotation) > wp.float64(0.0):
        end = rotated(q, rotation)
    bodies[k, i].q = end
    bodies[k, i].rotation = wp.quat_to_matrix(end)
    if bodies[k, i].isotropic == 0:
        bodies[k, i].w = angular_velocity(bodies[k, i], end, bodies[k, i].angular_momentum)
    bodies[k, i].shift = wp.vec3d()
    bodies[k, i].rotation_shift = wp.vec3d()


@wp.func
def out_of_bounds(bodies: wp.array2d[Body], k: int, i: int) -> bool:
    """Check whether a body's state is invalid: not finite, too fast, too far."""
    v = bodies[k, i].v
    x = bodies[k, i].x
    speed = wp.max(wp.abs(v[0]), wp.max(wp.abs(v[1]), wp.abs(v[2])))
    distance = wp.max(wp.abs(x[0]), wp.max(wp.abs(x[1]), wp.abs(x[2])))
    spin = wp.dot(bodies[k, i].w, bodies[k, i].w)
    return not (
        speed < FASTEST
        and distance < FARTHEST
        and spin < FASTEST_SPIN * FASTEST_SPIN
        and wp.dot(bodies[k, i].q, bodies[k, i].q) > wp.float64(0.5)  # normalising what is no number leaves zeros
    )
