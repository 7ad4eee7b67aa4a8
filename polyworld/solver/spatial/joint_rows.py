"""Rows of joints, and the impulses that hold all of them at once.

The impulses solve (J M^-1 J^T) p = aim - J v directly, by a Cholesky factor kept within its envelope (George & Liu
1981, ch. 4): a chain or a tree of joints costs time in proportion to its length, and stays together whatever the
masses. Rows that depend on others, as in closed loops, are left out.
"""

import warp as wp

from polyworld.solver.spatial.joint_layout import BALL, HINGE, NEVER, SLIDER, SPRING, Joint, JointKind, Joints
from polyworld.solver.spatial.layout import Row, State
from polyworld.solver.spatial.rows import make_row, push, velocity_along, world_inverse_inertia

DEPENDENT = wp.float64(1.0e-10)  # a pivot below this fraction of its diagonal is rounding


@wp.func
def column(m: wp.mat33d, i: int) -> wp.vec3d:
    return wp.vec3d(m[0, i], m[1, i], m[2, i])


@wp.func
def angle_between(fa: wp.mat33d, fb: wp.mat33d) -> wp.float64:
    """Angle from frame b's first tangent to frame a's, about the axis, in (-pi, pi]."""
    t = column(fa, 1)
    return wp.atan2(wp.dot(t, column(fb, 2)), wp.dot(t, column(fb, 1)))


@wp.func
def turn_error(fa: wp.mat33d, fb: wp.mat33d) -> wp.vec3d:
    """Rotation vector from frame b to frame a, world axes, for small angles; exact in direction."""
    total = wp.vec3d()
    for i in range(3):
        total += wp.cross(column(fb, i), column(fa, i))
    return total * wp.float64(0.5)


@wp.func
def axis_error(fa: wp.mat33d, fb: wp.mat33d) -> wp.vec3d:
    """Small rotation vector that turns frame b's axis into frame a's."""
    return wp.cross(column(fb, 0), column(fa, 0))


@wp.func
def write_axes(joints: Joints, state: State, k: int, j: int, lock: wp.vec3d) -> None:
    """Rows along which joint j moves; impulses are kept."""
    d = joints.kinds[j]
    joint = joints.joint[k, j]
    a = state.bodies[k, d.a]
    b = state.bodies[k, d.b]
    ia = world_inverse_inertia(a)
    ib = world_inverse_inertia(b)
    masses = a.inverse_mass + b.inverse_mass
    at = joints.base + joints.equalities + d.axis
    pa = a.rotation * joint.arm_a
    pb = b.rotation * joint.arm_b
    apart = a.x + pa - b.x - pb
    frame = b.rotation * joint.frame_b
    zero = wp.vec3d()
    if d.kind == HINGE:
        axis = column(frame, 0)
        state.rows[k, at] = make_row(zero, axis, axis, ia, ib, masses, lock)
        found = angle_between(a.rotation * joint.frame_a, frame)
        whole = wp.float64(6.283185307179586)
        joints.joint[k, j].place = found + whole * wp.round((joint.place - found) / whole)
    elif d.kind == SLIDER:
        axis = column(frame, 0)
        state.rows[k, at] = make_row(axis, wp.cross(pa, axis), wp.cross(pa + a.x - b.x, axis), ia, ib, masses, lock)
        joints.joint[k, j].place = wp.dot(apart, axis)
    elif d.kind == BALL:
        for i in range(3):
            axis = column(frame, i)
            state.rows[k, at + i] = make_row(zero, axis, axis, ia, ib, masses, lock)
    elif d.kind == SPRING:
        length = wp.length(apart)
        axis = zero
        if length > wp.float64(1.0e-12):
            axis = apart / length
        state.rows[k, at] = make_row(axis, wp.cross(pa, axis), wp.cross(pb, axis), ia, ib, masses, lock)
        joints.joint[k, j].place = length


