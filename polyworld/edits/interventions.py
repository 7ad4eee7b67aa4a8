"""Edits that make a branch world: what if this were gone, there, faster, or otherwise?

A branch inherits everything an edit does not name: fitted parameters, effects, camera, time base.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from polyworld.edits.relocation import moved, start_of
from polyworld.edits.removal import PARTS, without
from polyworld.world import Deformable, StaticObject, World
from polyworld.world.description import Description, Name, NonNegative, Positive, Quaternion, Vec3
from polyworld.world.geometry import quaternion_matrix, quaternion_product, rotation_quaternion
from polyworld.world.joints import check_joints_hold, with_stops_kept
from polyworld.world.materials import material
from polyworld.world.parameters import read_parameter, with_parameters
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.fluid import Container, Drain, Emitter, FluidGrid
from polyworld.world.representations.joint import Joint
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Pulley

Part = Literal["object", "deformable", "static", "joint", "attachment", "pulley", "emitter", "drain", "container"]
ADDED = ("object", "deformable", "static", "joint", "attachment", "pulley", "emitter", "drain", "container")


class Remove(Description):
    """Take an object out of the world; its joints, attachments, pulleys, emitters and own effects go with it."""

    action: Literal["remove"] = "remove"
    object: Name = Field(description="name of what to remove: an object of any kind, a static, a joint, a pulley, ...")
    part: Part | None = Field(default=None, description="which kind of part is meant, where two share the name")


class Add(Description):
    """Put something into the world: give exactly one part."""

    action: Literal["add"] = "add"
    object: RigidObject | None = Field(default=None, description="the rigid object to add, with its initial state")
    deformable: Deformable | None = Field(default=None, description="the rope, cloth, soft body or fluid to add")
    static: StaticObject | None = None
    joint: Joint | None = None
    attachment: Attachment | None = None
    pulley: Pulley | None = None
    emitter: Emitter | None = None
    drain: Drain | None = None
    container: Container | None = None
    fluid_grid: FluidGrid | None = Field(default=None, description="with the first fluid of a world: its grid")

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [part for part in ADDED if getattr(self, part) is not None]
        if len(given) != 1:
            raise ValueError(f"add takes exactly one of: {', '.join(ADDED)}; got {given or 'none'}")
        if self.fluid_grid is not None and given != ["deformable"]:
            raise ValueError("fluid_grid is given together with a fluid, as deformable")
        return self


class Move(Description):
    """Start an object elsewhere, or turned about its centre of mass.

    A hinged object keeps its hinge: one on a single hinge turns about it where nothing moves its centre; any other
    move must leave the attached points where they are. Springs are stretched; a rope tied to the object by
    an end follows with it; fastenings of a deformable object to the world move along with it.
    """

    action: Literal["move"] = "move"
    object: Name = Field(description="name of the object")
    position: Vec3 | None = Field(default=None, description="centre of mass at the object's start_time [m]")
    orientation: Quaternion | None = Field(
        default=None, description="quaternion w, x, y, z; of ropes, cloth and fluids: turn from how they lie"
    )
    shift: Vec3 | None = Field(default=None, description="instead of position: change of it [m]")
    turn: Vec3 | None = Field(default=None, description="instead of orientation: rotation vector [rad]")

    @model_validator(mode="after")
    def _some(self) -> Self:
        given = [name for name in ("position", "orientation", "shift", "turn") if getattr(self, name) is not None]
        if not given:
            raise ValueError("move needs at least one of: position, orientation, shift, turn")
        for pair in (("position", "shift"), ("orientation", "turn")):
            if set(pair) <= set(given):
                raise ValueError(f"move takes {pair[0]} or {pair[1]}, not both")
        return self


class SetVelocity(Description):
    """Start an object with another velocity."""

    action: Literal["set_velocity"] = "set_velocity"
    object: Name = Field(description="name of the object")
    velocity: Vec3 | None = Field(default=None, description="velocity at the object's start_time [m/s]")
    angular_velocity: Vec3 | None = Field(
        default=None, description="angular velocity, world axes [rad/s]; rigid objects and soft bodies"
    )

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.velocity is None and self.angular_velocity is None:
            raise ValueError("set_velocity needs at least one of: velocity, angular_velocity")
        return self


class ScaleVelocity(Description):
    """Start an object with a multiple of its velocity and angular velocity, or with both turned."""

    action: Literal["scale_velocity"] = "scale_velocity"
    object: Name = Field(description="name of the object")
    factor: float = Field(default=1.0, description="2: twice as fast; 0: at rest; -1: the other way")
    angular_factor: float | None = Field(default=None, description="of the angular velocity; default: as factor")
    turn: Vec3 | None = Field(default=None, description="rotation vector that turns both [rad]")


class SetParameter(Description):
    """Give one parameter another value, by path."""

    action: Literal["set_parameter"] = "set_parameter"
    path: str = Field(
        description="parameter path, e.g. objects.red.friction, objects.NAME.youngs_modulus, joints.NAME.friction, "
        "joints.NAME.motor.target_speed, pulleys.NAME.bearing_friction, emitters.NAME.rate; a contact's friction and "
        "restitution are each the geometric mean of both bodies' values; the object's own where a static has none, and "
        "the static's where it is dominant"
    )
    value: float = Field(description="new value, in the parameter's unit")


class ScaleParameter(Description):
    """Multiply one parameter's value, by path."""

    action: Literal["scale_parameter"] = "scale_parameter"
    path: str = Field(description="parameter path, as of set_parameter")
    factor: float = Field(description="2: twice the value")


