"""Where hinges hold their objects, and which edits they allow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.representations.joint import Joint
from polyworld.representations.rigid import RigidObject
from polyworld.world import World

Array = NDArray[np.float64]

SLACK = 1e-6  # an edit may shift an attached point by this much: positions come written in decimals [m]


def attached_point(item: RigidObject, hinge: Joint) -> Array:
    """The point (3,) of an object that a hinge holds, in body axes from its centre [m]."""
    rotation = geometry.quaternion_matrix(np.asarray(item.orientation))
    point: Array = rotation.T @ (np.asarray(hinge.anchor) - np.asarray(item.position))
    return point


def turned_about(
    item: RigidObject, hinge: Joint, orientation: tuple[float, float, float, float]
) -> tuple[float, float, float]:
    """Position of an object's centre once it is turned to `orientation` (a quaternion) about a hinge [m]."""
    quaternion = np.asarray(orientation) / np.linalg.norm(orientation)
    x, y, z = np.asarray(hinge.anchor) - geometry.quaternion_matrix(quaternion) @ attached_point(item, hinge)
    return float(x), float(y), float(z)


def check_hinges_hold(before: World, after: World) -> None:
    """Raise ValueError where a hinge of `after` would hold another point of an object than in `before`."""
    for hinge in after.joints:
        for name in (hinge.object, hinge.other):
            if name is None:
                continue
            was, now = before.object(name), after.object(name)
            shift = attached_point(was, hinge) - attached_point(now, hinge)
            if np.linalg.norm(shift) > SLACK:
                position = tuple(round(x, 9) for x in turned_about(was, hinge, now.orientation))
                raise ValueError(
                    f"{name!r} turns on joint {hinge.name!r} at {hinge.anchor} and would leave it: "
                    f"in orientation {now.orientation} its position there is {position}; "
                    "a hinged object can only be turned about its hinge"
                )
