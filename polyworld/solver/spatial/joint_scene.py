"""A world's joints as the arrays the kernels read."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from polyworld.core import buffers
from polyworld.model.arrays import NEVER, RigidArrays
from polyworld.solver.spatial import joint_layout
from polyworld.solver.spatial.tree_scene import build_tree
from polyworld.world import World, geometry
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Joint, Slider, Spring

Array = NDArray[np.float64]

# First coordinate and number of coordinates of the joint's point, then of its rotation, that a joint holds in its
# frame, whose first column is the axis; and along how many axes it moves with resistance.
_HELD: dict[type, tuple[int, int, int, int, int]] = {
    Hinge: (0, 3, 1, 2, 1),
    Slider: (1, 2, 0, 3, 1),
    Ball: (0, 3, 0, 0, 3),
    Fixed: (0, 3, 0, 3, 0),
    Spring: (0, 0, 0, 0, 1),
}
_KINDS = {
    Hinge: joint_layout.HINGE,
    Slider: joint_layout.SLIDER,
    Ball: joint_layout.BALL,
    Fixed: joint_layout.FIXED,
    Spring: joint_layout.SPRING,
}
# The kernel's name of what differs per world, and that of `RigidArrays`.
_FIELDS = {
    "friction": "joint_friction",
    "damping": "joint_damping",
    "stiffness": "joint_stiffness",
    "target_speed": "motor_target_speed",
    "limit": "motor_limit",
    "delay": "motor_delay",
    "lower": "joint_lower",
    "upper": "joint_upper",
}
_POINTS = {"anchor": "object", "other_anchor": "other"}


def build_joints(world: World, base: int, rows: int) -> joint_layout.Joints:
    """Return the joints of a world, whose rows begin at `base`; room for `rows` worlds at a time."""
    n, ground = len(world.objects), len(world.objects) + len(world.statics)
    index = {o.name: i for i, o in enumerate(world.objects)}
    order = _order(world)
    kinds = np.zeros(max(len(order), 1), dtype=joint_layout.JointKind.numpy_dtype())
    equality, axes = 0, 0
    for row, column in zip(kinds, order, strict=False):
        joint = world.joints[column]
        held = _HELD[type(joint)]
        row["kind"], row["column"] = _KINDS[type(joint)], column
        row["a"], row["b"] = index[joint.object], ground if joint.other is None else index[joint.other]
        row["point"], row["points"], row["rotation"], row["rotations"], row["axes"] = held
        row["first"], row["axis"] = equality, axes
        equality += held[1] + held[3]
        axes += held[4]
        _describe(row, joint, world)
    first = _envelope(kinds[: len(order)], n)
    owner = [j for j, row in enumerate(kinds[: len(order)]) for _ in range(row["points"] + row["rotations"])]
    axis_owner = [j for j, row in enumerate(kinds[: len(order)]) for _ in range(row["axes"])]
    lengths = np.arange(equality) - first + 1
    jointed = np.zeros(max(n, 1), dtype=np.int32)
    for row in kinds[: len(order)]:
        for body in (row["a"], row["b"]):
            if body < n:
                jointed[body] = 1

    joints = joint_layout.Joints()
    joints.count, joints.equalities, joints.axes, joints.base = len(order), equality, axes, base
    joints.kinds = buffers.array(kinds, joint_layout.JointKind)
    joints.column = buffers.ints(first)
    joints.start = buffers.ints(np.concatenate([[0], np.cumsum(lengths)]))
    owners = np.array([*owner, *axis_owner], dtype=np.int64)
    joints.row_a, joints.row_b = buffers.ints(kinds["a"][owners]), buffers.ints(kinds["b"][owners])
    joints.jointed = buffers.ints(jointed)
    joints.joint = _zeros((rows, len(order)), joint_layout.Joint)
    joints.matrix = _zeros((rows, int(lengths.sum())), wp.float64)
    for name in ("inverse", "target", "work", "force"):
        setattr(joints, name, _zeros((rows, equality), wp.float64))
    joints.resists = _zeros((rows, len(order)), wp.int32)
    joints.held = _zeros((rows, axes * equality), wp.float64)
    joints.yields = _zeros((rows, axes * axes), wp.float64)
    joints.factor = _zeros((rows, axes * axes), wp.float64)
    joints.chosen, joints.state = _zeros((rows, axes), wp.int32), _zeros((rows, axes), wp.int32)
    joints.change = _zeros((rows, axes), wp.float64)
    joints.rate, joints.pushed = _zeros((rows, axes), wp.float64), _zeros((rows, axes), wp.float64)
    joints.half_impulse = _zeros((rows, equality + axes), wp.float64)
    joints.ready = _zeros((rows,), wp.int32)
    joints.inverse_inertia = _zeros((rows, ground + 1 if order else 0), wp.mat33d)
    for name, dtype in (
        ("start_w", wp.vec3d),
        ("end_x", wp.vec3d),
        ("end_q", wp.quatd),
        ("end_rotation", wp.mat33d),
    ):
        setattr(joints, name, _zeros((rows, n if order else 0), dtype))
    joints.tree = build_tree(kinds[: len(order)], n, rows, locked=world.planar)
    for name in _FIELDS:
        setattr(joints, name, _zeros((1, len(order)), wp.float64))
    for name in _POINTS:
        setattr(joints, name, _zeros((1, len(order)), wp.vec3d))
    return joints


def joint_rows(world: World) -> int:
    """Number of rows that a world's joints need."""
    return sum(_HELD[type(j)][1] + _HELD[type(j)][3] + _HELD[type(j)][4] for j in world.joints)


