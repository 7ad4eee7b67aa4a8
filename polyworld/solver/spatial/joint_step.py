"""Joints over a step: the scheme RATTLE.

The impulses that hold the joints act half at the start of the step, such that its end pose satisfies them, and
half at its end, such that the velocities there do (Andersen 1983, J. Comput. Phys. 52, 24; for rigid bodies
Dullweber, Leimkuhler & McLachlan 1997, J. Chem. Phys. 107, 5840). Both act at the joint's point as it then is. The
scheme is symmetric and second order, keeps momentum and angular momentum, and energy without a drift. What acts
along the axes is halved in the same way.
"""

import warp as wp

from polyworld.solver.spatial.advance import Joining
from polyworld.solver.spatial.constraints import contact_solver
from polyworld.solver.spatial.impacts import impact_solver, kinetic_energy
from polyworld.solver.spatial.joint_axes import aim_at_stops, forget, let_go, move_axes, stop_joints, time_to_stop
from polyworld.solver.spatial.joint_layout import SPRING, Joint, Joints
from polyworld.solver.spatial.joint_rows import backward, build_joint_rows, forward, hold_joints, joint_error
from polyworld.solver.spatial.layout import Body, Row, State
from polyworld.solver.spatial.motion import place, remaining, spun, turned
from polyworld.solver.spatial.rows import push, velocity_along

NEWTON_STEPS = 20
CLOSED = wp.float64(1.0e-12)  # opening of a joint that counts as none [m or rad]
OPEN = wp.float64(1.0e-10)  # what is left open after a step, by overlaps parted, and then mended
MENDING = 4
RESOLVED = wp.float64(0.5)  # radians of a taut joint's swing in a step
MOST_PARTS = 64  # into which taut joints cut a step


@wp.func
def hold(joints: Joints, state: State, k: int, h: wp.float64, contacts: int) -> wp.float64:
    """Bring all joints and then their axes to their aims, as they stay unless there are contacts to disturb them.

    Returns the largest velocity changed that asks for another sweep.
    """
    held = hold_joints(joints, state, k)
    moved = move_axes(joints, state, k, h)
    if contacts > 0:
        return wp.max(held, moved)
    return moved


@wp.func
def total_energy(_joints: Joints, state: State, k: int, _a: int, _b: int) -> wp.float64:
    """Kinetic energy [J]: whatever hangs together may be moved by an impact."""
    total = wp.float64(0.0)
    for i in range(state.objects):
        total += kinetic_energy(state.bodies[k, i])
    return total


@wp.func
def take_back(joints: Joints, state: State, k: int) -> None:
    """Undo what the joints did in an impact."""
    let_go(joints, state, k)
    hold_joints(joints, state, k)


solve_manifolds, solve_contacts = contact_solver(hold)


@wp.func
def load_joints(joints: Joints, state: State, w: int, k: int) -> None:
    """Row k of the joints: those of world w, where its bodies start; none is active."""
    for j in range(joints.count):
        d = joints.kinds[j]
        a = state.bodies[k, d.a]
        b = state.bodies[k, d.b]
        joint = Joint()
        joint.arm_a = wp.transpose(a.rotation) * (d.anchor - a.x)
        joint.arm_b = wp.transpose(b.rotation) * (d.other_anchor - b.x)
        joint.frame_a = wp.transpose(a.rotation) * d.frame
        joint.frame_b = wp.transpose(b.rotation) * d.frame
        joint.friction = joints.friction[w % joints.friction.shape[0], d.column]
        joint.damping = joints.damping[w % joints.damping.shape[0], d.column]
        joint.stiffness = joints.stiffness[w % joints.stiffness.shape[0], d.column]
        joint.target_speed = joints.target_speed[w % joints.target_speed.shape[0], d.column]
        joint.effort = d.direction * joints.limit[w % joints.limit.shape[0], d.column]
        joint.delay = joints.delay[w % joints.delay.shape[0], d.column]
        joint.rest_length = d.rest_length
        if d.rest_length < wp.float64(0.0):
            joint.rest_length = wp.length(d.anchor - d.other_anchor)
        joints.joint[k, j] = joint
        joints.resists[k, j] = 0
    for r in range(joints.equalities + joints.axes):
        state.rows[k, joints.base + r] = Row()
    for r in range(joints.equalities):
        joints.force[k, r] = wp.float64(0.0)
    joints.ready[k] = 0


@wp.func
def no_aims(joints: Joints, k: int) -> None:
    for r in range(joints.equalities):
        joints.aim[k, r] = wp.float64(0.0)


