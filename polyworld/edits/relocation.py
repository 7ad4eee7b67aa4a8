"""Starting an object somewhere else, or otherwise turned, with what must go with it.

What is fastened is not torn: springs are stretched, a rope tied to a moved body by an end follows with that end,
and every other fastening refuses the move in words that say what could be done.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.model.rope import threading
from polyworld.world import Deformable, World, geometry
from polyworld.world.joints import carry_springs, check_joints_hold, turned_about, with_stops_kept
from polyworld.world.materials import material, material_of
from polyworld.world.parameters import shift_deformable
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Turn = tuple[float, float, float, float]

LONGEST_STRETCH = 0.02  # a rope may be stretched by this share of its length when what it is tied to is moved


def centre_of_mass(world: World, item: Deformable) -> Array:
    """Where the centre of mass (3,) of a deformable object is at its start [m]."""
    mesh = mesh_of(world, item)
    if not len(mesh.nodes):
        raise ValueError(f"{item.name!r} has no volume at the start, so no place: emitters fill it")
    centre: Array = mesh.measure @ mesh.nodes / mesh.measure.sum()
    return centre


def moved(world: World, name: str, position: Vector | None, orientation: Turn | None) -> World:
    """The world with an object's centre of mass at `position` [m] and the object turned to `orientation` (w, x, y, z)
    about it. What has no orientation of its own (ropes, cloth, fluids) is turned by it from how it lies.

    Raises ValueError where something holds it.
    """
    if any(d.name == name for d in world.deformables):
        return _moved_deformable(world, world.deformable(name), position, orientation)
    item = world.object(name)
    hinges = [j for j in world.joints if name in (j.object, getattr(j, "other", None)) and j.kind != "spring"]
    if len(hinges) == 1 and position is None and orientation is not None:
        position = turned_about(item, hinges[0], orientation)
    data: dict[str, Any] = world.model_dump()
    changed = next(d for d in data["objects"] if d["name"] == name)
    changed.update({k: v for k, v in (("position", position), ("orientation", orientation)) if v is not None})
    after = RigidObject.model_validate(changed)
    turn = geometry.quaternion_matrix(np.asarray(after.orientation))
    turn = turn @ geometry.quaternion_matrix(np.asarray(item.orientation)).T

    def carried(point: Any) -> Vector:
        """Where a point fixed to the body goes."""
        return _vector(np.asarray(after.position) + turn @ (np.asarray(point) - np.asarray(item.position)))

    carry_springs(world, data)
    for pulley in data["pulleys"]:
        if pulley["object"] == name:
            raise ValueError(
                f"{name!r} carries pulley {pulley['name']!r}, over which rope {pulley['rope']!r} runs: moving it would "
                "pull the rope apart; remove the rope and add it as it should run"
            )
    for container in data["containers"]:
        if container["object"] == name and orientation is None:
            step = np.subtract(after.position, item.position)
            for corner in ("lower", "upper"):
                container[corner] = _vector(np.asarray(container[corner]) + step)
        elif container["object"] == name:
            raise ValueError(
                f"container {container['name']!r} is a box along the world's axes around {name!r}, which cannot be "
                "turned with it: move it without orientation, or remove the container first"
            )
    ropes = [_follow(world, data, attachment, carried) for attachment in world.attachments if attachment.to == name]
    # Hinges hold at a place; springs were carried along and hold anywhere.
    result = World.model_validate(data)
    check_joints_hold(world, result)
    result = with_stops_kept(world, result)
    for rope in ropes:
        _check_length(result, rope)
    return result


def _follow(world: World, data: dict[str, Any], attachment: Attachment, carried: Callable[[Any], Vector]) -> str:
    """Let a rope's end follow the body it is tied to; returns its name. Raises ValueError for what cannot follow."""
    item: Any = world.deformable(attachment.object)
    if material_of(item).form != "line" or attachment.end is None:
        raise ValueError(
            f"attachment {attachment.name!r} holds {item.name!r} to it and would be torn: remove the attachment "
            f"first, or move {item.name!r} first and fasten it again"
        )
    rope = next(d for d in data["deformables"] if d["name"] == item.name)
    points = [_vector(p) for p in item.points]
    index = 0 if attachment.end == "start" else len(points) - 1
    points[index] = carried(points[index])
    rope["points"], rope["length"] = points, float(threading(world, item).rest.sum())
    return attachment.object


def _check_length(world: World, name: str) -> None:
    """Raise ValueError where a rope starts stretched by more than LONGEST_STRETCH."""
    rope: Any = world.deformable(name)
    length = float(threading(world, rope).rest.sum())
    run = float(threading(world, rope.model_copy(update={"length": None})).rest.sum())
    if run > length * (1.0 + LONGEST_STRETCH):
        raise ValueError(
            f"rope {name!r}, {length:.4g} m long, would have to reach over {run:.4g} m to stay tied: move it less far, "
            "or remove the attachment first"
        )


def start_of(world: World, item: RigidObject | Deformable) -> Vector:
    """Centre of mass (3,) of an object where it starts [m]."""
    if world.is_rigid(item.name):
        return world.object(item.name).position
    return _vector(centre_of_mass(world, world.deformable(item.name)))


def _moved_deformable(world: World, item: Deformable, position: Vector | None, orientation: Turn | None) -> World:
    threaded = [p.name for p in world.pulleys if p.rope == item.name]
    if threaded:
        raise ValueError(
            f"rope {item.name!r} runs over pulleys {threaded}, which stay where they are: remove them first, or remove "
            "the rope and add it as it should run"
        )
    tied = [a for a in world.attachments if item.name in (a.object, a.to) and a.to is not None]
    if tied:
        ends = {a.name: a.to if a.object == item.name else a.object for a in tied}
        raise ValueError(
            f"{item.name!r} is fastened to other objects, {ends}, from which it would be torn: remove these "
            "attachments first, or move the object at the other end"
        )
    data: dict[str, Any] = world.model_dump()
    description = next(d for d in data["deformables"] if d["name"] == item.name)
    # Fastenings to the world go with it, and hold the same nodes wherever it is.
    for number, attachment in enumerate(world.attachments):
        if attachment.object == item.name and attachment.region is not None:
            nodes = mesh_of(world, item).nodes
            inside = np.all((nodes >= attachment.region.lower) & (nodes <= attachment.region.upper), axis=1)
            data["attachments"][number].update(region=None, nodes=[int(i) for i in np.flatnonzero(inside)])
    if orientation is not None:
        if material_of(item).turns:
            description["orientation"] = orientation
        else:
            _turn(description, centre_of_mass(world, item), np.asarray(orientation, dtype=float))
    turned = World.model_validate(data)
    target = position if position is not None else _vector(centre_of_mass(world, item))
    step = np.asarray(target) - centre_of_mass(turned, turned.deformable(item.name))
    if np.linalg.norm(step) > 0.0:
        data = turned.model_dump()
        description = next(d for d in data["deformables"] if d["name"] == item.name)
        shift_deformable(description, _vector(step))
    return World.model_validate(data)


def _turn(item: dict[str, Any], centre: Array, quaternion: Array) -> None:
    """Turn an object without an orientation of its own, given as its description, about a point."""
    quaternion = quaternion / np.linalg.norm(quaternion)
    matrix = geometry.quaternion_matrix(quaternion)

    def turned(point: Any) -> Vector:
        return _vector(centre + matrix @ (np.asarray(point, dtype=float) - centre))

    material(item["representation"]).moved(item, turned, quaternion)


def _vector(values: Any) -> Vector:
    x, y, z = (float(v) for v in values)
    return x, y, z
