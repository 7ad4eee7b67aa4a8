"""Where joints hold their objects, and which edits they allow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.world import World, geometry
from polyworld.world.representations.joint import Hinge, Joint, Slider, Spring
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]

SLACK = 1e-6  # an edit may shift an attached point by this much: positions come written in decimals [m], [rad]


@dataclass(frozen=True)
class _Ends:
    """The two ends of a joint after its bodies were moved: points (3,) [m] and rotations (3, 3) since then."""

    point: Array
    other_point: Array
    turn: Array
    other_turn: Array


def attached_point(item: RigidObject, joint: Joint) -> Array:
    """The point (3,) of an object that a joint holds, in body axes from its centre [m]."""
    rotation = geometry.quaternion_matrix(np.asarray(item.orientation))
    point: Array = rotation.T @ (np.asarray(joint.anchor) - np.asarray(item.position))
    return point


def turned_about(
    item: RigidObject, joint: Joint, orientation: tuple[float, float, float, float]
) -> tuple[float, float, float]:
    """Position of an object's centre once it is turned to `orientation` (a quaternion) about a joint's point [m]."""
    quaternion = np.asarray(orientation) / np.linalg.norm(orientation)
    x, y, z = np.asarray(joint.anchor) - geometry.quaternion_matrix(quaternion) @ attached_point(item, joint)
    return float(x), float(y), float(z)


def check_joints_hold(before: World, after: World) -> None:
    """Raise ValueError where the objects of `after` do not lie as the joints of `before` let them.

    A hinge lets them turn about its axis (in planar worlds: about its point), a ball about its point, a slider move
    along its axis, a fixed joint not at all. Springs hold anywhere.
    """
    for joint in after.joints:
        if joint.kind == "spring":
            continue
        for name in (joint.object, joint.other):
            if name is not None and joint.kind in ("hinge", "ball"):
                _check_point(before.object(name), after.object(name), joint)
        ends = _ends(before, after, joint)
        turned = ends.other_turn.T @ ends.turn
        if isinstance(joint, Hinge) and not after.planar:
            axis = _axis(joint)
            if np.linalg.norm(turned @ axis - axis) > SLACK:
                raise ValueError(
                    f"{joint.object!r} turns on joint {joint.name!r} about {joint.axis} only, and would be tilted "
                    "against it"
                )
        if joint.kind in ("slider", "fixed") and np.linalg.norm(turned - np.eye(3)) > SLACK:
            raise ValueError(
                f"{joint.object!r} cannot turn against what joint {joint.name!r} ({joint.kind}) holds it to"
            )
        apart = ends.point - ends.other_point
        if isinstance(joint, Slider):
            along = ends.other_turn @ _axis(joint)
            apart = apart - along * (along @ apart)
            if np.linalg.norm(apart) > SLACK:
                raise ValueError(
                    f"{joint.object!r} slides on joint {joint.name!r} along {joint.axis} only, and would leave it"
                )
        if joint.kind == "fixed" and np.linalg.norm(apart) > SLACK:
            raise ValueError(
                f"{joint.object!r} is fixed by joint {joint.name!r} to "
                f"{'the world' if joint.other is None else repr(joint.other)} and cannot be moved against it"
            )


def carry_springs(before: World, after: dict[str, Any]) -> None:
    """Let the ends of springs go with their bodies: `after` is the dump of `before` with objects moved and turned.

    A spring without a rest length keeps that of `before`.
    """
    places = {d["name"]: d for d in after["objects"]}
    for joint, changed in zip(before.joints, after["joints"], strict=True):
        if not isinstance(joint, Spring):
            continue
        for end, name in (("anchor", joint.object), ("other_anchor", joint.other)):
            if name is None:
                continue
            item, place = before.object(name), places[name]
            if (place["position"], place["orientation"]) == (item.position, item.orientation):
                continue
            turned = np.asarray(place["orientation"], dtype=float)
            turn = geometry.quaternion_matrix(turned / np.linalg.norm(turned))
            turn = turn @ geometry.quaternion_matrix(np.asarray(item.orientation)).T
            point = np.asarray(place["position"]) + turn @ (np.asarray(changed[end]) - np.asarray(item.position))
            changed[end] = (float(point[0]), float(point[1]), float(point[2]))
        if (changed["anchor"], changed["other_anchor"]) != (joint.anchor, joint.other_anchor):
            changed["rest_length"] = joint.length


def with_stops_kept(before: World, after: World) -> World:
    """`after` with the stops of its joints where they were: they are given from the initial pose, which an edit moves.

    The joints must hold, see `check_joints_hold`. Angles are taken within half a turn.
    """
    joints: list[Joint] = []
    for joint in after.joints:
        if isinstance(joint, Hinge | Slider) and (joint.lower is not None or joint.upper is not None):
            place = _place(before, after, joint)
            if abs(place) > SLACK:
                given = {stop: getattr(joint, stop) for stop in ("lower", "upper")}
                kept = {stop: value - place for stop, value in given.items() if value is not None}
                joints.append(joint.model_copy(update=kept))
                continue
        joints.append(joint)
    return after.model_copy(update={"joints": tuple(joints)})


def _check_point(was: RigidObject, now: RigidObject, joint: Joint) -> None:
    shift = attached_point(was, joint) - attached_point(now, joint)
    if np.linalg.norm(shift) > SLACK:
        position = tuple(round(x, 9) for x in turned_about(was, joint, now.orientation))
        raise ValueError(
            f"{was.name!r} turns on joint {joint.name!r} at {joint.anchor} and would leave it: "
            f"in orientation {now.orientation} its position there is {position}; "
            "an object on a hinge or ball can only be turned about it"
        )


def _place(before: World, after: World, joint: Hinge | Slider) -> float:
    """How far the joint's objects are turned [rad] or displaced [m] along its axis since `before`."""
    ends = _ends(before, after, joint)
    if isinstance(joint, Slider):
        return float((ends.point - ends.other_point) @ ends.other_turn @ _axis(joint))
    normal = geometry.plane_axes(after.environment.motion_plane)[2] if after.planar else _axis(joint)
    turned = ends.other_turn.T @ ends.turn
    skew = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
    return float(np.arctan2(skew @ normal, np.trace(turned) - 1.0))


def _axis(joint: Hinge | Slider) -> Array:
    axis: Array = np.asarray(joint.axis, dtype=float) / np.linalg.norm(joint.axis)
    return axis


def _ends(before: World, after: World, joint: Joint) -> _Ends:
    """Where the points of `before` that the joint holds are in `after`."""
    point, turn = np.asarray(joint.anchor, dtype=float), np.eye(3)
    found = [(point, turn), (point, turn)]
    for end, name in enumerate((joint.object, joint.other)):
        if name is not None:
            was, now = before.object(name), after.object(name)
            rotation = geometry.quaternion_matrix(np.asarray(now.orientation))
            found[end] = (
                np.asarray(now.position) + rotation @ attached_point(was, joint),
                rotation @ geometry.quaternion_matrix(np.asarray(was.orientation)).T,
            )
    return _Ends(found[0][0], found[1][0], found[0][1], found[1][1])