@wp.func(inline=False)
def settle_joints(joints: Joints, state: State, k: int, lock: wp.vec3d) -> None:
    """Rows at this pose; velocities that would pull a joint apart, or run it into a stop, are taken up at once."""
    for j in range(joints.count):
        d = joints.kinds[j]
        if joints.joint[k, j].active == 0 and state.bodies[k, d.a].active + state.bodies[k, d.b].active == 2:
            joints.joint[k, j].active = 1
            joints.ready[k] = 0
        forget(joints, k, j)
    if joints.ready[k] == 0:
        build_joint_rows(joints, state, k, lock)
    no_aims(joints, k)
    hold_joints(joints, state, k)
    stop_joints(joints, state, k)


@wp.func(inline=False)
def begin_joints(joints: Joints, state: State, k: int, time: wp.float64, h: wp.float64) -> None:
    """Note what the bodies do before a step of length h, and clear the impulses."""
    zero = wp.float64(0.0)
    for i in range(state.objects):
        joints.start_w[k, i] = state.bodies[k, i].w
    for r in range(joints.equalities + joints.axes):
        state.rows[k, joints.base + r].impulse = zero
    for j in range(joints.count):
        d = joints.kinds[j]
        speed = wp.vec3d()
        for i in range(d.axes):
            speed[i] = velocity_along(state, k, d.a, d.b, joints.base + joints.equalities + d.axis + i)
        joints.joint[k, j].settled = 0
        joints.joint[k, j].speed = speed
        joints.joint[k, j].seen_speed = speed[0]
        joints.joint[k, j].end_place = joints.joint[k, j].place + h * speed[0]
        delay = joints.joint[k, j].delay
        on = wp.min(time + h, d.switched_off + delay) - wp.max(time, d.switched_on + delay)
        joints.joint[k, j].drive = wp.max(on, zero)
    aim_at_stops(joints, k, h)


@wp.func
def held_orientation(b: Body, start_w: wp.vec3d, h: wp.float64) -> wp.quatd:
    """Orientation at the step's end: half of all angular impulses at its start, then free rotation."""
    half = wp.float64(0.5)
    damped = remaining(b.angular_damping, h)
    dw = b.w - b.w_free
    if b.isotropic == 1:
        turning = b.w_free - start_w * damped[0]
        return turned(b.q, (start_w * damped[1] + (turning + dw) * half) * h)
    start = b.rotation * (b.inertia * (wp.transpose(b.rotation) * start_w)) * b.mass
    impulse = b.rotation * (b.inertia * (wp.transpose(b.rotation) * dw)) * b.mass
    return spun(b, start * damped[1] + (b.angular_momentum - start * damped[0] + impulse) * half, h)


@wp.func
def look_ahead(joints: Joints, state: State, k: int, h: wp.float64) -> wp.float64:
    """Where the step ends with the velocities so far, and the velocities to aim at so that all joints are closed there.

    Returns by how much the worst is open.
    """
    half = wp.float64(0.5) * h
    for i in range(state.objects):
        if joints.jointed[i] == 1 and state.bodies[k, i].active == 1:
            b = state.bodies[k, i]
            joints.end_x[k, i] = b.x + b.dx + (b.v - b.v_free) * half
            q = held_orientation(b, joints.start_w[k, i], h)
            joints.end_q[k, i] = q
            joints.end_rotation[k, i] = wp.quat_to_matrix(q)
    worst = wp.float64(0.0)
    for j in range(joints.count):
        if joints.joint[k, j].active == 0:
            continue
        d = joints.kinds[j]
        joint = joints.joint[k, j]
        xa = joints.end_x[k, d.a]
        ra = joints.end_rotation[k, d.a]
        xb = state.bodies[k, d.b].x
        rb = state.bodies[k, d.b].rotation
        if d.b < state.objects:
            xb = joints.end_x[k, d.b]
            rb = joints.end_rotation[k, d.b]
        if d.kind == SPRING:
            row = joints.base + joints.equalities + d.axis
            v = velocity_along(state, k, d.a, d.b, row)
            apart = xa + ra * joint.arm_a - xb - rb * joint.arm_b
            length = wp.length(apart)
            if wp.dot(apart, state.rows[k, row].d) < wp.float64(0.0):  # its ends pass each other
                length = -length
            guess = joint.end_place + half * (v - joint.seen_speed)
            worst = wp.max(worst, wp.abs(length - guess))
            joints.joint[k, j].end_place = length
            joints.joint[k, j].seen_speed = v
            continue
        opened, askew = joint_error(d, joint, xa, ra, xb, rb)
        r = d.first
        for i in range(d.point, d.point + d.points):
            joints.aim[k, r] = velocity_along(state, k, d.a, d.b, joints.base + r) - opened[i] / half
            if joints.inverse[k, r] > wp.float64(0.0):
                worst = wp.max(worst, wp.abs(opened[i]))
            r += 1
        for i in range(d.turn, d.turn + d.turns):
            joints.aim[k, r] = velocity_along(state, k, d.a, d.b, joints.base + r) - askew[i] / half
            if joints.inverse[k, r] > wp.float64(0.0):
                worst = wp.max(worst, wp.abs(askew[i]))
            r += 1
    return worst


