"""Forces of springs on the links of a tree."""

import warp as wp

from polyworld.effects.law import wrench
from polyworld.solver.spatial.joint_layout import SPRING, Joints
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.tree_layout import Link, angular, linear


@wp.func
def pull_springs(joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Take the forces of springs off those that hold the links."""
    for j in range(joints[0].count):
        d = joints[0].kinds[j]
        if d.kind != SPRING:
            continue
        joint = joints[0].joint[k, j]
        a = joints[0].tree.links[k, joints[0].tree.link_of[d.a]]
        at_a = a.x + a.rotation * joint.arm_a
        at_b = state[0].bodies[k, d.b].x + state[0].bodies[k, d.b].rotation * joint.arm_b
        rate = point_velocity(a, at_a)
        if d.b < state[0].objects:
            b = joints[0].tree.links[k, joints[0].tree.link_of[d.b]]
            at_b = b.x + b.rotation * joint.arm_b
            rate -= point_velocity(b, at_b)
        apart = at_a - at_b
        length = wp.length(apart)
        if length <= wp.float64(0.0):
            continue
        along = apart / length
        force = along * (joint.stiffness * (length - joint.rest_length) + joint.damping * wp.dot(rate, along))
        hold(joints, k, joints[0].tree.link_of[d.a], at_a, force)
        if d.b < state[0].objects:
            hold(joints, k, joints[0].tree.link_of[d.b], at_b, -force)


@wp.func
def point_velocity(link: Link, x: wp.vec3d) -> wp.vec3d:
    return linear(link.motion) + wp.cross(angular(link.motion), x - link.origin)


@wp.func
def hold(joints: wp.array[Joints], k: int, n: int, x: wp.vec3d, force: wp.vec3d) -> None:
    """Add a force at a point to what holds a link."""
    turn = wp.cross(x - joints[0].tree.links[k, n].origin, force)
    joints[0].tree.links[k, n].force += wrench(force, turn)
