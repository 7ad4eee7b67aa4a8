"""A USD stage with UsdPhysics as a world, by the parser of `usd-core`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.exchange.bodies import rigid_shape
from polyworld.exchange.geoms import Placed, appearance, quaternion, vector
from polyworld.exchange.names import Names
from polyworld.exchange.reading import Imported
from polyworld.exchange.usd_joints import joints_of
from polyworld.exchange.usd_shapes import masses_of, shape_of
from polyworld.exchange.usd_stage import Stage
from polyworld.world import Environment, StaticObject, World
from polyworld.world.description import Appearance
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Plane, Sphere

Array = NDArray[np.float64]

EARTH = 9.81  # [m/s^2]


def world_of_stage(path: Path, *, alone: bool = False) -> Imported:
    """Return the world of a USD file's rigid bodies, joints and colliders.

    alone: refuse a file that refers to others. Raises ValueError where there is nothing of these.
    """
    stage = Stage(path, alone)
    names, notes = Names(), []
    labels: dict[str, str] = {}  # path of a body or static collider -> name
    objects, moving = [], {}
    for at, found in stage.of("RigidBody"):
        if not found.rigidBodyEnabled or found.kinematicBody:
            notes.append(f"{at} is not moved by forces: it stands still")
            continue
        moving[at] = found
        labels[at] = names.take(at.rsplit("/", 1)[-1], "body")
    colliders: dict[str, list[Any]] = {at: [] for at in moving}
    fixed: list[Any] = []
    for found in stage.shapes():
        if not found.collisionEnabled:
            continue
        owner = str(found.rigidBody)
        (colliders[owner] if owner in moving else fixed).append(found)
    for at, found in moving.items():
        objects.append(_object(stage, at, found, colliders[at], labels[at], notes))
    statics = []
    for found in fixed:
        made = _static(stage, found, names, notes)
        if made is not None:
            statics.append(made)
            labels[str(found.primPath)] = made.name
    if not objects and not statics:
        raise ValueError(f"{path.name} has no rigid bodies or colliders of UsdPhysics")
    joints, said = joints_of(stage, moving, labels)
    joined = {frozenset((j.object, j.other)) for j in joints}
    apart = {pair for pair in _filtered(stage, moving, labels) if frozenset(pair) not in joined}
    world = World(
        objects=tuple(objects),
        statics=tuple(statics),
        joints=tuple(joints),
        no_contact=tuple(sorted(apart)),
        environment=Environment(gravity=_gravity(stage)),
    )
    return Imported(world, tuple([*notes, *said, *stage.absent(), *names.changed]))


def _object(stage: Stage, at: str, body: Any, colliders: list[Any], name: str, notes: list[str]) -> RigidObject:
    origin, rotation = stage.pose(at)
    shapes, materials = [], []
    for found in colliders:
        shape = shape_of(stage, found, moving=True)
        label = str(found.primPath)
        if isinstance(shape, str):
            notes.append(f"{name}: {label} is left out: {shape}")
            continue
        if isinstance(shape.shape, Plane):
            notes.append(f"{name}: {label} is left out: a plane has no counterpart on a body that moves")
            continue
        if shape.said:
            notes.append(f"{name}: {label} is {shape.said}")
        shapes.append((found, shape))
        materials.append(stage.material(found))
    if len(set(materials)) > 1:
        notes.append(f"{name}: its colliders differ in material; all have that of the first")
    mass, centre, inertia = masses_of(stage, at, shapes, origin, rotation)
    pieces = [shape for _, shape in shapes]
    if not pieces:
        pieces = [Placed(Sphere(radius=max(math.sqrt(2.5 * np.trace(inertia) / (3.0 * mass)), 1e-3)), centre, rotation)]
        notes.append(f"{name} has no colliders: a ball stands for it, which others strike")
    shape, axes = rigid_shape(pieces, mass, centre, inertia, rotation)
    surface = materials[0] if materials else None
    turn = stage.up @ np.radians(np.array(body.angularVelocity, dtype=float))
    speed = stage.up @ np.array(body.linearVelocity, dtype=float) * stage.metre
    return RigidObject(
        name=name,
        shape=shape,
        appearance=_looks(stage, at, colliders),
        mass=mass,
        friction=0.5 if surface is None else surface.friction,
        restitution=0.0 if surface is None else surface.restitution,
        position=vector(centre),
        orientation=quaternion(axes),
        velocity=vector(speed + np.cross(turn, centre - origin)),
        angular_velocity=vector(turn),
    )


def _static(stage: Stage, found: Any, names: Names, notes: list[str]) -> StaticObject | None:
    label = str(found.primPath)
    shape = shape_of(stage, found, moving=False)
    if isinstance(shape, str):
        notes.append(f"{label} is left out: {shape}")
        return None
    if shape.said:
        notes.append(f"{label} is {shape.said}")
    surface = stage.material(found)
    return StaticObject(
        name=names.take(label.rsplit("/", 1)[-1], "static"),
        shape=shape.shape,
        appearance=_looks(stage, label, []),
        position=vector(shape.position),
        orientation=quaternion(shape.rotation),
        friction=None if surface is None else surface.friction,
        restitution=None if surface is None else surface.restitution,
    )


def _gravity(stage: Stage) -> tuple[float, float, float]:
    """Gravity of the first scene: down with 9.81 m/s^2 where it does not say."""
    direction, size = np.array((0.0, 0.0, -1.0)), EARTH
    for _, scene in stage.of("Scene"):
        given = stage.up @ np.array(scene.gravityDirection, dtype=float)
        if np.linalg.norm(given) > 1e-9:
            direction = given / np.linalg.norm(given)
        if math.isfinite(scene.gravityMagnitude) and scene.gravityMagnitude >= 0.0:
            size = float(scene.gravityMagnitude) * stage.metre
        break
    return vector(direction * size)


def _filtered(stage: Stage, moving: dict[str, Any], labels: dict[str, str]) -> set[tuple[str, str]]:
    """Pairs whose collisions the stage filters."""
    found: set[tuple[str, str]] = set()
    for at, body in moving.items():
        for other in body.filteredCollisions:
            name = labels.get(str(other))
            if name is not None:
                a, b = sorted((labels[at], name))
                found.add((a, b))
    for shape in stage.shapes():
        own = labels.get(str(shape.rigidBody)) or labels.get(str(shape.primPath))
        for other in shape.filteredCollisions:
            name = labels.get(str(other)) or labels.get(stage.owner(str(other)))
            if own is not None and name is not None and own != name:
                a, b = sorted((own, name))
                found.add((a, b))
    names = {labels[at] for at in moving}
    return {pair for pair in found if names & set(pair)}


def _looks(stage: Stage, at: str, colliders: list[Any]) -> Appearance:
    for place in (at, *(str(c.primPath) for c in colliders)):
        colour = stage.colour(place)
        if colour is not None:
            return appearance(colour)
    return Appearance()
