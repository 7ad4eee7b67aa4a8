"""Results of the tools that show frames and rollouts, and read observed motion."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.times import Covers, Periods, Place

Frames = Annotated[list[int], Field(description="frames shown")]
Times = Annotated[list[float], Field(description="of each [s]")]
SecondsPerFrame = Annotated[float, Field(description="[s]")]
EveryFrame = Annotated[str, Field(description="call that returns every object in every picture")]
Pixel = Annotated[list[int], Field(min_length=2, max_length=2)]
Status = Literal["visible", "occluded", "truncated", "hidden", "absent"]
Measured = float | bool | str | None


class VideoSize(Result):
    """Size of a video."""

    width: int = Field(description="[px]")
    height: int = Field(description="[px]")
    frames: int


class FrameShown(Result):
    """One frame as it is."""

    frame: int
    time: float = Field(description="[s]")


class OfVideo(Result):
    """What every look at frames says of the video."""

    video: VideoSize
    seconds_per_frame: SecondsPerFrame
    time_is: Literal["file time", "physical time"]


class PlainFrames(OfVideo):
    """Data of InspectFrames without observed objects."""

    frames: list[FrameShown]


class OutlinedObject(Result):
    """One observed object over the frames shown."""

    name: str
    status: Status | list[Status | None] | None = Field(
        description="one for all frames, else of each; null: not looked at"
    )
    centroid: list[Pixel | None] = Field(description="of each frame [px]; null: not seen")
    area: list[int] = Field(description="of each frame [px]")
    least_confidence: float | None = Field(description="null: seen in none")


class OutlinedFrames(OfVideo):
    """Data of InspectFrames with observed objects."""

    frames: Frames
    times: Times
    objects: list[OutlinedObject]
    unexplained_px: list[int] | None = Field(default=None, description="of each frame [px], only with residual")
    every_frame: EveryFrame


class NotPlaced(Result):
    """Frames without a position."""

    first: int
    last: int
    reason: str


class DerivedUnits(Result):
    """Units of the quantities asked for."""

    velocity: str | None = None
    speed: str | None = None
    acceleration: str | None = None
    momentum: str | None = None
    kinetic_energy: str | None = None
    potential_energy: str | None = None
    energy: str | None = None


class Derived(Result):
    """Quantities derived from measured positions."""

    columns: list[str]
    units: DerivedUnits
    cells: str = Field(description="what is in a cell")
    rows: list[list[float | list[float]]] = Field(description="time [s], frame, then [value, from, to]")
    mass: float | None = Field(default=None, description="[kg], of momentum and energies")
    kinetic_energy_is: str | None = Field(default=None, description="with mass")
    period: Periods | None = Field(default=None, description="only where it was asked for")


class ObservedMotion(Result):
    """Data of InspectObservedMotion."""

    object: str
    columns: list[str] = Field(description="u, v, area: [px]; x, y, z, position_sigma: [m]")
    rows: list[list[Measured]] = Field(description="one value for each column; null: not measured")
    covers: Covers
    of: int = Field(description="number of rows in all")
    no_position: list[NotPlaced] | None = Field(default=None, description="only where there are such frames")
    derived: Derived | None = Field(default=None, description="only with quantities")


class SimulatedObject(Result):
    """One simulated object over the frames shown."""

    name: str
    last_position: Place | None = Field(description="in the last of them [m]; null: not there yet")
    not_in_the_picture: list[int] | None = Field(default=None, description="frames, where there are any")
    not_yet_simulated: list[int] | None = Field(default=None, description="frames, where there are any")
    position_rmse: float | None = Field(default=None, description="to the observed positions [m], where compared")
    rotation_rmse: float | None = Field(default=None, description="[rad]")
    worst_error_m: float | None = Field(default=None, description="largest distance [m]")
    worst_at_frame: int | None = None
    mean_overlap: float | None = Field(default=None, description="of the outlines, 0 to 1")
    from_base_m: list[float | None] | None = Field(
        default=None, description="of a branch: distance of the centre from the base in each frame [m]"
    )


class Errors(Result):
    """Errors over all observed frames; null: nothing to compare."""

    position_rmse: float | None = Field(description="[m]")
    rotation_rmse: float | None = Field(description="[rad]")
    worst_position: float | None = Field(description="largest distance [m]")
    samples: int = Field(description="positions compared")
    shape_rmse: dict[str, dict[str, float | None]] | None = Field(
        default=None, description="of deformable objects by object and readout, in its unit"
    )
    shape_rms_in_sigma: float | None = Field(default=None, description="with shape_rmse")


class SimulatedFrames(Result):
    """Data of InspectRollout."""

    rollout: str
    world: str
    branch: bool = Field(description="true: meant to differ from the video, so there is no error")
    base: str | None = Field(default=None, description="rollout that a branch is shown beside")
    why: list[str] | None = Field(default=None, description="of a branch: why each frame is shown")
    legend: str
    camera: str
    seconds_per_frame: SecondsPerFrame
    frames: Frames
    times: Times
    over_video: bool = Field(description="whether all pictures are drawn over the video")
    objects: list[SimulatedObject]
    error: Errors | None = Field(description="null: a branch, or nothing observed")
    every_frame: EveryFrame
