"""All axes at once: where many joints stick, drag or pull together, one after another they agree only slowly.

With each axis in the state it was left in - sticking, driven at its target speed, against a stop, damped, or on its
spring - its impulse changes by (R - v) / (1/s) for a velocity v, with a softness 1/s that is 0 where it is rigid.
These are linear equations for all axes, solved directly; impulses beyond their bounds are cut, and the sweeps over
the axes put right what that leaves (Silcowitz, Niebe & Erleben 2010, VRIPHYS, the same for contacts).
"""

import warp as wp

from polyworld.solver.spatial.joint_layout import BALL, SPRING, Joint, Joints

FREE = 0
DAMPED = 1
RUBBING = 2
DRIVEN = 3
LOWER = 4
UPPER = 5
PULLED = 6
INNER = wp.float64(1.0 - 1.0e-9)  # an impulse below this share of its bound can change either way
RIGID = wp.float64(1.0e-12)  # a pivot below this fraction of its diagonal is rounding


@wp.func
def state_of(joints: wp.array[Joints], k: int, j: int, h: wp.float64) -> int:
    """In which of the states above the axis of joint j is."""
    zero = wp.float64(0.0)
    joint = joints[0].joint[k, j]
    if joints[0].kinds[j].kind == BALL:
        return FREE
    if joints[0].kinds[j].kind == SPRING:
        if joint.is_final == 1 or h <= zero:
            return FREE
        return PULLED
    if joint.stopped[0] > zero:
        return LOWER
    if joint.stopped[1] > zero:
        return UPPER
    if joint.friction > zero and wp.abs(joint.rubbing[0]) < INNER * joint.friction * h:
        return RUBBING
    most = wp.abs(joint.effort) * joint.drive
    if joints[0].kinds[j].driven == 2 and wp.abs(joint.driving) < INNER * most:
        return DRIVEN
    if joint.damping > zero and h > zero:
        return DAMPED
    return FREE


@wp.func
def cut(joint: Joint, state: int, change: wp.float64, most: wp.float64, bound: wp.float64) -> wp.float64:
    """As much of a change as keeps the impulse within its bounds."""
    if state == RUBBING:
        return wp.clamp(joint.rubbing[0] + change, -bound, bound) - joint.rubbing[0]
    if state == DRIVEN:
        return wp.clamp(joint.driving + change, -most, most) - joint.driving
    if state == LOWER:
        return wp.max(change, -joint.stopped[0])
    if state == UPPER:
        return wp.min(change, joint.stopped[1])
    return change


@wp.func
def damped_share(z: wp.float64) -> wp.float64:
    """Weight of the velocity at a step's end in its mean, where it decays by exp(-z) over the step."""
    if z < wp.float64(1.0e-3):
        return wp.float64(0.5) + z / wp.float64(12.0)
    return wp.float64(1.0) / (wp.float64(1.0) - wp.exp(-z)) - wp.float64(1.0) / z


@wp.func
def spring_lack(joint: Joint, v: wp.float64, h: wp.float64) -> wp.float64:
    """Return the mean of a spring's forces at both ends of the step, at velocity v, less its impulse."""
    half = wp.float64(0.5) * h
    end = joint.position_at_end + half * (v - joint.seen_speed)
    extension = wp.float64(0.5) * (joint.position + end) - joint.rest_length
    return -h * joint.stiffness * extension - half * joint.damping * (joint.speed[0] + v) - joint.pulled


@wp.func
def spring_slope(joint: Joint, h: wp.float64) -> wp.float64:
    """Return the decrease of a spring's impulse per unit velocity at the step's end."""
    return wp.float64(0.25) * h * h * joint.stiffness + wp.float64(0.5) * h * joint.damping