@wp.func
def write_rows(joints: Joints, state: State, k: int, j: int, lock: wp.vec3d) -> None:
    """Rows that joint j holds at its bodies' pose."""
    d = joints.kinds[j]
    joint = joints.joint[k, j]
    a = state.bodies[k, d.a]
    b = state.bodies[k, d.b]
    ia = world_inverse_inertia(a)
    ib = world_inverse_inertia(b)
    masses = a.inverse_mass + b.inverse_mass
    pa = a.rotation * joint.arm_a
    frame = b.rotation * joint.frame_b
    r = joints.base + d.first
    for i in range(d.point, d.point + d.points):
        axis = column(frame, i)
        state.rows[k, r] = make_row(axis, wp.cross(pa, axis), wp.cross(pa + a.x - b.x, axis), ia, ib, masses, lock)
        r += 1
    for i in range(d.turn, d.turn + d.turns):
        axis = column(frame, i)
        state.rows[k, r] = make_row(wp.vec3d(), axis, axis, ia, ib, masses, lock)
        r += 1


@wp.func
def side(first: Row, second: Row, sign: wp.float64, inverse_mass: wp.float64, at_b: int, from_b: int) -> wp.float64:
    """Velocity along one row for a unit impulse along another, through one body that both act on."""
    j = first.ja
    if at_b == 1:
        j = first.jb
    w = second.wa
    if from_b == 1:
        w = second.wb
    return sign * (wp.dot(first.d, second.d) * inverse_mass + wp.dot(j, w))


@wp.func
def coupling(state: State, k: int, r: int, p: JointKind, c: int, q: JointKind) -> wp.float64:
    """Velocity along row r of joint p for a unit impulse along row c of joint q."""
    total = wp.float64(0.0)
    one = wp.float64(1.0)
    if p.a == q.a:
        total += side(state.rows[k, r], state.rows[k, c], one, state.bodies[k, p.a].inverse_mass, 0, 0)
    if p.a == q.b:
        total += side(state.rows[k, r], state.rows[k, c], -one, state.bodies[k, p.a].inverse_mass, 0, 1)
    if p.b == q.a:
        total += side(state.rows[k, r], state.rows[k, c], -one, state.bodies[k, p.b].inverse_mass, 1, 0)
    if p.b == q.b:
        total += side(state.rows[k, r], state.rows[k, c], one, state.bodies[k, p.b].inverse_mass, 1, 1)
    return total


@wp.func
def factorise(joints: Joints, state: State, k: int) -> None:
    """Fill the matrix and turn it into its Cholesky factor, row by row."""
    zero = wp.float64(0.0)
    for r in range(joints.equalities):
        first = joints.column[r]
        at = joints.start[r] - first
        p = joints.kinds[joints.row_joint[r]]
        for c in range(first, r + 1):
            q = joints.kinds[joints.row_joint[c]]
            value = coupling(state, k, joints.base + r, p, joints.base + c, q)
            whole = value
            under = joints.start[c] - joints.column[c]
            for i in range(wp.max(first, joints.column[c]), c):
                value -= joints.matrix[k, at + i] * joints.matrix[k, under + i]
            if c < r:
                joints.matrix[k, at + c] = value * joints.inverse[k, c]
            elif value > DEPENDENT * whole:
                joints.matrix[k, at + c] = wp.sqrt(value)
                joints.inverse[k, c] = wp.float64(1.0) / wp.sqrt(value)
            else:
                joints.matrix[k, at + c] = zero
                joints.inverse[k, c] = zero


@wp.func
def forward(joints: Joints, k: int) -> None:
    """work := L^-1 work."""
    for r in range(joints.equalities):
        first = joints.column[r]
        at = joints.start[r] - first
        value = joints.work[k, r]
        for i in range(first, r):
            value -= joints.matrix[k, at + i] * joints.work[k, i]
        joints.work[k, r] = value * joints.inverse[k, r]


@wp.func
def backward(joints: Joints, k: int) -> None:
    """work := L^-T work."""
    for s in range(joints.equalities):
        r = joints.equalities - 1 - s
        first = joints.column[r]
        at = joints.start[r] - first
        value = joints.work[k, r] * joints.inverse[k, r]
        joints.work[k, r] = value
        for i in range(first, r):
            joints.work[k, i] -= joints.matrix[k, at + i] * value


