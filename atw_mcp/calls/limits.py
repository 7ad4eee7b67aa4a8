"""Limits of what one call may ask for, checked before the work begins. The owner of the server sets them, no agent."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class Limits(BaseModel):
    """Sizes above which a call is refused, each with its reason."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    file_bytes: int = Field(
        default=2_000_000_000, gt=0, description="of a file, or of all files of a folder [bytes]: read in some seconds"
    )
    folder_files: int = Field(default=20_000, gt=0, description="files of a folder: ten masks in each of 2,000 frames")
    elements: int = Field(
        default=30_000, gt=0, description="of all soft bodies of a world: divided in a quarter of a minute, with 300 MB"
    )
    triangles: int = Field(default=200_000, gt=0, description="of all cloths of a world: more are not run in an hour")
    segments: int = Field(default=20_000, gt=0, description="of all ropes of a world: more are not run in an hour")
    cells: int = Field(default=1_000_000, gt=0, description="of the grid of fluids: some 200 bytes each in a rollout")
    particles: int = Field(
        default=1_000_000, gt=0, description="of all fluids, with those emitted: some 300 bytes each in a rollout"
    )


DEFAULT = Limits()
