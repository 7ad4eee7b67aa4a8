"""Joints over a step: the scheme RATTLE.

The impulses that hold the joints act half at the start of the step, such that its end pose satisfies them, and
half at its end, such that the velocities there do (Andersen 1983, J. Comput. Phys. 52, 24; for rigid bodies
Dullweber, Leimkuhler & McLachlan 1997, J. Chem. Phys. 107, 5840). Both act at the joint's point as it then is. The
scheme is symmetric and second order, keeps momentum and angular momentum, and energy without a drift; trees that touch
nothing do without it (`tree_step`). What acts along the axes is halved in the same way.
"""

import warp as wp

from polyworld.solver.spatial.contact_solve import contact_solver
from polyworld.solver.spatial.impacts import impact_solver, kinetic_energy
from polyworld.solver.spatial.joint_ahead import guess_axes, look_ahead
from polyworld.solver.spatial.joint_axes import (
    forget,
    move_axes,
    remove_axis_impulses,
    set_stop_targets,
    stop_joints,
    time_to_stop,
)
from polyworld.solver.spatial.joint_guess import push_as_before, remember_forces, remove_warm_start
from polyworld.solver.spatial.joint_layout import SPRING, Joint, Joints
from polyworld.solver.spatial.joint_rows import backward, build_joint_rows, forward, hold_joints, joint_error
from polyworld.solver.spatial.layout import Body, Row, State
from polyworld.solver.spatial.motion import rotated, set_pose
from polyworld.solver.spatial.rows import push, velocity_along
from polyworld.solver.spatial.step import Joining

NEWTON_STEPS = 20
CLOSED = wp.float64(1.0e-12)  # opening of a joint that counts as none [m or rad]
DIVERGED = wp.float64(1.0e-8)  # opening above which Newton's method has not converged
OPEN = wp.float64(1.0e-10)  # opening left after a step, by overlaps parted, that is projected out
PROJECTIONS = 4
RESOLVED = wp.float64(0.5)  # radians of a taut joint's swing in a step
MOST_PARTS = 64  # into which taut joints cut a step


@wp.func
def hold(joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64, contacts: int) -> wp.float64:
    """Solve all joints and then their axes for their targets, as they stay unless contacts disturb them.

    Returns the largest velocity changed that asks for another sweep.
    """
    held = hold_joints(joints, state, k)
    moved = move_axes(joints, state, k, h)
    if contacts > 0:
        return wp.max(held, moved)
    return moved


@wp.func
def total_energy(_joints: wp.array[Joints], state: wp.array[State], k: int, _a: int, _b: int) -> wp.float64:
    """Kinetic energy [J]: whatever hangs together may be moved by an impact."""
    total = wp.float64(0.0)
    for i in range(state[0].objects):
        total += kinetic_energy(state[0].bodies[k, i])
    return total


