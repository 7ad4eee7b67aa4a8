"""Blocks, vectors and shapes of which the viewer's document is made; SI units throughout."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4, description="w, x, y, z")]
Interval = Annotated[list[float | None], Field(min_length=2, max_length=2)]


class Part(BaseModel):
    """A part of a document."""

    model_config = ConfigDict(extra="forbid")


class Block(Part):
    """An array in the binary section of a packed document, in C order, little-endian; float32 may hold NaN."""

    dtype: Literal["float32", "int32", "uint16", "uint8"]
    shape: list[int]
    offset: int = Field(description="of its first byte in the binary section, a multiple of 4")


class Sphere(Part):
    """A ball."""

    kind: Literal["sphere"] = "sphere"
    radius: float = Field(description="[m]")


class Box(Part):
    """A box centred on the origin of its body."""

    kind: Literal["box"] = "box"
    half_extents: Vector = Field(description="[m]")


class Cylinder(Part):
    """A cylinder about z."""

    kind: Literal["cylinder"] = "cylinder"
    radius: float = Field(description="[m]")
    half_height: float = Field(description="[m]")


class Capsule(Part):
    """A cylinder about z with half-spheres on its ends."""

    kind: Literal["capsule"] = "capsule"
    radius: float = Field(description="[m]")
    half_height: float = Field(description="half the distance of the caps' centres [m]")


class Mesh(Part):
    """Triangles."""

    kind: Literal["mesh"] = "mesh"
    vertices: Block = Field(description="float32 (k, 3) in body axes [m]")
    triangles: Block = Field(description="int32 (t, 3), counter-clockwise from outside")


class Plane(Part):
    """A half space; points with normal · p <= offset are solid."""

    kind: Literal["plane"] = "plane"
    normal: Vector
    offset: float = Field(description="[m]")


Shape = Annotated[Sphere | Box | Cylinder | Capsule | Mesh | Plane, Field(discriminator="kind")]
