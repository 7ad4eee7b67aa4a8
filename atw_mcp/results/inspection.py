"""Results of the tools that say what a world contains and how well its numbers are known."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.deformables import DeformableFacts, DeformableShape, Nodes
from atw_mcp.results.documents import (
    AttachmentPart,
    ContainerPart,
    DrainPart,
    Edit,
    EffectPart,
    EmitterPart,
    EnvironmentPart,
    FluidGridPart,
    JointPart,
    ObserverPart,
    PulleyPart,
    RegionPart,
    ShapeOfBody,
    StaticPart,
)
from atw_mcp.results.values import Vector

Turn = Annotated[list[float], Field(min_length=4, max_length=4)]
Origin = Literal["fitted", "edited", "observed", "assumed", "given or default"]
Bounds = Annotated[list[float | None], Field(min_length=2, max_length=2)]


class KnownParameter(Result):
    """A parameter of a world, and how it is known. Which of the last fields are there depends on that."""

    path: str
    value: float | None = Field(description="null: left to the object that touches")
    unit: str
    bounds: Bounds = Field(description="null: none")
    known: Origin
    standard_error: float | None = Field(default=None, description="of fitted values; null: not known")
    interval80: list[float] | None = Field(default=None, description="of fitted values: holds 80% of what data allow")
    from_prior: bool | None = Field(default=None, description="of fitted values: whether the data say little about it")
    at_bound: bool | None = Field(default=None, description="of fitted values")
    shared_with: list[str] | None = Field(default=None, description="paths fitted as one value with this")
    undetermined: list[str] | None = Field(default=None, description="why the data do not determine it")
    edits: list[Edit] | None = Field(default=None, description="of edited values: what the branch changed")
    before: float | None = Field(default=None, description="of edited values: value before; null: it had none")


class ReadParameter(KnownParameter):
    """A parameter that was read."""

    object: str | None = Field(default=None, description="missing: its whole path was given")


class ReadVector(Result):
    """Position, velocity or angular velocity of an object as it starts."""

    object: str
    value: Vector
    unit: str
    at: float = Field(description="[s]")
    known: Origin
    standard_error: list[float | None] | None = Field(default=None, description="of fitted values; null: not fitted")


class ReadLook(Result):
    """Size at rest, shape, colour, material or representation of an object."""

    object: str
    value: float | str | ShapeOfBody | DeformableFacts | None = Field(description="null: not known")
    unit: str | None = Field(default=None, description="missing: a word")
    known: str


class Properties(Result):
    """Data of ReadProperty."""

    property: str
    values: list[ReadParameter | ReadVector | ReadLook]


class InitialState(Result):
    """Where an object starts, and how fast: what its kind has."""

    time: float = Field(description="when it joins [s]")
    position: Vector | None = Field(default=None, description="centre of mass [m]")
    orientation: Turn | None = Field(default=None, description="unit quaternion w, x, y, z")
    velocity: Vector | None = Field(default=None, description="[m/s]")
    angular_velocity: Vector | None = Field(default=None, description="world axes [rad/s]")


class InspectedObject(Result):
    """One object, with the fields asked for."""

    name: str
    representation: str
    color: str | None = None
    material: str | None = None
    shape: ShapeOfBody | DeformableShape | None = None
    joins_at_frame: float | None = None
    starts_in_view: bool | None = Field(default=None, description="missing: no camera, or not rigid")
    parameters: dict[str, KnownParameter] | None = Field(default=None, description="by name")
    initial_state: InitialState | None = None
    nodes: Nodes | None = Field(default=None, description="of ropes, cloth and soft bodies")


class Descent(Result):
    """One world that a world descends from."""

    world: str
    how: str = Field(description="how it was made from the next")
    edits: list[Edit] | None = Field(default=None, description="of branches")


class Time(Result):
    """Time base of a world."""

    seconds_per_frame: float = Field(description="[s]")
    frame_count: int = Field(description="observed frames")
    observed_until: float = Field(description="[s]")
    substep: float = Field(description="longest integration step [s]")


class ImageSize(Result):
    """Size of a camera's image."""

    width: int = Field(description="[px]")
    height: int = Field(description="[px]")


class Capabilities(Result):
    """What can be done with a world and asked of it."""

    edits: list[str]
    predicates: list[str]
    effects_that_can_be_added: list[str]
    parameters: dict[str, list[str]] = Field(description="last words of parameter paths by their first words")


class InspectedWorld(Result):
    """Data of InspectWorld."""

    world: str
    stage: Literal["draft", "committed", "branch"]
    descent: list[Descent] = Field(description="from itself back to the first")
    objects: list[InspectedObject]
    statics: list[StaticPart]
    environment: EnvironmentPart
    effects: list[EffectPart]
    joints: list[JointPart]
    attachments: list[AttachmentPart]
    pulleys: list[PulleyPart]
    no_contact: list[list[str]] = Field(description="pairs that pass through each other")
    fluid_grid: FluidGridPart | None = Field(default=None, description="missing: no fluid")
    emitters: list[EmitterPart]
    drains: list[DrainPart]
    containers: list[ContainerPart]
    region: RegionPart | None = Field(default=None, description="missing: none was given")
    observer: ObserverPart | None = Field(default=None, description="missing: none was given")
    time: Time
    camera: ImageSize | None = Field(description="null: it has none")
    capabilities: Capabilities