class ToggleEffect(Description):
    """Switch an effect on or off."""

    action: Literal["toggle_effect"] = "toggle_effect"
    effect: Name = Field(description="name of the effect")
    enabled: bool


class Release(Description):
    """Let go of an attachment."""

    action: Literal["release"] = "release"
    attachment: Name = Field(description="name of the attachment")
    time: Positive | None = Field(default=None, description="when it lets go [s]; default: it is not there at all")


class ChangeEnvironment(Description):
    """Change what acts on every object."""

    action: Literal["environment"] = "environment"
    gravity: Vec3 | None = Field(default=None, description="gravitational acceleration [m/s^2]")
    gravity_factor: float | None = Field(default=None, description="instead of gravity: a multiple of it")
    plane_friction: NonNegative | None = Field(default=None, description="friction coefficient of the motion plane")
    wind: Vec3 | None = Field(default=None, description="velocity of the air that cloth moves through [m/s]")
    air_density: NonNegative | None = Field(default=None, description="density of that air [kg/m^3]")

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.model_fields_set <= {"action"}:
            raise ValueError(
                "environment needs at least one of: gravity, gravity_factor, plane_friction, wind, air_density"
            )
        if self.gravity is not None and self.gravity_factor is not None:
            raise ValueError("environment takes gravity or gravity_factor, not both")
        return self


Intervention = Annotated[
    Remove
    | Add
    | Move
    | SetVelocity
    | ScaleVelocity
    | SetParameter
    | ScaleParameter
    | ToggleEffect
    | Release
    | ChangeEnvironment,
    Field(discriminator="action"),
]


def branch(world: World, edits: Sequence[Intervention]) -> World:
    """The world after the edits, in their order. The world itself stays as it is.

    Raises ValueError that says which edit cannot be made, why, and what could be.
    """
    for number, edit in enumerate(edits, start=1):
        try:
            world = _edited(world, edit)
        except ValidationError as error:
            reasons = "; ".join(str(e["msg"]).removeprefix("Value error, ") for e in error.errors())
            raise ValueError(f"edit {number} ({edit.action}): {reasons}") from error
        except (KeyError, ValueError) as error:
            raise ValueError(f"edit {number} ({edit.action}): {error.args[0]}") from error
    return world


def _edited(world: World, edit: Intervention) -> World:
    if isinstance(edit, Remove):
        return without(world, edit.object, edit.part)
    if isinstance(edit, Add):
        return _added(world, edit)
    if isinstance(edit, Move):
        _must_move(world, edit.object)
        return moved(world, edit.object, *_destination(world, edit))
    if isinstance(edit, SetVelocity):
        return _restarted(world, edit)
    if isinstance(edit, ScaleVelocity):
        return _scaled(world, edit)
    if isinstance(edit, SetParameter):
        return _with_value(world, edit.path, edit.value)
    if isinstance(edit, ScaleParameter):
        value = read_parameter(world, edit.path)
        if value is None:
            raise ValueError(f"{edit.path} has no value of its own to multiply: it is left to the object that touches")
        return _with_value(world, edit.path, edit.factor * value)
    if isinstance(edit, ToggleEffect):
        return _toggled(world, edit)
    if isinstance(edit, Release):
        return _released(world, edit)
    return _in_other_surroundings(world, edit)


