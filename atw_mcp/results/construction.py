"""Results of the tool that builds worlds."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.parts import DescribedParts
from atw_mcp.results.values import Vector
from polyworld.world import StaticObject
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import BodyShape


class PlacedObject(Result):
    """A rigid object of a world and how it starts."""

    name: str
    shape: BodyShape
    color: str | None = Field(description="null where none is known")
    start_frame: int = Field(description="frame at which it joins the world")
    position: Vector = Field(description="of its centre of mass at the start [m]")
    velocity: Vector = Field(description="of its centre of mass at the start [m/s]")


class BuiltWorld(DescribedParts):
    """Data of BuildWorld of a world from observed and described objects."""

    world: str = Field(description="id of the world")
    representation: Literal["planar", "spatial"]
    why: str = Field(description="why this representation")
    alternative_representation: Literal["planar", "spatial"] | None = Field(
        default=None, description="another that suits the tracks; left out where none does"
    )
    objects: list[PlacedObject]
    statics: list[str] = Field(description="names of fixed solids")
    seconds_per_frame: float = Field(description="[s]")
    camera: bool = Field(description="whether the world has a camera")
    assumed: list[str] = Field(description="choices that were not made by the caller")
    left_out: list[str] = Field(description="tracks not modelled, and why")
    next: str = Field(description="call to make next")


class GivenWorld(DescribedParts):
    """Data of BuildWorld of a world that was given as JSON, or as a file."""

    world: str = Field(description="id of the world")
    objects: list[RigidObject]
    statics: list[StaticObject]
    assumed: list[str] = Field(description="what is doubtful in it, and what a file holds that it does not")
