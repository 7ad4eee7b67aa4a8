"""Where bodies that joints hold will be at the end of a step, by their motion and the joints' last impulses."""

import warp as wp

from polyworld.solver.spatial.joint_layout import SPRING, Joints
from polyworld.solver.spatial.joint_rows import joint_error
from polyworld.solver.spatial.layout import Body, State
from polyworld.solver.spatial.motion import remaining, rotated, spun
from polyworld.solver.spatial.rows import push, velocity_along


@wp.func
def held_orientation(b: Body, start_w: wp.vec3d, h: wp.float64) -> wp.quatd:
    """Orientation at the step's end: half of all angular impulses at its start, then free rotation."""
    half = wp.float64(0.5)
    damped = remaining(b.angular_damping, h)
    dw = b.w - b.w_free
    if b.isotropic == 1:
        turning = b.w_free - start_w * damped[0]
        return rotated(b.q, (start_w * damped[1] + (turning + dw) * half) * h)
    start = b.rotation * (b.inertia * (wp.transpose(b.rotation) * start_w)) * b.mass
    impulse = b.rotation * (b.inertia * (wp.transpose(b.rotation) * dw)) * b.mass
    return spun(b, start * damped[1] + (b.angular_momentum - start * damped[0] + impulse) * half, h)


@wp.func
def look_ahead(joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64) -> wp.float64:
    """Predict where the step ends with the velocities so far, and set targets that close all joints there.

    Returns by how much the worst is open.
    """
    half = wp.float64(0.5) * h
    for i in range(state[0].objects):
        if joints[0].jointed[i] == 1 and state[0].bodies[k, i].active == 1:
            b = state[0].bodies[k, i]
            joints[0].end_x[k, i] = b.x + b.dx + (b.v - b.v_free) * half
            q = held_orientation(b, joints[0].start_w[k, i], h)
            joints[0].end_q[k, i] = q
            joints[0].end_rotation[k, i] = wp.quat_to_matrix(q)
    worst = wp.float64(0.0)
    for j in range(joints[0].count):
        if joints[0].joint[k, j].active == 0:
            continue
        d = joints[0].kinds[j]
        joint = joints[0].joint[k, j]
        xa = joints[0].end_x[k, d.a]
        ra = joints[0].end_rotation[k, d.a]
        xb = state[0].bodies[k, d.b].x
        rb = state[0].bodies[k, d.b].rotation
        if d.b < state[0].objects:
            xb = joints[0].end_x[k, d.b]
            rb = joints[0].end_rotation[k, d.b]
        if d.kind == SPRING:
            row = joints[0].base + joints[0].equalities + d.axis
            v = velocity_along(state, k, d.a, d.b, row)
            apart = xa + ra * joint.arm_a - xb - rb * joint.arm_b
            length = wp.length(apart)
            if wp.dot(apart, state[0].rows[k, row].d) < wp.float64(0.0):  # its ends pass each other
                length = -length
            guess = joint.position_at_end + half * (v - joint.seen_speed)
            worst = wp.max(worst, wp.abs(length - guess))
            joints[0].joint[k, j].position_at_end = length
            joints[0].joint[k, j].seen_speed = v
            continue
        opened, askew = joint_error(d, joint, xa, ra, xb, rb)
        r = d.first
        for i in range(d.point, d.point + d.points):
            joints[0].target[k, r] = velocity_along(state, k, d.a, d.b, joints[0].base + r) - opened[i] / half
            if joints[0].inverse[k, r] > wp.float64(0.0):
                worst = wp.max(worst, wp.abs(opened[i]))
            r += 1
        for i in range(d.rotation, d.rotation + d.rotations):
            joints[0].target[k, r] = velocity_along(state, k, d.a, d.b, joints[0].base + r) - askew[i] / half
            if joints[0].inverse[k, r] > wp.float64(0.0):
                worst = wp.max(worst, wp.abs(askew[i]))
            r += 1
    return worst


@wp.func
def guess_axes(joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64) -> None:
    """Warm-start with the resistance of the last step along all axes."""
    for j in range(joints[0].count):
        if joints[0].resists[k, j] == 1:
            rubbing = joints[0].joint[k, j].last_rubbing * h
            damped = joints[0].joint[k, j].last_damped * h
            pulled = joints[0].joint[k, j].last_pulled * h
            joints[0].joint[k, j].rubbing = rubbing
            joints[0].joint[k, j].damped = damped
            joints[0].joint[k, j].pulled = pulled
            for i in range(joints[0].kinds[j].axes):
                r = joints[0].equalities + joints[0].kinds[j].axis + i
                p = rubbing[i] + damped[i]
                if i == 0:
                    p += pulled
                push(state, k, joints[0].row_a[r], joints[0].row_b[r], joints[0].base + r, p)
