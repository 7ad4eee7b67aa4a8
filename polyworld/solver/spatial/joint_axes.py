"""Forces along a joint's axis: dry friction, damping, motors, stops and springs.

Each is an impulse within its bounds, found in turn by Gauss-Seidel while all joints hold: the velocities that an
impulse adds are those of the whole chain (`Joints.yields`), not those of the two bodies alone.
"""

import warp as wp

from polyworld.model.arrays import NEVER
from polyworld.solver.spatial.joint_layout import BALL, SPRING, Joints
from polyworld.solver.spatial.joint_rows import hold_joints
from polyworld.solver.spatial.joint_sticking import damped_share, push_axis, solve_together, spring_lack, spring_slope
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.rows import push, velocity_along

STOPPED = wp.float64(1.0e-7)  # a stop is reached within this [m or rad]
UNREACHED = wp.float64(-1.0e30)  # a velocity that is always reached
SWEEPS = 400
TOGETHER = 3  # sweeps between direct solutions
SETTLED = wp.float64(1.0e-12)  # largest velocity change in a sweep over the axes that counts as none [m/s or rad/s]
RUBBING_HALVINGS = 60


@wp.func
def rubbing_torque(c: wp.mat33d, free: wp.vec3d, bound: wp.float64) -> wp.vec3d:
    """Return the impulse p of length `bound` that opposes the velocity free + c p: (c + m) p = -free for some m > 0.

    Its length falls as m grows; m is found by bisection of its logarithm.
    """
    low = wp.float64(-100.0)
    scale = wp.trace(c)
    high = wp.log(wp.length(free) / (bound * scale) + wp.float64(1.0))
    for _halving in range(RUBBING_HALVINGS):
        middle = wp.float64(0.5) * (low + high)
        p = wp.inverse(c + wp.identity(n=3, dtype=wp.float64) * (scale * wp.exp(middle))) * free
        if wp.length(p) > bound:
            low = middle
        else:
            high = middle
    p = wp.inverse(c + wp.identity(n=3, dtype=wp.float64) * (scale * wp.exp(high))) * free
    return p * (-bound / wp.length(p))


@wp.func(inline=False)
def rub_ball(joints: wp.array[Joints], k: int, j: int, h: wp.float64) -> wp.float64:
    """Friction and damping of a ball joint: a torque against the turning, of a bounded length and of its rate."""
    first = joints[0].kinds[j].axis
    joint = joints[0].joint[k, j]
    c = wp.mat33d()
    v = wp.vec3d()
    for i in range(3):
        v[i] = joints[0].rate[k, first + i]
        for m in range(3):
            c[i, m] = joints[0].yields[k, (first + i) * joints[0].axes + first + m]
    if c[0, 0] <= wp.float64(0.0) or c[1, 1] <= wp.float64(0.0) or c[2, 2] <= wp.float64(0.0):
        return wp.float64(0.0)
    share = damped_share(joint.damping * h * wp.trace(c))
    wanted = (v * share + joint.speed * (wp.float64(1.0) - share)) * (-joint.damping * h)
    unit = wp.identity(n=3, dtype=wp.float64)
    change = wp.inverse(unit + c * (joint.damping * h * share)) * (wanted - joint.damped)
    joints[0].joint[k, j].damped = joint.damped + change
    free = v + c * (change - joint.rubbing)  # without friction
    bound = joint.friction * h
    rubbing = wp.vec3d()
    if bound > wp.float64(0.0):
        rubbing = -(wp.inverse(c) * free)
        if wp.length(rubbing) > bound:
            rubbing = rubbing_torque(c, free, bound)
    change += rubbing - joint.rubbing
    joints[0].joint[k, j].rubbing = rubbing
    for i in range(3):
        push_axis(joints, k, first + i, change[i])
    return wp.length(c * change)


@wp.func(inline=False)
def move_axis(joints: wp.array[Joints], k: int, j: int, h: wp.float64) -> wp.float64:
    """One visit of the axis of a hinge, slider or spring. Returns the velocity changed."""
    zero = wp.float64(0.0)
    axis = joints[0].kinds[j].axis
    c = joints[0].yields[k, axis * joints[0].axes + axis]
    if c <= zero:
        return zero
    joint = joints[0].joint[k, j]
    v = joints[0].rate[k, axis]
    total = zero
    if joints[0].kinds[j].kind == SPRING:
        if joint.is_final == 1:
            return zero
        total = spring_lack(joint, v, h) / (wp.float64(1.0) + spring_slope(joint, h) * c)
        joint.pulled += total
    else:
        if joint.damping > zero:
            z = joint.damping * h * c
            share = damped_share(z)
            wanted = -joint.damping * h * (share * v + (wp.float64(1.0) - share) * joint.speed[0])
            change = (wanted - joint.damped[0]) / (wp.float64(1.0) + z * share)
            joint.damped[0] = joint.damped[0] + change
            total += change
            v += change * c
        if joints[0].kinds[j].driven > 0:
            most = wp.abs(joint.effort) * joint.drive
            wanted = joint.effort * joint.drive
            if joints[0].kinds[j].driven == 2:
                wanted = wp.clamp(joint.driving + (joint.target_speed - v) / c, -most, most)
            total += wanted - joint.driving
            v += (wanted - joint.driving) * c
            joint.driving = wanted
        if joint.friction > zero:
            bound = joint.friction * h
            wanted = wp.clamp(joint.rubbing[0] - v / c, -bound, bound)
            total += wanted - joint.rubbing[0]
            v += (wanted - joint.rubbing[0]) * c
            joint.rubbing[0] = wanted
        for s in range(2):  # lower, upper
            side = wp.float64(1 - 2 * s)
            if joint.stop_target[s] > UNREACHED or joint.stopped[s] != zero:
                wanted = wp.max(joint.stopped[s] + (joint.stop_target[s] - side * v) / c, zero)
                change = side * (wanted - joint.stopped[s])
                total += change
                v += change * c
                joint.stopped[s] = wanted
    joints[0].joint[k, j] = joint
    if total != zero:
        push_axis(joints, k, axis, total)
    return wp.abs(total) * c


