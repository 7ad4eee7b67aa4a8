"""Two steps of jointed bodies made fourth order: Richardson's extrapolation.

The scheme of `joint_step` is symmetric, so that its error has even powers of the step alone; the difference of two
steps of h and one of 2 h estimates the leading one, which is subtracted (Hairer, Lubich & Wanner, Geometric Numerical
Integration, 2nd ed., sec. II.4 and V.1). That holds where motion is smooth: where a body comes near another, a joint
runs into a stop, sticks, or asks for shorter steps, the two steps are left as they are.
"""

from typing import Any

import warp as wp

from polyworld.solver.spatial.joint_layout import BALL, SPRING, Joints, Moment
from polyworld.solver.spatial.joint_rows import build_joint_rows, hold_joints
from polyworld.solver.spatial.joint_step import clear_targets, project_joints
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.motion import rotated
from polyworld.solver.spatial.system import System
from polyworld.solver.spatial.tree_turn import follow_tree

STICKING = wp.float64(1.0 - 1.0e-9)  # friction below this share of its limit lets nothing slip
ALIKE = wp.float64(0.02)  # difference of long and short steps, of what they changed, that the leading error explains
SPRUNG = wp.float64(0.005)  # the same where springs vibrate, undamped, for thousands of steps
ROUNDING = wp.float64(1.0e-8)  # difference of speeds that counts as none [m/s], and as a share of them
NEAREST = wp.float64(
    1.0 / 16.0
)  # part of two steps in which bodies that are near are followed in their joints' freedoms
THIRD = wp.float64(1.0 / 3.0)


@wp.func
def keep(state: wp.array[State], moments: wp.array2d[Moment], k: int) -> None:
    for i in range(state[0].objects):
        moment = Moment()
        moment.x = state[0].bodies[k, i].x
        moment.q = state[0].bodies[k, i].q
        moment.v = state[0].bodies[k, i].v
        moment.w = state[0].bodies[k, i].w
        moment.reaction = state[0].reaction[k, i]
        moment.turning = state[0].reaction_turning[k, i]
        moments[k, i] = moment


@wp.func
def put_back(joints: wp.array[Joints], state: wp.array[State], moments: wp.array2d[Moment], k: int) -> None:
    """Bodies as they were, but for what joints did to them."""
    for i in range(state[0].objects):
        q = moments[k, i].q
        state[0].bodies[k, i].x = moments[k, i].x
        state[0].bodies[k, i].q = q
        state[0].bodies[k, i].v = moments[k, i].v
        state[0].bodies[k, i].w = moments[k, i].w
        state[0].bodies[k, i].rotation = wp.quat_to_matrix(q)
    joints[0].ready[k] = 0


@wp.func
def take_reactions(state: wp.array[State], moments: wp.array2d[Moment], k: int) -> None:
    for i in range(state[0].objects):
        state[0].reaction[k, i] = moments[k, i].reaction
        state[0].reaction_turning[k, i] = moments[k, i].turning


@wp.func
def note_roughness(joints: wp.array[Joints], k: int) -> None:
    """Mark the step in which an axis stuck, was stopped, or a motor went on or off: impulses then are not smooth."""
    zero = wp.float64(0.0)
    for j in range(joints[0].count):
        if joints[0].resists[k, j] == 1 and joints[0].kinds[j].kind != SPRING:
            stopped = joints[0].joint[k, j].stopped
            drive = joints[0].joint[k, j].drive
            if stopped[0] + stopped[1] > zero or (drive > zero and drive < STICKING * joints[0].taken[k]):
                joints[0].rough[k] = 1
            limit = joints[0].joint[k, j].friction * joints[0].taken[k]
            if limit > zero:
                rubbing = wp.abs(joints[0].joint[k, j].rubbing[0])
                if joints[0].kinds[j].kind == BALL:
                    rubbing = wp.length(joints[0].joint[k, j].rubbing)
                if rubbing < STICKING * limit:
                    joints[0].rough[k] = 1


