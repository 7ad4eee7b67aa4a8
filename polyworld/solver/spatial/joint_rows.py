"""Rows of joints, and the impulses that hold all of them at once.

The impulses solve (J M^-1 J^T) p = target - J v directly, by a Cholesky factor kept within its envelope (George & Liu
1981, ch. 4): a chain or a tree of joints costs time in proportion to its length, and stays together whatever the
masses. Rows that depend on others, as in closed loops, are left out.
"""

import warp as wp

from polyworld.solver.spatial.joint_layout import BALL, HINGE, SLIDER, SPRING, Joint, JointKind, Joints
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.rows import make_row, push, velocity_along, world_inverse_inertia

HELD = wp.float64(1.0e-14)  # velocity off its target that is rounding [m/s or rad/s]
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
    """Return the small rotation vector from frame b's axis to frame a's."""
    return wp.cross(column(fb, 0), column(fa, 0))


@wp.func(inline=False)
def write_rows(joints: wp.array[Joints], state: wp.array[State], k: int, j: int, lock: wp.vec3d) -> None:
    """Build the rows that joint j holds at its bodies' pose, those along which it moves, and its position."""
    d = joints[0].kinds[j]
    ia = joints[0].inverse_inertia[k, d.a]
    ib = joints[0].inverse_inertia[k, d.b]
    masses = state[0].bodies[k, d.a].inverse_mass + state[0].bodies[k, d.b].inverse_mass
    ra = state[0].bodies[k, d.a].rotation
    rb = state[0].bodies[k, d.b].rotation
    pa = ra * joints[0].joint[k, j].arm_a
    from_b = pa + state[0].bodies[k, d.a].x - state[0].bodies[k, d.b].x
    frame = rb * joints[0].joint[k, j].frame_b
    zero = wp.vec3d()
    r = joints[0].base + d.first
    for i in range(d.point, d.point + d.points):
        along = column(frame, i)
        state[0].rows[k, r] = make_row(along, wp.cross(pa, along), wp.cross(from_b, along), ia, ib, masses, lock)
        r += 1
    for i in range(d.rotation, d.rotation + d.rotations):
        about = column(frame, i)
        state[0].rows[k, r] = make_row(zero, about, about, ia, ib, masses, lock)
        r += 1
    r = joints[0].base + joints[0].equalities + d.axis
    axis = column(frame, 0)
    if d.kind == HINGE:
        state[0].rows[k, r] = make_row(zero, axis, axis, ia, ib, masses, lock)
        found = angle_between(ra * joints[0].joint[k, j].frame_a, frame)
        whole = wp.float64(6.283185307179586)
        before = joints[0].joint[k, j].position
        joints[0].joint[k, j].position = found + whole * wp.round((before - found) / whole)
    elif d.kind == SLIDER:
        state[0].rows[k, r] = make_row(axis, wp.cross(pa, axis), wp.cross(from_b, axis), ia, ib, masses, lock)
        joints[0].joint[k, j].position = wp.dot(from_b - rb * joints[0].joint[k, j].arm_b, axis)
    elif d.kind == BALL:
        for i in range(3):
            about = column(frame, i)
            state[0].rows[k, r + i] = make_row(zero, about, about, ia, ib, masses, lock)
    elif d.kind == SPRING:
        pb = rb * joints[0].joint[k, j].arm_b
        apart = from_b - pb
        length = wp.length(apart)
        axis = zero
        if length > wp.float64(1.0e-12):
            axis = apart / length
        state[0].rows[k, r] = make_row(axis, wp.cross(pa, axis), wp.cross(pb, axis), ia, ib, masses, lock)
        joints[0].joint[k, j].position = length


@wp.func
def coupling(joints: wp.array[Joints], state: wp.array[State], k: int, r: int, c: int) -> wp.float64:
    """Velocity along row r for a unit impulse along row c, through the bodies that both act on."""
    p = joints[0].base + r
    q = joints[0].base + c
    across = wp.dot(state[0].rows[k, p].d, state[0].rows[k, q].d)
    total = wp.float64(0.0)
    a = joints[0].row_a[r]
    b = joints[0].row_b[r]
    if a == joints[0].row_a[c]:
        total += across * state[0].bodies[k, a].inverse_mass + wp.dot(state[0].rows[k, p].ja, state[0].rows[k, q].wa)
    if a == joints[0].row_b[c]:
        total -= across * state[0].bodies[k, a].inverse_mass + wp.dot(state[0].rows[k, p].ja, state[0].rows[k, q].wb)
    if b == joints[0].row_a[c]:
        total -= across * state[0].bodies[k, b].inverse_mass + wp.dot(state[0].rows[k, p].jb, state[0].rows[k, q].wa)
    if b == joints[0].row_b[c]:
        total += across * state[0].bodies[k, b].inverse_mass + wp.dot(state[0].rows[k, p].jb, state[0].rows[k, q].wb)
    return total


