"""Facts about deformable objects, as results of several tools hold them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.times import Place
from atw_mcp.results.values import Json

Box = Annotated[list[Place], Field(min_length=2, max_length=2)]


class DeformableShape(Result):
    """Size, mass, resolution and start of a rope, cloth, soft body or fluid; fields of other materials are missing."""

    length: float | None = Field(default=None, description="of a rope, without tension [m]")
    area: float | None = Field(default=None, description="of a cloth, or of a planar fluid [m^2]")
    volume: float | None = Field(default=None, description="of a soft body or fluid [m^3]")
    mass: float = Field(description="[kg]; of a planar fluid [kg/m]")
    particles: int | None = Field(default=None, description="of a fluid")
    nodes: int | None = Field(default=None, description="of all but fluids")
    segments: int | None = None
    triangles: int | None = None
    tetrahedra: int | None = None
    held_by: list[str] | None = Field(default=None, description="names of its fastenings")
    thickness: float | None = Field(default=None, description="of a cloth [m]")
    ends: Box | None = Field(default=None, description="both ends of a rope [m]")
    wraps_deg: dict[str, float] | None = Field(default=None, description="of a rope: angle about each pulley [deg]")
    fed_by: list[str] | None = Field(default=None, description="emitters of a fluid")
    facts: Json | None = Field(default=None, description="of a registered material (JSON document)")
    starts_in: Box | None = Field(default=None, description="least and greatest coordinates at its start [m]")
    start_frame: int | None = Field(default=None, description="where it joins later than the first")


class DeformableFacts(DeformableShape):
    """The same with what names it."""

    name: str
    representation: str
    color: str | None


class Nodes(Result):
    """Where some nodes start."""

    of: int = Field(description="number of nodes")
    index: list[int]
    place: list[Place] = Field(description="of each of these [m]")