@wp.func
def guess_axes(joints: Joints, state: State, k: int, h: wp.float64) -> None:
    """Begin with the resistance of the last step along all axes."""
    for j in range(joints.count):
        if joints.resists[k, j] == 1:
            rubbing = joints.joint[k, j].last_rubbing * h
            damped = joints.joint[k, j].last_damped * h
            pulled = joints.joint[k, j].last_pulled * h
            joints.joint[k, j].rubbing = rubbing
            joints.joint[k, j].damped = damped
            joints.joint[k, j].pulled = pulled
            for i in range(joints.kinds[j].axes):
                r = joints.equalities + joints.kinds[j].axis + i
                p = rubbing[i] + damped[i]
                if i == 0:
                    p += pulled
                push(state, k, joints.row_a[r], joints.row_b[r], joints.base + r, p)


@wp.func(inline=False)
def solve_joints(joints: Joints, state: State, k: int, half: int, h: wp.float64) -> None:
    """Impulses of joints and contacts over the step, such that its end pose satisfies the joints: Newton's method.

    The forces of the last step, which turn with the joints, are a guess to begin with.
    """
    for r in range(joints.equalities):
        if joints.force[k, r] != wp.float64(0.0):
            push(state, k, joints.row_a[r], joints.row_b[r], joints.base + r, joints.force[k, r] * h)
    guess_axes(joints, state, k, h)
    last = wp.float64(1.0e30)
    for iteration in range(NEWTON_STEPS):
        opening = look_ahead(joints, state, k, h)
        if iteration > 0 and (opening <= CLOSED or opening > wp.float64(0.5) * last):
            return
        last = opening
        solve_contacts(joints, state, k, half, h)
    look_ahead(joints, state, k, h)


@wp.func
def longest_part(joints: Joints, state: State, k: int, h: wp.float64, left: wp.float64) -> wp.float64:
    """Longest part of a step of length h, of which `left` is left, that resolves bodies swinging on taut joints.

    A taut joint pulls a body back like a pendulum of frequency^2 tension * arm / (inertia about the joint's point);
    explicit schemes need a step below two over the frequency.
    """
    fastest = wp.float64(0.0)
    for j in range(joints.count):
        tension = joints.joint[k, j].tension
        if joints.joint[k, j].active == 1 and tension > wp.float64(0.0):
            a = joints.kinds[j].a
            fastest = wp.max(fastest, tension * swinging(state.bodies[k, a], joints.joint[k, j].arm_a))
            b = joints.kinds[j].b
            if b < state.objects:
                fastest = wp.max(fastest, tension * swinging(state.bodies[k, b], joints.joint[k, j].arm_b))
    if fastest * left * left <= RESOLVED * RESOLVED:
        return left
    return wp.min(wp.max(RESOLVED / wp.sqrt(fastest), h / wp.float64(MOST_PARTS)), left)


@wp.func
def carries(joints: Joints, i: int) -> bool:
    """Whether a body is held by a joint, and is put in its place with it."""
    return joints.jointed[i] == 1


@wp.func
def swinging(b: Body, arm: wp.vec3d) -> wp.float64:
    """Arm over moment of inertia about its end, per unit force [1/(kg m)]."""
    square = wp.dot(arm, arm)
    trace = b.inverse_inertia[0, 0] + b.inverse_inertia[1, 1] + b.inverse_inertia[2, 2]
    own = wp.float64(3.0) / wp.max(trace, wp.float64(1.0e-30))
    return wp.sqrt(square) * b.inverse_mass / (own + square)


@wp.func
def push_halves(joints: Joints, state: State, k: int, first: int, end: int, sign: wp.float64) -> None:
    """Add half (sign 1), or take back half (sign -1), of the impulses of the rows [first, end)."""
    for r in range(first, end):
        row = joints.base + r
        impulse = joints.half_impulse[k, r]
        if sign < wp.float64(0.0):
            impulse = wp.float64(0.5) * state.rows[k, row].impulse
            joints.half_impulse[k, r] = impulse
        if impulse != wp.float64(0.0):
            push(state, k, joints.row_a[r], joints.row_b[r], row, sign * impulse)


