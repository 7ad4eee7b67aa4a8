"""Results of the tool that ends World Modeling."""

from __future__ import annotations

from pydantic import Field

from atw_mcp.results.base import Result


class CommittedWorld(Result):
    """Data of CommitWorld."""

    world: str = Field(description="id of the committed world")
    objects: list[str] = Field(description="names of what moves in it")
    warnings: list[str] = Field(description="what is doubtful about its fit")
    next: str = Field(description="call to make next")
