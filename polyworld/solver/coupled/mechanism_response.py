"""How jointed bodies yield to impulses while their joints hold, found once in a coupling step.

Of the joints' rows J and the bodies' masses M the response is M^-1 - M^-1 J^T (J M^-1 J^T)^-1 J M^-1, by the Cholesky
factor that the rigid solver has of the middle matrix. An axis that sticks, is driven or stopped holds too; a damped one
yields as in an implicit step: each takes u u^T / (a u + softness) off, u being the response along the axis a.
"""

import warp as wp

from polyworld.effects.law import wrench
from polyworld.solver.coupled.mechanism import Mechanisms
from polyworld.solver.coupled.nodes import Clock
from polyworld.solver.spatial.joint_layout import SPRING, Joints
from polyworld.solver.spatial.joint_rows import backward, build_joint_rows, forward
from polyworld.solver.spatial.joint_step import activate_joints
from polyworld.solver.spatial.joint_sticking import INNER
from polyworld.solver.spatial.layout import OPTIONS, Row, State
from polyworld.solver.spatial.rows import velocity_along
from polyworld.solver.spatial.system import System

wp.set_module_options(OPTIONS)

STILL = wp.constant(wp.float64(1.0e-9))  # speeds below this are none [m/s or rad/s]
HELD = wp.constant(wp.float64(1.0e-10))  # response along an axis below this share of a free body's is rounding
YIELDS = wp.constant(wp.float64(-1.0))  # softness of an axis along which nothing acts


@wp.func
def motion_of(
    state: wp.array[State], joints: wp.array[Joints], k: int, i: int, given: wp.spatial_vectord
) -> wp.spatial_vectord:
    """Velocities of body i, as if it were free, per impulse."""
    p = wp.spatial_top(given) * state[0].bodies[k, i].inverse_mass
    return wrench(p, joints[0].inverse_inertia[k, i] * wp.spatial_bottom(given))


@wp.func
def row_impulse(row: Row, onto_a: bool) -> wp.spatial_vectord:
    """Impulse on a body for a unit along a row."""
    if onto_a:
        return wrench(row.d, row.ja)
    return wrench(-row.d, -row.jb)


@wp.func(inline=False)
def respond(system: System, m: Mechanisms, k: int, b: int) -> None:
    """Response of body b's group to impulses on b, the joints holding and their axes free."""
    joints = system.joints
    state = system.state
    n = joints[0].equalities
    first = m.first[b]
    for e in range(m.count[b]):
        m.response[k, first + e] = wp.spatial_matrixd()
    for c in range(6):
        given = wp.spatial_vectord()
        given[c] = wp.float64(1.0)
        gained = motion_of(state, joints, k, b, given)
        for r in range(n):
            lack = wp.float64(0.0)
            if joints[0].row_a[r] == b:
                lack -= wp.dot(row_impulse(state[0].rows[k, joints[0].base + r], True), gained)
            if joints[0].row_b[r] == b:
                lack -= wp.dot(row_impulse(state[0].rows[k, joints[0].base + r], False), gained)
            joints[0].work[k, r] = lack
        forward(joints, k)
        backward(joints, k)
        add_column(m, k, first + m.place[b], c, gained)
        for r in range(n):
            p = joints[0].work[k, r]
            if p == wp.float64(0.0):
                continue
            row = state[0].rows[k, joints[0].base + r]
            for side in range(2):
                i = joints[0].row_a[r]
                if side == 1:
                    i = joints[0].row_b[r]
                if i < state[0].objects:
                    moved = motion_of(state, joints, k, i, row_impulse(row, side == 0) * p)
                    add_column(m, k, first + m.place[i], c, moved)


@wp.func
def add_column(m: Mechanisms, k: int, e: int, c: int, gained: wp.spatial_vectord) -> None:
    response = m.response[k, e]
    for r in range(6):
        response[r, c] = response[r, c] + gained[r]
    m.response[k, e] = response


@wp.func(inline=False)
def softness(joints: wp.array[Joints], state: wp.array[State], k: int, j: int, h: wp.float64) -> wp.float64:
    """Velocity per impulse at which a joint's axes yield by themselves in a step of length h: 0 where they hold, YIELDS
    where nothing acts on them.

    Dry friction resists like damping of the rate that it has at the speed of now: it holds what is at rest.
    """
    zero = wp.float64(0.0)
    joint = joints[0].joint[k, j]
    d = joints[0].kinds[j]
    if joint.stopped[0] > zero or joint.stopped[1] > zero:
        return zero
    if d.driven == 2 and wp.abs(joint.driving) < INNER * wp.abs(joint.effort) * joint.drive:
        return zero
    rate = joint.damping
    if joint.friction > zero:
        speed = wp.vec3d()
        for i in range(d.axes):
            speed[i] = velocity_along(state, k, d.a, d.b, joints[0].base + joints[0].equalities + d.axis + i)
        rate += joint.friction / wp.max(wp.length(speed), STILL)
    if rate > zero:
        return wp.float64(1.0) / (rate * h)
    return YIELDS


@wp.func(inline=False)
def hold_axis(
    system: System, m: Mechanisms, along: wp.array2d[wp.spatial_vectord], k: int, r: int, soft: wp.float64
) -> None:
    """Take the motion along an axis off the responses of its group. r: its row; along (W, B): room to work in."""
    state = system.state
    row = state[0].rows[k, system.joints[0].base + r]
    a = system.joints[0].row_a[r]
    b = system.joints[0].row_b[r]
    one = a
    if a >= state[0].objects:
        one = b
    free = row.k
    yielding = wp.float64(0.0)
    for e in range(m.first[one], m.first[one] + m.count[one]):
        i = m.member[e]
        u = wp.spatial_vectord()
        if a < state[0].objects:
            u = m.response[k, m.first[a] + m.place[i]] * row_impulse(row, True)
        if b < state[0].objects:
            u = u + m.response[k, m.first[b] + m.place[i]] * row_impulse(row, False)
        along[k, i] = u
        if i == a:
            yielding += wp.dot(row_impulse(row, True), u)
        if i == b:
            yielding += wp.dot(row_impulse(row, False), u)
    if yielding <= HELD * free:
        return
    scale = wp.float64(1.0) / (yielding + soft)
    for e in range(m.first[one], m.first[one] + m.count[one]):
        pushed = m.member[e]
        for f in range(m.first[pushed], m.first[pushed] + m.count[pushed]):
            m.response[k, f] = m.response[k, f] - wp.outer(along[k, m.member[f]], along[k, pushed] * scale)


@wp.kernel
def find_responses(clock: Clock, system: System, m: Mechanisms, along: wp.array2d[wp.spatial_vectord]) -> None:
    """Responses of all jointed bodies of a world in its bodies' pose; impulses on them are cleared."""
    w = wp.tid()
    if clock.h[w] <= wp.float64(0.0):
        return
    joints = system.joints
    state = system.state
    activate_joints(joints, state, w)
    if joints[0].ready[w] == 0:
        build_joint_rows(joints, state, w, system.geometry[0].lock)
    for b in range(state[0].objects):
        m.impulse[w, b] = wp.vec3d()
        m.angular_impulse[w, b] = wp.vec3d()
        if m.first[b] >= 0 and state[0].bodies[w, b].active == 1:
            respond(system, m, w, b)
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        if d.kind == SPRING or joints[0].joint[w, j].active == 0:
            continue
        soft = softness(joints, state, w, j, clock.h[w])
        for i in range(d.axes):
            if soft >= wp.float64(0.0):
                hold_axis(system, m, along, w, joints[0].equalities + d.axis + i, soft)