@wp.func
def move_bodies(joints: Joints, state: State, k: int) -> None:
    """Move bodies by as much as closes the openings in `work`, each according to its mass."""
    forward(joints, k)
    backward(joints, k)
    for r in range(joints.equalities):
        a = joints.row_a[r]
        b = joints.row_b[r]
        row = state.rows[k, joints.base + r]
        p = joints.work[k, r]
        state.bodies[k, a].shift += row.d * (p * state.bodies[k, a].inverse_mass)
        state.bodies[k, a].turn += row.wa * p
        state.bodies[k, b].shift -= row.d * (p * state.bodies[k, b].inverse_mass)
        state.bodies[k, b].turn -= row.wb * p
    for i in range(state.objects):
        if joints.jointed[i] == 1:
            q = turned(state.bodies[k, i].q, state.bodies[k, i].turn)
            state.bodies[k, i].x += state.bodies[k, i].shift
            state.bodies[k, i].q = q
            state.bodies[k, i].rotation = wp.quat_to_matrix(q)
            state.bodies[k, i].shift = wp.vec3d()
            state.bodies[k, i].turn = wp.vec3d()


@wp.func(inline=False)
def mend_joints(joints: Joints, state: State, k: int, lock: wp.vec3d) -> None:
    """Close what overlaps that were parted have opened, without giving anything speed."""
    for _pass in range(MENDING):
        worst = wp.float64(0.0)
        for j in range(joints.count):
            d = joints.kinds[j]
            if d.kind == SPRING or joints.joint[k, j].active == 0:
                continue
            a = state.bodies[k, d.a]
            b = state.bodies[k, d.b]
            apart, askew = joint_error(d, joints.joint[k, j], a.x, a.rotation, b.x, b.rotation)
            r = d.first
            for i in range(d.point, d.point + d.points):
                joints.work[k, r] = -apart[i]
                if joints.inverse[k, r] > wp.float64(0.0):
                    worst = wp.max(worst, wp.abs(apart[i]))
                r += 1
            for i in range(d.turn, d.turn + d.turns):
                joints.work[k, r] = -askew[i]
                if joints.inverse[k, r] > wp.float64(0.0):
                    worst = wp.max(worst, wp.abs(askew[i]))
                r += 1
        if worst < OPEN:
            return
        move_bodies(joints, state, k)
        build_joint_rows(joints, state, k, lock)


@wp.func(inline=False)
def finish_joints(joints: Joints, state: State, k: int, half: int, h: wp.float64, lock: wp.vec3d) -> None:
    """Put jointed bodies where the step ends, and let the second half of all impulses act there."""
    rows = joints.equalities + joints.axes
    for j in range(joints.count):
        d = joints.kinds[j]
        pull = wp.float64(0.0)
        for r in range(joints.base + d.first, joints.base + d.first + d.points):
            pull += state.rows[k, r].impulse * state.rows[k, r].impulse
            joints.force[k, r - joints.base] = state.rows[k, r].impulse / h
        for r in range(d.first + d.points, d.first + d.points + d.turns):
            joints.force[k, r] = state.rows[k, joints.base + r].impulse / h
        joints.joint[k, j].tension = wp.sqrt(pull) / h
    push_halves(joints, state, k, 0, rows, wp.float64(-1.0))
    for i in range(state.objects):
        if joints.jointed[i] == 1 and state.bodies[k, i].active == 1:
            state.bodies[k, i] = place(state.bodies[k, i], joints.end_x[k, i], joints.end_q[k, i])
    build_joint_rows(joints, state, k, lock)
    push_halves(joints, state, k, joints.equalities, rows, wp.float64(1.0))
    no_aims(joints, k)
    aim_at_stops(joints, k, wp.float64(0.0))
    for j in range(joints.count):
        joints.joint[k, j].settled = 1
        joints.joint[k, j].last_rubbing = joints.joint[k, j].rubbing / h
        joints.joint[k, j].last_damped = joints.joint[k, j].damped / h
        joints.joint[k, j].last_pulled = joints.joint[k, j].pulled / h
    solve_contacts(joints, state, k, half, h)
    mend_joints(joints, state, k, lock)


JOINED = Joining(
    settle=settle_joints,
    longest_part=longest_part,
    time_to_stop=time_to_stop,
    resolve_impacts=impact_solver(solve_manifolds, total_energy, take_back),
    begin=begin_joints,
    solve=solve_joints,
    carries=carries,
    finish=finish_joints,
)
