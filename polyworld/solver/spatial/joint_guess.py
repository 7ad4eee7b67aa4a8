"""The forces in joints with which Newton's method begins a step: those of the last, as the bodies have turned since.

A small ball at the end of a long arm is turned so easily that the same force in the same direction, a step later, is
a worse guess than none; the pull of an arm that hangs on something fixed rotates with the arm.
"""

import warp as wp

from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.rows import push


@wp.func
def turns_with_arm(joints: wp.array[Joints], state: wp.array[State], j: int) -> bool:
    """Check whether a joint's point is fixed in space, so that its force rotates with the hanging body."""
    return joints[0].kinds[j].points == 3 and joints[0].kinds[j].b >= state[0].objects


@wp.func
def remember_forces(joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64) -> None:
    """Keep the forces that a step of length h took, and the tension of each joint, while bodies are at its start."""
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        pull = wp.vec3d()
        for i in range(d.points):
            r = d.first + i
            pull[i] = state[0].rows[k, joints[0].base + r].impulse / h
            joints[0].force[k, r] = pull[i]
        joints[0].joint[k, j].tension = wp.length(pull)
        if turns_with_arm(joints, state, j):
            first = joints[0].base + d.first
            along = state[0].rows[k, first].d * pull[0] + state[0].rows[k, first + 1].d * pull[1]
            along += state[0].rows[k, first + 2].d * pull[2]
            in_arm = wp.transpose(state[0].bodies[k, d.a].rotation) * along
            for i in range(3):
                joints[0].force[k, d.first + i] = in_arm[i]
        for r in range(d.first + d.points, d.first + d.points + d.rotations):
            joints[0].force[k, r] = state[0].rows[k, joints[0].base + r].impulse / h


@wp.func
def push_as_before(joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64) -> None:
    """Push along all rows with the forces remembered, for a step of length h."""
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        first = d.first
        if turns_with_arm(joints, state, j):
            in_arm = wp.vec3d()
            for i in range(3):
                in_arm[i] = joints[0].force[k, first + i]
            along = state[0].bodies[k, d.a].rotation * in_arm
            for i in range(3):
                row = joints[0].base + first + i
                push(state, k, d.a, d.b, row, wp.dot(state[0].rows[k, row].d, along) * h)
            first += 3
        for r in range(first, d.first + d.points + d.rotations):
            if joints[0].force[k, r] != wp.float64(0.0):
                push(state, k, d.a, d.b, joints[0].base + r, joints[0].force[k, r] * h)


@wp.func
def remove_warm_start(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Undo what has been pushed along all rows that hold the joints."""
    for r in range(joints[0].equalities):
        row = joints[0].base + r
        push(state, k, joints[0].row_a[r], joints[0].row_b[r], row, -state[0].rows[k, row].impulse)
