"""Edits that make a branch world: what if this were gone, there, faster, or otherwise?

A branch inherits everything an edit does not name: fitted parameters, effects, camera, time base.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from polyworld.description import Description, Name, NonNegative, Quaternion, Vec3
from polyworld.joints import check_hinges_hold, turned_about
from polyworld.parameters import with_parameters
from polyworld.representations.rigid import RigidObject
from polyworld.world import StaticObject, World


class Remove(Description):
    """Take an object or a static out of the world; its hinges and effects that acted on it alone go with it."""

    action: Literal["remove"] = "remove"
    object: Name = Field(description="name of the object or static to remove")


class Add(Description):
    """Put an object or a static into the world: give exactly one of the two."""

    action: Literal["add"] = "add"
    object: RigidObject | None = Field(default=None, description="the object to add, with its initial state")
    static: StaticObject | None = Field(default=None, description="the static to add")

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.object is None) == (self.static is None):
            raise ValueError("add takes exactly one of: object, static")
        return self


class Move(Description):
    """Start an object somewhere else or otherwise turned.

    A hinged object keeps its hinge: one on a single hinge turns about it when given only an orientation; any
    other move must leave the attached points where they are.
    """

    action: Literal["move"] = "move"
    object: Name = Field(description="name of the object")
    position: Vec3 | None = Field(default=None, description="centre of mass at the object's start_time [m]")
    orientation: Quaternion | None = Field(default=None, description="unit quaternion w, x, y, z")

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.position is None and self.orientation is None:
            raise ValueError("move needs at least one of: position, orientation")
        return self


class SetVelocity(Description):
    """Start an object with another velocity."""

    action: Literal["set_velocity"] = "set_velocity"
    object: Name = Field(description="name of the object")
    velocity: Vec3 | None = Field(default=None, description="velocity at the object's start_time [m/s]")
    angular_velocity: Vec3 | None = Field(default=None, description="angular velocity, world axes [rad/s]")

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.velocity is None and self.angular_velocity is None:
            raise ValueError("set_velocity needs at least one of: velocity, angular_velocity")
        return self


class SetParameter(Description):
    """Give one parameter another value, by path."""

    action: Literal["set_parameter"] = "set_parameter"
    path: str = Field(
        description="parameter path, e.g. objects.red.friction; a contact's friction and restitution are each the "
        "geometric mean of both bodies' values, or the object's own where a static has none"
    )
    value: float = Field(description="new value, in the parameter's unit")


class ToggleEffect(Description):
    """Switch an effect on or off."""

    action: Literal["toggle_effect"] = "toggle_effect"
    effect: Name = Field(description="name of the effect")
    enabled: bool


class ChangeEnvironment(Description):
    """Change what acts on every object."""

    action: Literal["environment"] = "environment"
    gravity: Vec3 | None = Field(default=None, description="gravitational acceleration [m/s^2]")
    plane_friction: NonNegative | None = Field(default=None, description="friction coefficient of the motion plane")

    @model_validator(mode="after")
    def _some(self) -> Self:
        if self.gravity is None and self.plane_friction is None:
            raise ValueError("environment needs at least one of: gravity, plane_friction")
        return self


Intervention = Annotated[
    Remove | Add | Move | SetVelocity | SetParameter | ToggleEffect | ChangeEnvironment,
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
        return _removed(world, edit.object)
    if isinstance(edit, Add):
        return _added(world, edit)
    if isinstance(edit, Move):
        return _moved(world, edit)
    if isinstance(edit, SetVelocity):
        return _restarted(world, edit.object, velocity=edit.velocity, angular_velocity=edit.angular_velocity)
    if isinstance(edit, SetParameter):
        after = with_parameters(world, {edit.path: edit.value})
        check_hinges_hold(world, after)
        return after
    if isinstance(edit, ToggleEffect):
        return _toggled(world, edit)
    data: dict[str, Any] = world.model_dump()
    if edit.gravity is not None:
        data["environment"]["gravity"] = edit.gravity
    if edit.plane_friction is not None:
        data["environment"]["motion_plane"]["friction"] = edit.plane_friction
    return World.model_validate(data)


def _removed(world: World, name: str) -> World:
    objects = [o.name for o in world.objects]
    statics = [s.name for s in world.statics]
    if name not in objects + statics:
        raise ValueError(f"no object or static is called {name!r}; objects: {objects}; statics: {statics}")
    data: dict[str, Any] = world.model_dump()
    for part in ("objects", "statics"):
        data[part] = [d for d in data[part] if d["name"] != name]
    effects = []
    for effect in data["effects"]:
        if effect["objects"] is not None:
            effect["objects"] = [o for o in effect["objects"] if o != name]
            if not effect["objects"]:
                continue
        effects.append(effect)
    data["effects"] = effects
    data["joints"] = [j for j in data["joints"] if name not in (j["object"], j["other"])]
    return World.model_validate(data)


def _added(world: World, edit: Add) -> World:
    item = edit.object if edit.object is not None else edit.static
    assert item is not None  # the edit's own validation
    part = "objects" if edit.object is not None else "statics"
    taken = [o.name for o in world.objects] + [s.name for s in world.statics]
    if item.name in taken:
        raise ValueError(f"the name {item.name!r} is taken; names in use: {taken}")
    data: dict[str, Any] = world.model_dump()
    data[part] = [*data[part], item.model_dump()]
    return World.model_validate(data)


def _moved(world: World, edit: Move) -> World:
    position = edit.position
    hinges = [j for j in world.joints if edit.object in (j.object, j.other)]
    if len(hinges) == 1 and position is None and edit.orientation is not None:
        position = turned_about(world.object(edit.object), hinges[0], edit.orientation)
    after = _restarted(world, edit.object, position=position, orientation=edit.orientation)
    check_hinges_hold(world, after)
    return after


def _restarted(world: World, name: str, **state: tuple[float, ...] | None) -> World:
    objects = [o.name for o in world.objects]
    if name in [s.name for s in world.statics]:
        raise ValueError(
            f"{name!r} is static and cannot move; objects that can: {objects}; "
            "to place it elsewhere, remove it and add another"
        )
    if name not in objects:
        raise ValueError(f"no object is called {name!r}; objects: {objects}")
    data: dict[str, Any] = world.model_dump()
    item = next(d for d in data["objects"] if d["name"] == name)
    item.update({k: v for k, v in state.items() if v is not None})
    return World.model_validate(data)


def _toggled(world: World, edit: ToggleEffect) -> World:
    effects = [e.name for e in world.effects]
    if edit.effect not in effects:
        raise ValueError(f"no effect is called {edit.effect!r}; effects of this world: {effects}")
    data: dict[str, Any] = world.model_dump()
    next(e for e in data["effects"] if e["name"] == edit.effect)["enabled"] = edit.enabled
    return World.model_validate(data)
