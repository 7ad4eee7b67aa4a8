"""Joints of a USD stage as joints of a world."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.exchange.geoms import vector
from polyworld.exchange.names import Names
from polyworld.exchange.usd_stage import Stage
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Joint, Motor, Slider

Array = NDArray[np.float64]

OPEN = 1e-4  # distance of a joint's two points from which on it is said that it starts open [m]
_KINDS = {"RevoluteJoint": Hinge, "PrismaticJoint": Slider, "SphericalJoint": Ball, "FixedJoint": Fixed}


def joints_of(stage: Stage, moving: dict[str, Any], labels: dict[str, str]) -> tuple[list[Joint], list[str]]:
    """Read the joints between bodies that move, or between them and the world, and what is not carried over."""
    names, notes = Names(), []
    joints: list[Joint] = []
    for kind, made in _KINDS.items():
        for at, found in stage.of(kind):
            name = names.take(at.rsplit("/", 1)[-1], kind)
            if not found.jointEnabled:
                notes.append(f"joint {name} is left out: it is not enabled")
                continue
            ends = [str(found.body1), str(found.body0)]
            objects = [labels[end] if end in moving else None for end in ends]
            if objects[0] is None and objects[1] is None:
                notes.append(f"joint {name} is left out: neither of its bodies moves")
                continue
            sign = 1.0 if objects[0] is not None else -1.0
            held, other = (objects[0], objects[1]) if sign > 0 else (objects[1], None)
            assert held is not None
            first, second = _frame(stage, found, 0), _frame(stage, found, 1)
            anchor = second[0] if sign > 0 else first[0]
            if kind != "PrismaticJoint" and np.linalg.norm(first[0] - second[0]) > OPEN:
                notes.append(f"joint {name} starts open: it holds its bodies where they are")
            place = {"name": name, "object": held, "other": other, "anchor": vector(anchor)}
            if made is Ball and getattr(found, "limit", None) is not None and found.limit.enabled:
                notes.append(f"joint {name}: the limit of a ball joint is left out")
            if made in (Hinge, Slider):
                place |= _axis(stage, name, kind, found, first, second, sign, notes)
            joints.append(made(**place))
    return joints, notes


def _frame(stage: Stage, found: Any, end: int) -> tuple[Array, Array]:
    """Position (3,) [m] and rotation (3, 3) of a joint's frame on one of its bodies, world axes."""
    local = np.array(getattr(found, f"localPose{end}Position"), dtype=float)
    turn = getattr(found, f"localPose{end}Orientation")
    values = np.array((turn.GetReal(), *turn.GetImaginary()), dtype=float)
    own = quaternion_matrix(values / np.linalg.norm(values))
    path = str(getattr(found, f"rel{end}"))
    if not path:
        return stage.up @ local * stage.metre, stage.up @ own
    origin, rotation = stage.pose(path)
    # The description's position has the body's scale already.
    return origin + rotation @ local * stage.metre, rotation @ own


def _axis(
    stage: Stage,
    name: str,
    kind: str,
    found: Any,
    first: tuple[Array, Array],
    second: tuple[Array, Array],
    sign: float,
    notes: list[str],
) -> dict[str, Any]:
    """Axis, stops from the pose at the start, and a motor for control where the joint has a drive."""
    column = "XYZ".index(str(found.axis).rsplit(".", 1)[-1])
    axis = first[1][:, column]
    relative = first[1].T @ second[1]
    if kind == "RevoluteJoint":
        i, j = (column + 1) % 3, (column + 2) % 3
        now = math.atan2(relative[j, i] - relative[i, j], relative[i, i] + relative[j, j])
        unit = math.pi / 180.0
    else:
        now, unit = float((second[0] - first[0]) @ axis), stage.metre
    given: dict[str, Any] = {"axis": vector(sign * axis)}
    if found.limit.enabled:
        for stop in ("lower", "upper"):
            value = float(getattr(found.limit, stop)) * unit
            if math.isfinite(value) and abs(value) < 1e6:
                given[stop] = value - now
    if found.drive.enabled:
        given["motor"] = Motor(limit=0.0)
        notes.append(
            f"joint {name}: its drive (stiffness {found.drive.stiffness:g}, damping {found.drive.damping:g}, in the "
            "stage's units) is left out: drive its motor with `Control(efforts=...)`"
        )
    return given