def _destination(world: World, edit: Move) -> tuple[Vec3 | None, Quaternion | None]:
    """Where an object starts after a move, and how it is turned; None where that stays."""
    item = world.item(edit.object)
    position, orientation = edit.position, edit.orientation
    if edit.shift is not None:
        x, y, z = np.asarray(start_of(world, item)) + np.asarray(edit.shift)
        position = (float(x), float(y), float(z))
    if edit.turn is not None:
        turn = rotation_quaternion(np.asarray(edit.turn))
        w, i, j, k = quaternion_product(turn, np.asarray(getattr(item, "orientation", (1.0, 0.0, 0.0, 0.0))))
        orientation = (float(w), float(i), float(j), float(k))
    return position, orientation


def _in_other_surroundings(world: World, edit: ChangeEnvironment) -> World:
    data: dict[str, Any] = world.model_dump()
    if edit.gravity_factor is not None:
        data["environment"]["gravity"] = tuple(edit.gravity_factor * g for g in world.environment.gravity)
    for field in ("gravity", "wind", "air_density"):
        if getattr(edit, field) is not None:
            data["environment"][field] = getattr(edit, field)
    if edit.plane_friction is not None:
        data["environment"]["motion_plane"]["friction"] = edit.plane_friction
    return World.model_validate(data)


def _added(world: World, edit: Add) -> World:
    part = next(p for p in ADDED if getattr(edit, p) is not None)
    item, kind = getattr(edit, part), PARTS[part]
    if part in ("object", "deformable", "static"):
        taken = [*world.moving_names, *(s.name for s in world.statics)]
    else:
        taken = [x.name for x in getattr(world, kind)]
    if item.name in taken:
        raise ValueError(f"the name {item.name!r} is taken; names in use: {taken}")
    data: dict[str, Any] = world.model_dump()
    data[kind] = [*data[kind], item.model_dump()]
    if edit.fluid_grid is not None:
        if world.fluid_grid is not None:
            raise ValueError("this world has its fluid_grid already: leave it out")
        data["fluid_grid"] = edit.fluid_grid.model_dump()
    return World.model_validate(data)


def _must_move(world: World, name: str) -> None:
    """Raise ValueError for what is not there or cannot move."""
    names = list(world.moving_names)
    if name in [s.name for s in world.statics]:
        raise ValueError(
            f"{name!r} is static and cannot move; objects that can: {names}; "
            "to place it elsewhere, remove it and add another"
        )
    if name not in names:
        raise ValueError(f"no object is called {name!r}; objects: {names}")


def _restarted(world: World, edit: SetVelocity) -> World:
    _must_move(world, edit.object)
    kind = world.item(edit.object).representation
    if edit.angular_velocity is not None and not (world.is_rigid(edit.object) or material(kind).turns):
        raise ValueError(f"{edit.object!r} is {kind}, which starts without turning: give it a velocity only")
    data: dict[str, Any] = world.model_dump()
    item = next(d for d in (*data["objects"], *data["deformables"]) if d["name"] == edit.object)
    for field in ("velocity", "angular_velocity"):
        if getattr(edit, field) is not None:
            item[field] = getattr(edit, field)
    return World.model_validate(data)


def _scaled(world: World, edit: ScaleVelocity) -> World:
    _must_move(world, edit.object)
    data: dict[str, Any] = world.model_dump()
    item = next(d for d in (*data["objects"], *data["deformables"]) if d["name"] == edit.object)
    angular = edit.factor if edit.angular_factor is None else edit.angular_factor
    turn = quaternion_matrix(rotation_quaternion(np.asarray(edit.turn or (0.0, 0.0, 0.0))))
    for field, factor in (("velocity", edit.factor), ("angular_velocity", angular)):
        if field in item:
            item[field] = tuple(float(v) for v in factor * np.asarray(item[field]) @ turn.T)
    return World.model_validate(data)


def _with_value(world: World, path: str, value: float) -> World:
    after = with_parameters(world, {path: value})
    check_joints_hold(world, after)
    return with_stops_kept(world, after)


def _released(world: World, edit: Release) -> World:
    names = [a.name for a in world.attachments]
    if edit.attachment not in names:
        raise ValueError(f"no attachment is called {edit.attachment!r}; attachments of this world: {names}")
    if edit.time is None:
        return without(world, edit.attachment, "attachment")
    data: dict[str, Any] = world.model_dump()
    next(a for a in data["attachments"] if a["name"] == edit.attachment)["release"] = edit.time
    return World.model_validate(data)


def _toggled(world: World, edit: ToggleEffect) -> World:
    effects = [e.name for e in world.effects]
    if edit.effect not in effects:
        raise ValueError(f"no effect is called {edit.effect!r}; effects of this world: {effects}")
    data: dict[str, Any] = world.model_dump()
    next(e for e in data["effects"] if e["name"] == edit.effect)["enabled"] = edit.enabled
    return World.model_validate(data)