@wp.func
def smooth(joints: wp.array[Joints], state: wp.array[State], k: int) -> bool:
    """Check whether the last step was taken whole, with nothing near the bodies, and no axis stuck or was stopped."""
    near = state[0].manifold_count[k, 0] + state[0].manifold_count[k, 1]
    note_roughness(joints, k)
    return near == 0 and joints[0].parts[k] == 1 and joints[0].rough[k] == 0


@wp.func
def predict_reactions(joints: wp.array[Joints], state: wp.array[State], k: int, lag: wp.float64) -> None:
    """Predict the joints' action on bodies in the first half of the next step from the last two steps.

    Effects act as they will be in the middle of a step. lag: how much later than the last, in steps; 0 where nothing
    is known of the one before.
    """
    for i in range(state[0].objects):
        last = state[0].reaction[k, i]
        turning = state[0].reaction_turning[k, i]
        state[0].reaction[k, i] = last + (last - joints[0].before[k, i].reaction) * lag
        state[0].reaction_turning[k, i] = turning + (turning - joints[0].before[k, i].turning) * lag
        joints[0].before[k, i].reaction = last
        joints[0].before[k, i].turning = turning


@wp.func
def resolved(joints: wp.array[Joints], state: wp.array[State], k: int) -> bool:
    """Check whether one long step, whose result the bodies hold, agrees with two short ones for all bodies.

    By the leading error of a vibration of frequency w, that asks for (w h)^2 < 16 ALIKE for a long step h. The
    extrapolated one grows by (w h)^6 / 1152 a step; one of a spring that steps do not resolve would by 5 / 3.
    """
    alike = ALIKE
    for j in range(joints[0].count):
        if joints[0].kinds[j].kind == SPRING:
            alike = SPRUNG
    for i in range(state[0].objects):
        b = state[0].bodies[k, i].inertia
        gyration = (b[0, 0] + b[1, 1] + b[2, 2]) * THIRD
        first = joints[0].at_start[k, i]
        middle = joints[0].at_middle[k, i]
        end = joints[0].at_end[k, i]
        changed = combined(middle.v - first.v, middle.w - first.w, gyration)
        changed += combined(end.v - middle.v, end.w - middle.w, gyration)
        apart = combined(end.v - state[0].bodies[k, i].v, end.w - state[0].bodies[k, i].w, gyration)
        # Written so that what is no number is not resolved.
        if not (apart <= alike * changed + ROUNDING * (wp.float64(1.0) + combined(end.v, end.w, gyration))):
            return False
        path = combined(middle.x - first.x, rotation_between(middle.q, first.q), gyration)
        path += combined(end.x - middle.x, rotation_between(end.q, middle.q), gyration)
        q = state[0].bodies[k, i].q
        off = combined(end.x - state[0].bodies[k, i].x, rotation_between(end.q, q), gyration)
        if not (off <= wp.float64(4.0) * alike * path + ROUNDING):
            return False
    return True


@wp.func
def combined(v: wp.vec3d, w: wp.vec3d, gyration: wp.float64) -> wp.float64:
    """Return the norm of a velocity and an angular velocity, or of a shift and a rotation; gyration: radius^2 [m^2]."""
    return wp.sqrt(wp.dot(v, v) + gyration * wp.dot(w, w))


@wp.func
def rotation_between(q: wp.quatd, p: wp.quatd) -> wp.vec3d:
    """Return the small rotation vector from orientation p to q, world axes."""
    between = q * wp.quat_inverse(p)
    rotation = wp.vec3d(between[0], between[1], between[2]) * wp.float64(2.0)
    if between[3] < wp.float64(0.0):
        return -rotation
    return rotation