@wp.func
def resists(d: JointKind, joint: Joint) -> bool:
    """Whether anything acts along the joint's axes."""
    zero = wp.float64(0.0)
    bounded = d.lower > wp.float64(-0.5 * NEVER) or d.upper < wp.float64(0.5 * NEVER)
    return d.kind == SPRING or joint.friction > zero or joint.damping > zero or d.driven > 0 or bounded


@wp.func
def held_by(joints: Joints, state: State, k: int, j: int, i: int) -> None:
    """What the joints take of a push along axis i of joint j, as L^-1 of the velocities it gives their rows."""
    d = joints.kinds[j]
    row = joints.base + joints.equalities + d.axis + i
    for r in range(joints.equalities):
        joints.work[k, r] = coupling(state, k, joints.base + r, joints.kinds[joints.row_joint[r]], row, d)
    forward(joints, k)
    for r in range(joints.equalities):
        joints.held[k, i * joints.equalities + r] = joints.work[k, r]


@wp.func
def yielding(joints: Joints, state: State, k: int, j: int, i: int, m: int) -> wp.float64:
    """Velocity along axis i of joint j for a unit impulse along its axis m while all joints hold."""
    d = joints.kinds[j]
    row = joints.base + joints.equalities + d.axis
    free = coupling(state, k, row + i, d, row + m, d)
    held = wp.float64(0.0)
    for r in range(joints.equalities):
        held += joints.held[k, i * joints.equalities + r] * joints.held[k, m * joints.equalities + r]
    if i == m and free - held <= DEPENDENT * free:
        return wp.float64(0.0)
    return free - held


@wp.func(inline=False)
def build_joint_rows(joints: Joints, state: State, k: int, lock: wp.vec3d) -> None:
    """Rows and factor of all joints at the bodies' pose, and how far they yield to a push along each axis."""
    for j in range(joints.count):
        if joints.joint[k, j].active == 1:
            write_rows(joints, state, k, j, lock)
            write_axes(joints, state, k, j, lock)
    factorise(joints, state, k)
    for j in range(joints.count):
        d = joints.kinds[j]
        if joints.joint[k, j].active == 1 and resists(d, joints.joint[k, j]):
            for i in range(d.axes):
                held_by(joints, state, k, j, i)
            if d.kind == BALL:
                for i in range(3):
                    for m in range(3):
                        joints.turning[k, j][i, m] = yielding(joints, state, k, j, i, m)
            elif d.axes == 1:
                joints.compliance[k, j] = yielding(joints, state, k, j, 0, 0)
    joints.ready[k] = 1


@wp.func(inline=False)
def hold_joints(joints: Joints, state: State, k: int) -> wp.float64:
    """Bring all rows to their aims at once. Returns the largest velocity changed [m/s or rad/s]."""
    worst = wp.float64(0.0)
    for r in range(joints.equalities):
        d = joints.kinds[joints.row_joint[r]]
        lack = joints.aim[k, r] - velocity_along(state, k, d.a, d.b, joints.base + r)
        if joints.inverse[k, r] > wp.float64(0.0):
            worst = wp.max(worst, wp.abs(lack))
        joints.work[k, r] = lack
    if worst == wp.float64(0.0):
        return worst
    forward(joints, k)
    backward(joints, k)
    for r in range(joints.equalities):
        d = joints.kinds[joints.row_joint[r]]
        push(state, k, d.a, d.b, joints.base + r, joints.work[k, r])
    return worst


@wp.func
def joint_error(
    d: JointKind, joint: Joint, xa: wp.vec3d, ra: wp.mat33d, xb: wp.vec3d, rb: wp.mat33d
) -> tuple[wp.vec3d, wp.vec3d]:
    """How far a joint is open at its point [m] and in rotation [rad], in its frame on b."""
    frame = rb * joint.frame_b
    apart = wp.transpose(frame) * (xa + ra * joint.arm_a - xb - rb * joint.arm_b)
    turned = wp.vec3d()
    if d.turns == 3:
        turned = wp.transpose(frame) * turn_error(ra * joint.frame_a, frame)
    elif d.turns == 2:
        turned = wp.transpose(frame) * axis_error(ra * joint.frame_a, frame)
    return apart, turned