def write_joints(joints: joint_layout.Joints, arrays: RigidArrays, world: World) -> None:
    """Copy the joints' parameters into the kernel's arrays, reallocated where a field changes its rows.

    world: as described; a spring is fastened where it lies there, wherever `arrays` start its bodies.
    """
    if not joints.count:
        return
    for name, field in _FIELDS.items():
        _write(joints, name, getattr(arrays, field), wp.float64)
    for name, end in _POINTS.items():
        points = getattr(arrays, f"joint_{name}").copy()
        for column, joint in enumerate(world.joints):
            body = getattr(joint, end)
            if isinstance(joint, Spring) and body is not None:
                item = world.object(body)
                rotation = geometry.quaternion_matrix(np.asarray(item.orientation))
                points[:, column] = (points[:, column] - np.asarray(item.position)) @ rotation
        _write(joints, name, points, wp.vec3d)


def _write(joints: joint_layout.Joints, name: str, values: Array, dtype: Any) -> None:
    kept = getattr(joints, name)
    if kept.shape == values.shape[:2]:
        buffers.write(kept, values)
    else:
        setattr(joints, name, buffers.array(values, dtype))


def _order(world: World) -> list[int]:
    """Return the joints in an order in which those that share a body are near each other; springs last."""
    held = [i for i, j in enumerate(world.joints) if not isinstance(j, Spring)]
    springs = [i for i, j in enumerate(world.joints) if isinstance(j, Spring)]
    if len(held) > 1:
        ends = [{world.joints[i].object, world.joints[i].other} - {None} for i in held]
        near = np.array([[bool(a & b) for b in ends] for a in ends], dtype=np.int32)
        held = [held[i] for i in reverse_cuthill_mckee(csr_matrix(near), symmetric_mode=True)]
    return held + springs


def _envelope(kinds: Any, n: int) -> NDArray[np.int64]:
    """First column of each row of the joints' matrix: the first row of a joint that shares a moving body."""
    columns: list[int] = []
    for j, row in enumerate(kinds):
        bodies = {int(b) for b in (row["a"], row["b"]) if b < n}
        near = next(q for q in range(j + 1) if bodies & {int(kinds[q]["a"]), int(kinds[q]["b"])})
        columns += [int(kinds[near]["first"])] * int(row["points"] + row["rotations"])
    return np.array(columns, dtype=np.int64)


def _describe(row: Any, joint: Joint, world: World) -> None:
    """Fill in what the joint's kind asks for."""
    axis = np.array([1.0, 0.0, 0.0])
    if isinstance(joint, Hinge) and world.planar:
        axis = np.asarray(world.environment.motion_plane.normal, dtype=float)
    elif isinstance(joint, Hinge | Slider):
        axis = np.asarray(joint.axis, dtype=float)
    row["frame"] = _frame(axis / np.linalg.norm(axis))
    if isinstance(joint, Spring):
        row["rest_length"] = joint.length
    if isinstance(joint, Hinge | Slider):
        row["bounded"] = joint.lower is not None or joint.upper is not None
        motor = joint.motor
        if motor is not None:
            row["driven"] = 1 if motor.target_speed is None else 2
            row["direction"] = -1.0 if motor.reverse else 1.0
            row["switched_on"] = motor.start
            row["switched_off"] = NEVER if motor.end is None else motor.end


def _frame(axis: Array) -> Array:
    """Columns axis and two unit vectors across it, right-handed."""
    aside = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, aside)
    first /= np.linalg.norm(first)
    return np.stack([axis, first, np.cross(axis, first)], axis=1)


def _zeros(shape: tuple[int, ...], dtype: Any) -> Any:
    return buffers.zeros(tuple(max(s, 1) for s in shape), dtype)