@wp.func
def wanted(joints: wp.array[Joints], k: int, j: int, state: int, h: wp.float64) -> wp.vec2d:
    """Return the velocity that an axis lacks in its state, and its softness."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    axis = joints[0].kinds[j].axis
    joint = joints[0].joint[k, j]
    v = joints[0].rate[k, axis]
    if state == DRIVEN:
        return wp.vec2d(joint.target_speed - v, zero)
    if state == LOWER:
        return wp.vec2d(joint.stop_target[0] - v, zero)
    if state == UPPER:
        return wp.vec2d(-joint.stop_target[1] - v, zero)
    if state == DAMPED:
        share = damped_share(joint.damping * h * joints[0].yields[k, axis * joints[0].axes + axis])
        slope = joint.damping * h * share
        lack = -joint.damping * h * (share * v + (one - share) * joint.speed[0]) - joint.damped[0]
        return wp.vec2d(lack / slope, one / slope)
    if state == PULLED:
        slope = spring_slope(joint, h)
        if slope <= zero:
            return wp.vec2d()
        return wp.vec2d(spring_lack(joint, v, h) / slope, one / slope)
    return wp.vec2d(-v, zero)


@wp.func
def take(joints: wp.array[Joints], k: int, j: int, state: int, change: wp.float64, h: wp.float64) -> wp.float64:
    """Change the impulse of an axis in its state, within its bounds; returns by how much."""
    joint = joints[0].joint[k, j]
    most = wp.abs(joint.effort) * joint.drive
    given = cut(joint, state, change, most, joint.friction * h)
    if state == RUBBING:
        joint.rubbing[0] = joint.rubbing[0] + given
    elif state == DRIVEN:
        joint.driving += given
    elif state == LOWER:
        joint.stopped[0] = joint.stopped[0] + given
    elif state == UPPER:
        joint.stopped[1] = joint.stopped[1] - given
    elif state == DAMPED:
        joint.damped[0] = joint.damped[0] + given
    else:
        joint.pulled += given
    joints[0].joint[k, j] = joint
    return given


@wp.func
def push_axis(joints: wp.array[Joints], k: int, axis: int, impulse: wp.float64) -> None:
    """Note an impulse along an axis, and what it does to all."""
    joints[0].pushed[k, axis] += impulse
    at = axis * joints[0].axes
    for i in range(joints[0].axes):
        joints[0].rate[k, i] += joints[0].yields[k, at + i] * impulse


@wp.func(inline=False)
def solve_together(joints: wp.array[Joints], k: int, h: wp.float64) -> None:
    """One direct solution for all axes in their present states: a Cholesky factorisation."""
    zero = wp.float64(0.0)
    n = wp.int32(0)
    for j in range(joints[0].count):
        if joints[0].resists[k, j] == 0:
            continue
        state = state_of(joints, k, j, h)
        axis = joints[0].kinds[j].axis
        own = joints[0].yields[k, axis * joints[0].axes + axis]
        if state == FREE or own <= zero:
            continue
        lack = wanted(joints, k, j, state, h)
        joints[0].chosen[k, n] = j
        joints[0].state[k, n] = state
        for m in range(n + 1):
            value = joints[0].yields[k, axis * joints[0].axes + joints[0].kinds[joints[0].chosen[k, m]].axis]
            if m == n:
                value += lack[1]
            whole = value
            for i in range(m):
                value -= joints[0].factor[k, n * joints[0].axes + i] * joints[0].factor[k, m * joints[0].axes + i]
            if m < n:
                joints[0].factor[k, n * joints[0].axes + m] = value * joints[0].factor[k, m * joints[0].axes + m]
            elif value > RIGID * whole:
                joints[0].factor[k, n * joints[0].axes + n] = wp.float64(1.0) / wp.sqrt(value)
            else:
                joints[0].factor[k, n * joints[0].axes + n] = zero
        right = lack[0]
        for i in range(n):
            right -= joints[0].factor[k, n * joints[0].axes + i] * joints[0].change[k, i]
        joints[0].change[k, n] = right * joints[0].factor[k, n * joints[0].axes + n]
        n += 1
    for s in range(n):
        r = n - 1 - s
        value = joints[0].change[k, r] * joints[0].factor[k, r * joints[0].axes + r]
        joints[0].change[k, r] = value
        for i in range(r):
            joints[0].change[k, i] -= joints[0].factor[k, r * joints[0].axes + i] * value
    for s in range(n):
        j = joints[0].chosen[k, s]
        given = take(joints, k, j, joints[0].state[k, s], joints[0].change[k, s], h)
        push_axis(joints, k, joints[0].kinds[j].axis, given)