def pairing(advance: Any) -> Any:
    """Return the Warp function `advance_far` of the function `advance` for one step."""

    @wp.func
    def advance_pair(
        system: System, w: int, k: int, previous_half: int, gravity: wp.vec3d, start: wp.float64, whole: wp.float64
    ) -> int:
        """Two steps of half the length `whole` from time `start`, extrapolated where motion is smooth.

        Returns which half of the contact arrays holds the contacts of the last.
        """
        joints = system.joints
        state = system.state
        lock = system.geometry[0].lock
        h = wp.float64(0.5) * whole
        lag = wp.float64(0.0)
        next_lag = wp.float64(0.0)
        if joints[0].paced[k] > wp.float64(0.0):
            lag = wp.float64(0.5) + wp.float64(0.25) * h / joints[0].paced[k]
            next_lag = wp.float64(0.75)
        joints[0].paced[k] = wp.float64(0.0)
        keep(state, joints[0].at_start, k)
        predict_reactions(joints, state, k, lag)
        begin_step(joints, k, h)
        half = advance(system, w, k, previous_half, gravity, start, h)
        if not smooth(joints, state, k):
            return advance(system, w, k, half, gravity, start + h, h)
        keep(state, joints[0].at_middle, k)
        predict_reactions(joints, state, k, next_lag)
        begin_step(joints, k, h)
        half = advance(system, w, k, half, gravity, start + h, h)
        if not smooth(joints, state, k):
            return half
        joints[0].paced[k] = h
        keep(state, joints[0].at_end, k)
        put_back(joints, state, joints[0].at_start, k)
        take_reactions(state, joints[0].at_middle, k)
        begin_step(joints, k, whole)
        half = advance(system, w, k, half, gravity, start, whole)
        if smooth(joints, state, k) and resolved(joints, state, k):
            extrapolate(joints, state, k)
            joints[0].ready[k] = 0
            project_joints(joints, state, k, lock)
            if joints[0].ready[k] == 0:
                build_joint_rows(joints, state, k, lock)
            clear_targets(joints, k)
            hold_joints(joints, state, k)
        else:
            put_back(joints, state, joints[0].at_end, k)
        take_reactions(state, joints[0].at_end, k)
        return half

    @wp.func
    def advance_far(
        system: System,
        w: int,
        k: int,
        previous_half: int,
        gravity: wp.vec3d,
        start: wp.float64,
        whole: wp.float64,
        room: wp.float64,
    ) -> tuple[int, wp.float64]:
        """Two steps of half the length `whole` from time `start`, or up to `room` on a tree that touches nothing.

        Returns which half of the contact arrays holds the contacts of the last, and by how much all moved on [s].
        """
        half = wp.int32(previous_half)
        if system.joints[0].tree.count > 0:
            done, half = follow_tree(system, w, k, previous_half, gravity, start, whole, room)
            if done >= whole:
                return half, done
            if done > wp.float64(0.0):
                h = wp.float64(0.5) * (whole - done)
                half = advance(system, w, k, half, gravity, start + done, h)
                return advance(system, w, k, half, gravity, start + done + h, h), whole
        return advance_pair(system, w, k, half, gravity, start, whole), whole

    return advance_far


@wp.func
def begin_step(joints: wp.array[Joints], k: int, h: wp.float64) -> None:
    joints[0].parts[k] = 0
    joints[0].rough[k] = 0
    joints[0].taken[k] = h


@wp.func
def extrapolate(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """From the end of one long step, where the bodies are, and that of two short ones, `at_end`, to the limit."""
    for i in range(state[0].objects):
        fine = joints[0].at_end[k, i]
        end = rotated(fine.q, rotation_between(fine.q, state[0].bodies[k, i].q) * THIRD)
        state[0].bodies[k, i].x = fine.x + (fine.x - state[0].bodies[k, i].x) * THIRD
        state[0].bodies[k, i].q = end
        state[0].bodies[k, i].rotation = wp.quat_to_matrix(end)
        state[0].bodies[k, i].v = fine.v + (fine.v - state[0].bodies[k, i].v) * THIRD
        state[0].bodies[k, i].w = fine.w + (fine.w - state[0].bodies[k, i].w) * THIRD