@wp.func
def undo_joints(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Undo what the joints did in an impact."""
    remove_axis_impulses(joints, state, k)
    hold_joints(joints, state, k)


solve_manifolds, solve_contacts = contact_solver(hold, accelerated=False)


@wp.func
def load_joints(joints: wp.array[Joints], state: wp.array[State], w: int, k: int) -> None:
    """Row k of the joints: those of world w, where its bodies start; none is active."""
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        a = state[0].bodies[k, d.a]
        b = state[0].bodies[k, d.b]
        joint = Joint()
        joint.arm_a = joints[0].anchor[w % joints[0].anchor.shape[0], d.column]
        joint.arm_b = joints[0].other_anchor[w % joints[0].other_anchor.shape[0], d.column]
        if d.kind != SPRING:
            joint.arm_a = wp.transpose(a.rotation) * (joint.arm_a - a.x)
            joint.arm_b = wp.transpose(b.rotation) * (joint.arm_b - b.x)
        joint.frame_a = wp.transpose(a.rotation) * d.frame
        joint.frame_b = wp.transpose(b.rotation) * d.frame
        joint.friction = joints[0].friction[w % joints[0].friction.shape[0], d.column]
        joint.damping = joints[0].damping[w % joints[0].damping.shape[0], d.column]
        joint.stiffness = joints[0].stiffness[w % joints[0].stiffness.shape[0], d.column]
        joint.target_speed = joints[0].target_speed[w % joints[0].target_speed.shape[0], d.column]
        joint.effort = d.direction * joints[0].limit[w % joints[0].limit.shape[0], d.column]
        joint.delay = joints[0].delay[w % joints[0].delay.shape[0], d.column]
        joint.lower = joints[0].lower[w % joints[0].lower.shape[0], d.column]
        joint.upper = joints[0].upper[w % joints[0].upper.shape[0], d.column]
        joint.rest_length = d.rest_length
        joints[0].joint[k, j] = joint
        joints[0].resists[k, j] = 0
    for r in range(joints[0].equalities + joints[0].axes):
        state[0].rows[k, joints[0].base + r] = Row()
    for r in range(joints[0].equalities):
        joints[0].force[k, r] = wp.float64(0.0)
    joints[0].ready[k] = 0
    joints[0].tree.known[k] = 0
    for n in range(joints[0].tree.count):
        joints[0].tree.links[k, n].bend = wp.float64(0.0)
    joints[0].tree.wanted[k] = wp.float64(0.0)
    joints[0].tree.clear[k] = wp.float64(0.0)


@wp.func
def clear_targets(joints: wp.array[Joints], k: int) -> None:
    for r in range(joints[0].equalities):
        joints[0].target[k, r] = wp.float64(0.0)


@wp.func
def activate_joints(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Activate joints whose bodies both take part."""
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        if joints[0].joint[k, j].active == 0 and state[0].bodies[k, d.a].active + state[0].bodies[k, d.b].active == 2:
            joints[0].joint[k, j].active = 1
            joints[0].ready[k] = 0


@wp.func(inline=False)
def solve_joint_velocities(joints: wp.array[Joints], state: wp.array[State], k: int, lock: wp.vec3d) -> None:
    """Rows at this pose; velocities that would pull a joint apart, or run it into a stop, are taken up at once."""
    activate_joints(joints, state, k)
    for j in range(joints[0].count):
        forget(joints, k, j)
    if joints[0].ready[k] == 0:
        build_joint_rows(joints, state, k, lock)
    clear_targets(joints, k)
    hold_joints(joints, state, k)
    stop_joints(joints, state, k)


@wp.func(inline=False)
def begin_joints(joints: wp.array[Joints], state: wp.array[State], k: int, time: wp.float64, h: wp.float64) -> None:
    """Note what the bodies do before a step of length h, and clear the impulses."""
    zero = wp.float64(0.0)
    for i in range(state[0].objects):
        joints[0].start_w[k, i] = state[0].bodies[k, i].w
    for r in range(joints[0].equalities + joints[0].axes):
        state[0].rows[k, joints[0].base + r].impulse = zero
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        speed = wp.vec3d()
        for i in range(d.axes):
            speed[i] = velocity_along(state, k, d.a, d.b, joints[0].base + joints[0].equalities + d.axis + i)
        joints[0].joint[k, j].is_final = 0
        joints[0].joint[k, j].speed = speed
        joints[0].joint[k, j].seen_speed = speed[0]
        joints[0].joint[k, j].position_at_end = joints[0].joint[k, j].position + h * speed[0]
        delay = joints[0].joint[k, j].delay
        on = wp.min(time + h, d.switched_off + delay) - wp.max(time, d.switched_on + delay)
        joints[0].joint[k, j].drive = wp.max(on, zero)
    set_stop_targets(joints, k, h)


@wp.func(inline=False)
def solve_joints(joints: wp.array[Joints], state: wp.array[State], k: int, half: int, h: wp.float64) -> None:
    """Solve impulses of joints and contacts for an end pose that satisfies the joints: Newton's method.

    It starts from the forces of the last step; where that does not converge, from none.
    """
    push_as_before(joints, state, k, h)
    guess_axes(joints, state, k, h)
    last = wp.float64(1.0e30)
    again = wp.int32(0)
    for iteration in range(NEWTON_STEPS):
        opening = look_ahead(joints, state, k, h)
        if iteration > 0 and (opening <= CLOSED or opening > wp.float64(0.5) * last):
            if opening <= DIVERGED or again == 1:
                return
            again = wp.int32(1)
            remove_warm_start(joints, state, k)
            opening = look_ahead(joints, state, k, h)
        last = opening
        solve_contacts(joints, state, k, half, h)
    look_ahead(joints, state, k, h)


@wp.func
def longest_part(
    joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64, left: wp.float64
) -> wp.float64:
    """Longest part of a step of length h, of which `left` is left, that resolves bodies swinging on taut joints.

    A taut joint pulls a body back like a pendulum of frequency^2 tension * arm / (inertia about the joint's point);
    explicit schemes need a step below two over the frequency.
    """
    fastest = wp.float64(0.0)
    for j in range(joints[0].count):
        tension = joints[0].joint[k, j].tension
        if joints[0].joint[k, j].active == 1 and tension > wp.float64(0.0):
            a = joints[0].kinds[j].a
            fastest = wp.max(fastest, tension * swinging(state[0].bodies[k, a], joints[0].joint[k, j].arm_a))
            b = joints[0].kinds[j].b
            if b < state[0].objects:
                fastest = wp.max(fastest, tension * swinging(state[0].bodies[k, b], joints[0].joint[k, j].arm_b))
    if fastest * left * left <= RESOLVED * RESOLVED:
        return left
    return wp.min(wp.max(RESOLVED / wp.sqrt(fastest), h / wp.float64(MOST_PARTS)), left)


@wp.func
def carries(joints: wp.array[Joints], i: int) -> bool:
    """Check whether a body is held by a joint, which then sets its pose."""
    return joints[0].jointed[i] == 1


@wp.func
def swinging(b: Body, arm: wp.vec3d) -> wp.float64:
    """Arm over moment of inertia about its end, per unit force [1/(kg m)]."""
    square = wp.dot(arm, arm)
    trace = b.inverse_inertia[0, 0] + b.inverse_inertia[1, 1] + b.inverse_inertia[2, 2]
    own = wp.float64(3.0) / wp.max(trace, wp.float64(1.0e-30))
    return wp.sqrt(square) * b.inverse_mass / (own + square)


@wp.func
def push_halves(
    joints: wp.array[Joints], state: wp.array[State], k: int, first: int, end: int, sign: wp.float64
) -> None:
    """Add half (sign 1), or remove half (sign -1), of the impulses of the rows [first, end)."""
    for r in range(first, end):
        row = joints[0].base + r
        impulse = joints[0].half_impulse[k, r]
        if sign < wp.float64(0.0):
            impulse = wp.float64(0.5) * state[0].rows[k, row].impulse
            joints[0].half_impulse[k, r] = impulse
        if impulse != wp.float64(0.0):
            push(state, k, joints[0].row_a[r], joints[0].row_b[r], row, sign * impulse)


@wp.func
def move_bodies(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Move bodies by as much as closes the openings in `work`, each according to its mass."""
    forward(joints, k)
    backward(joints, k)
    for r in range(joints[0].equalities):
        a = joints[0].row_a[r]
        b = joints[0].row_b[r]
        row = state[0].rows[k, joints[0].base + r]
        p = joints[0].work[k, r]
        state[0].bodies[k, a].shift += row.d * (p * state[0].bodies[k, a].inverse_mass)
        state[0].bodies[k, a].rotation_shift += row.wa * p
        state[0].bodies[k, b].shift -= row.d * (p * state[0].bodies[k, b].inverse_mass)
        state[0].bodies[k, b].rotation_shift -= row.wb * p
    for i in range(state[0].objects):
        if joints[0].jointed[i] == 1:
            q = rotated(state[0].bodies[k, i].q, state[0].bodies[k, i].rotation_shift)
            state[0].bodies[k, i].x += state[0].bodies[k, i].shift
            state[0].bodies[k, i].q = q
            state[0].bodies[k, i].rotation = wp.quat_to_matrix(q)
            state[0].bodies[k, i].shift = wp.vec3d()
            state[0].bodies[k, i].rotation_shift = wp.vec3d()


@wp.func(inline=False)
def project_joints(joints: wp.array[Joints], state: wp.array[State], k: int, lock: wp.vec3d) -> None:
    """Project poses onto the joints, which parting overlaps has opened, without changing velocities."""
    for _pass in range(PROJECTIONS):
        worst = wp.float64(0.0)
        for j in range(joints[0].count):
            d = joints[0].kinds[j]
            if d.kind == SPRING or joints[0].joint[k, j].active == 0:
                continue
            a = state[0].bodies[k, d.a]
            b = state[0].bodies[k, d.b]
            apart, askew = joint_error(d, joints[0].joint[k, j], a.x, a.rotation, b.x, b.rotation)
            r = d.first
            for i in range(d.point, d.point + d.points):
                joints[0].work[k, r] = -apart[i]
                if joints[0].inverse[k, r] > wp.float64(0.0):
                    worst = wp.max(worst, wp.abs(apart[i]))
                r += 1
            for i in range(d.rotation, d.rotation + d.rotations):
                joints[0].work[k, r] = -askew[i]
                if joints[0].inverse[k, r] > wp.float64(0.0):
                    worst = wp.max(worst, wp.abs(askew[i]))
                r += 1
        if worst < OPEN:
            return
        move_bodies(joints, state, k)
        build_joint_rows(joints, state, k, lock)


@wp.func(inline=False)
def finish_joints(
    joints: wp.array[Joints], state: wp.array[State], k: int, half: int, h: wp.float64, lock: wp.vec3d
) -> None:
    """Set the end poses of jointed bodies, and apply the second half of all impulses there."""
    rows = joints[0].equalities + joints[0].axes
    remember_forces(joints, state, k, h)
    push_halves(joints, state, k, 0, rows, wp.float64(-1.0))
    for i in range(state[0].objects):
        if joints[0].jointed[i] == 1 and state[0].bodies[k, i].active == 1:
            set_pose(state[0].bodies, k, i, joints[0].end_x[k, i], joints[0].end_q[k, i])
    build_joint_rows(joints, state, k, lock)
    push_halves(joints, state, k, joints[0].equalities, rows, wp.float64(1.0))
    clear_targets(joints, k)
    set_stop_targets(joints, k, wp.float64(0.0))
    for j in range(joints[0].count):
        joints[0].joint[k, j].is_final = 1
        joints[0].joint[k, j].last_rubbing = joints[0].joint[k, j].rubbing / h
        joints[0].joint[k, j].last_damped = joints[0].joint[k, j].damped / h
        joints[0].joint[k, j].last_pulled = joints[0].joint[k, j].pulled / h
    solve_contacts(joints, state, k, half, h)
    project_joints(joints, state, k, lock)


JOINED = Joining(
    solve_velocities=solve_joint_velocities,
    longest_part=longest_part,
    time_to_stop=time_to_stop,
    resolve_impacts=impact_solver(solve_manifolds, total_energy, undo_joints),
    begin=begin_joints,
    solve=solve_joints,
    carries=carries,
    finish=finish_joints,
    early=0.0,
)