@wp.func
def factorise(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Fill the matrix and factorise it (Cholesky), row by row."""
    zero = wp.float64(0.0)
    for r in range(joints[0].equalities):
        first = joints[0].column[r]
        at = joints[0].start[r] - first
        for c in range(first, r + 1):
            value = coupling(joints, state, k, r, c)
            whole = value
            under = joints[0].start[c] - joints[0].column[c]
            for i in range(wp.max(first, joints[0].column[c]), c):
                value -= joints[0].matrix[k, at + i] * joints[0].matrix[k, under + i]
            if c < r:
                joints[0].matrix[k, at + c] = value * joints[0].inverse[k, c]
            elif value > DEPENDENT * whole:
                joints[0].matrix[k, at + c] = wp.sqrt(value)
                joints[0].inverse[k, c] = wp.float64(1.0) / wp.sqrt(value)
            else:
                joints[0].matrix[k, at + c] = zero
                joints[0].inverse[k, c] = zero


@wp.func
def forward(joints: wp.array[Joints], k: int) -> None:
    """work := L^-1 work."""
    for r in range(joints[0].equalities):
        first = joints[0].column[r]
        at = joints[0].start[r] - first
        value = joints[0].work[k, r]
        for i in range(first, r):
            value -= joints[0].matrix[k, at + i] * joints[0].work[k, i]
        joints[0].work[k, r] = value * joints[0].inverse[k, r]


@wp.func
def backward(joints: wp.array[Joints], k: int) -> None:
    """work := L^-T work."""
    for s in range(joints[0].equalities):
        r = joints[0].equalities - 1 - s
        first = joints[0].column[r]
        at = joints[0].start[r] - first
        value = joints[0].work[k, r] * joints[0].inverse[k, r]
        joints[0].work[k, r] = value
        for i in range(first, r):
            joints[0].work[k, i] -= joints[0].matrix[k, at + i] * value


@wp.func
def resists(d: JointKind, joint: Joint) -> bool:
    """Check whether anything acts along the joint's axes."""
    zero = wp.float64(0.0)
    return d.kind == SPRING or joint.friction > zero or joint.damping > zero or d.driven > 0 or d.bounded > 0


@wp.func(inline=False)
def build_axes(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Compute the compliance of all axes along which something acts, while the joints hold."""
    n = joints[0].equalities
    for j in range(joints[0].count):
        if joints[0].resists[k, j] == 1:
            for i in range(joints[0].kinds[j].axis, joints[0].kinds[j].axis + joints[0].kinds[j].axes):
                for r in range(n):
                    joints[0].work[k, r] = coupling(joints, state, k, r, n + i)
                forward(joints, k)
                for r in range(n):
                    joints[0].held[k, i * n + r] = joints[0].work[k, r]
    for j in range(joints[0].count):
        if joints[0].resists[k, j] == 1:
            for i in range(joints[0].kinds[j].axis, joints[0].kinds[j].axis + joints[0].kinds[j].axes):
                for q in range(j + 1):
                    if joints[0].resists[k, q] == 1:
                        for m in range(joints[0].kinds[q].axis, joints[0].kinds[q].axis + joints[0].kinds[q].axes):
                            free = coupling(joints, state, k, n + i, n + m)
                            own = free
                            for r in range(n):
                                own -= joints[0].held[k, i * n + r] * joints[0].held[k, m * n + r]
                            if i == m and own <= DEPENDENT * free:
                                own = wp.float64(0.0)  # held fast by the other joints
                            joints[0].yields[k, i * joints[0].axes + m] = own
                            joints[0].yields[k, m * joints[0].axes + i] = own


@wp.func(inline=False)
def build_joint_rows(joints: wp.array[Joints], state: wp.array[State], k: int, lock: wp.vec3d) -> None:
    """Rows and factor of all joints at the bodies' pose, and how far they yield to a push along each axis."""
    for i in range(state[0].objects):
        if joints[0].jointed[i] == 1:
            joints[0].inverse_inertia[k, i] = world_inverse_inertia(state[0].bodies, k, i)
    for j in range(joints[0].count):
        if joints[0].joint[k, j].active == 1:
            write_rows(joints, state, k, j, lock)
    factorise(joints, state, k)
    acting = wp.int32(0)
    for j in range(joints[0].count):
        joints[0].resists[k, j] = 0
        if joints[0].joint[k, j].active == 1 and resists(joints[0].kinds[j], joints[0].joint[k, j]):
            joints[0].resists[k, j] = 1
            acting = 1
    if acting == 1:
        build_axes(joints, state, k)
    joints[0].ready[k] = 1


@wp.func(inline=False)
def hold_joints(joints: wp.array[Joints], state: wp.array[State], k: int) -> wp.float64:
    """Solve all rows for their targets at once. Returns the largest velocity changed [m/s or rad/s]."""
    worst = wp.float64(0.0)
    for r in range(joints[0].equalities):
        lack = joints[0].target[k, r] - velocity_along(
            state, k, joints[0].row_a[r], joints[0].row_b[r], joints[0].base + r
        )
        if joints[0].inverse[k, r] > wp.float64(0.0):
            worst = wp.max(worst, wp.abs(lack))
        joints[0].work[k, r] = lack
    if worst <= HELD:
        return wp.float64(0.0)
    forward(joints, k)
    backward(joints, k)
    for r in range(joints[0].equalities):
        push(state, k, joints[0].row_a[r], joints[0].row_b[r], joints[0].base + r, joints[0].work[k, r])
    return worst


@wp.func
def joint_error(
    d: JointKind, joint: Joint, xa: wp.vec3d, ra: wp.mat33d, xb: wp.vec3d, rb: wp.mat33d
) -> tuple[wp.vec3d, wp.vec3d]:
    """Return a joint's error at its point [m] and in rotation [rad], in its frame on b."""
    frame = rb * joint.frame_b
    apart = wp.transpose(frame) * (xa + ra * joint.arm_a - xb - rb * joint.arm_b)
    rotated = wp.vec3d()
    if d.rotations == 3:
        rotated = wp.transpose(frame) * turn_error(ra * joint.frame_a, frame)
    elif d.rotations == 2:
        rotated = wp.transpose(frame) * axis_error(ra * joint.frame_a, frame)
    return apart, rotated
