"""Facts about deformable objects and what connects things, as several tools give them."""

from __future__ import annotations

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.values import AnyJson, Vector


class DeformableFacts(Result):
    """A deformable object in a few numbers. What does not apply to its material is left out."""

    name: str
    representation: str = Field(description="rope, cloth, soft, fluid; with _planar behind it in the motion plane")
    color: str | None = Field(description="null where none was given")
    length: float | None = Field(default=None, description="of a rope at rest [m]")
    area: float | None = Field(default=None, description="of cloth at rest, or of a planar object [m^2]")
    volume: float | None = Field(default=None, description="of a soft body or fluid at rest [m^3]")
    mass: float = Field(description="[kg]; of a planar fluid per metre of thickness [kg/m]")
    particles: int | None = Field(default=None, description="of a fluid")
    nodes: int | None = None
    segments: int | None = None
    triangles: int | None = None
    tetrahedra: int | None = None
    held_by: list[str] | None = Field(default=None, description="attachments")
    fed_by: list[str] | None = Field(default=None, description="emitters of a fluid")
    thickness: float | None = Field(default=None, description="of cloth [m]")
    ends: list[Vector] | None = Field(default=None, description="of a rope: where its two ends start [m]")
    wraps_deg: dict[str, float] | None = Field(default=None, description="angle around each pulley [deg]")
    facts: dict[str, AnyJson] | None = Field(default=None, description="of a registered material")
    starts_in: list[Vector] | None = Field(default=None, description="lower and upper corner of the box [m]")
    start_frame: int | None = Field(default=None, description="left out where it is there from the first frame")


class DescribedParts(Result):
    """Deformable objects and what connects things; kinds of which the world has none are left out."""

    deformables: list[DeformableFacts] | None = None
    substep: float | None = Field(default=None, description="longest step [s], of a world with deformable objects")
    joints: list[str] | None = Field(default=None, description="names")
    attachments: list[str] | None = Field(default=None, description="names")
    pulleys: list[str] | None = Field(default=None, description="names")
    emitters: list[str] | None = Field(default=None, description="names")
    drains: list[str] | None = Field(default=None, description="names")
    containers: list[str] | None = Field(default=None, description="names")