@wp.func(inline=False)
def move_axes(joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64) -> wp.float64:
    """Find the impulses along all axes while the joints hold. Returns the largest velocity changed."""
    zero = wp.float64(0.0)
    acting = wp.int32(0)
    first = joints[0].base + joints[0].equalities
    for j in range(joints[0].count):
        acting += joints[0].resists[k, j]
    if acting == 0:
        return zero
    for i in range(joints[0].axes):
        r = joints[0].equalities + i
        joints[0].pushed[k, i] = zero
        joints[0].rate[k, i] = velocity_along(state, k, joints[0].row_a[r], joints[0].row_b[r], first + i)
    for sweep in range(SWEEPS):
        worst = zero
        for j in range(joints[0].count):
            if joints[0].resists[k, j] == 1:
                if joints[0].kinds[j].kind == BALL:
                    worst = wp.max(worst, rub_ball(joints, k, j, h))
                else:
                    worst = wp.max(worst, move_axis(joints, k, j, h))
        if worst <= SETTLED:
            break
        if sweep % TOGETHER == TOGETHER - 1:
            solve_together(joints, k, h)
    largest = zero
    for i in range(joints[0].axes):
        p = joints[0].pushed[k, i]
        if p != zero:
            r = joints[0].equalities + i
            push(state, k, joints[0].row_a[r], joints[0].row_b[r], first + i, p)
            largest = wp.max(largest, wp.abs(p) * joints[0].yields[k, i * joints[0].axes + i])
    if largest > zero:
        hold_joints(joints, state, k)
    return largest


@wp.func
def forget(joints: wp.array[Joints], k: int, j: int) -> None:
    """Set the impulses of a joint's axes to zero, and its motor's time."""
    joints[0].joint[k, j].rubbing = wp.vec3d()
    joints[0].joint[k, j].damped = wp.vec3d()
    joints[0].joint[k, j].driving = wp.float64(0.0)
    joints[0].joint[k, j].stopped = wp.vec2d()
    joints[0].joint[k, j].pulled = wp.float64(0.0)
    joints[0].joint[k, j].drive = wp.float64(0.0)


@wp.func
def remove_axis_impulses(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Remove the impulses along all axes."""
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        for i in range(d.axes):
            r = joints[0].base + joints[0].equalities + d.axis + i
            if state[0].rows[k, r].impulse != wp.float64(0.0):
                push(state, k, d.a, d.b, r, -state[0].rows[k, r].impulse)
        forget(joints, k, j)


@wp.func
def gap_to_stop(joints: wp.array[Joints], k: int, j: int, s: int) -> wp.float64:
    """Compute how far a joint is from its lower (0) or upper (1) stop; negative beyond it."""
    if s == 0:
        return joints[0].joint[k, j].position - joints[0].joint[k, j].lower
    return joints[0].joint[k, j].upper - joints[0].joint[k, j].position


@wp.func
def set_stop_targets(joints: wp.array[Joints], k: int, h: wp.float64) -> None:
    """Velocities away from the stops that end the step of length h where it may end; for h = 0, now."""
    zero = wp.float64(0.0)
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        joints[0].joint[k, j].stop_target = wp.vec2d(UNREACHED, UNREACHED)
        if d.axes == 1 and d.kind != SPRING:
            for s in range(2):
                gap = gap_to_stop(joints, k, j, s)
                side = wp.float64(1 - 2 * s)
                if gap <= STOPPED:
                    joints[0].joint[k, j].stop_target[s] = zero
                elif h > zero and gap < wp.float64(0.5 * NEVER):
                    speed = side * joints[0].joint[k, j].speed[0]
                    joints[0].joint[k, j].stop_target[s] = wp.min(zero, -wp.float64(2.0) * gap / h - speed)


@wp.func
def stop_joints(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Joints at a stop lose the speed with which they run into it, at once and for good."""
    set_stop_targets(joints, k, wp.float64(0.0))
    move_axes(joints, state, k, wp.float64(0.0))
    for j in range(joints[0].count):
        forget(joints, k, j)


@wp.func
def time_to_stop(joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64) -> wp.float64:
    """Time until the first joint reaches a stop at its present speed, at most h."""
    earliest = h
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        if d.axes == 1 and d.kind != SPRING and joints[0].joint[k, j].active == 1:
            v = velocity_along(state, k, d.a, d.b, joints[0].base + joints[0].equalities + d.axis)
            for s in range(2):
                gap = gap_to_stop(joints, k, j, s)
                speed = -v * wp.float64(1 - 2 * s)
                if gap > STOPPED and speed * h > gap:
                    earliest = wp.min(earliest, (gap - wp.float64(0.5) * STOPPED) / speed)
    return earliest
