"""Deformable objects and what connects things, as several tools describe them."""

from __future__ import annotations

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.deformables import DeformableFacts


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
