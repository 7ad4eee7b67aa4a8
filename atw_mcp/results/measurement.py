"""Results of the tools that import observations and calibrate the camera."""

from __future__ import annotations

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.observation import ShapeSeries
from atw_mcp.results.values import Vector
from polyworld.world.camera import Camera
from polyworld.world.shapes import BodyShape


class ImportedRun(Result):
    """One run of a recording."""

    run: str = Field(description="its name")
    objects: list[str]
    instants: int = Field(description="number of times at which anything was measured")
    from_: float = Field(alias="from", description="first time [s]")
    to: float = Field(description="last time [s]")
    orientations: bool = Field(description="whether any were measured")
    spins: bool = Field(description="whether any angular velocities were measured")
    sealed: bool = Field(description="whether no fit and no search sees it")


class ImportedRecording(Result):
    """Data of ImportObservation of a recording."""

    recording: str = Field(description="its id")
    runs: list[ImportedRun]
    objects: list[str]
    sealed_data: str = Field(description="which data are sealed, and why")
    remarks: list[str] = Field(description="how the file was read where it leaves a choice")
    next: str = Field(description="call to make next")


class ImportedTrack(Result):
    """One tracked object."""

    name: str
    shape: BodyShape | None = Field(description="null where the file states none")
    color: str | None = Field(description="null where the file states none")
    material: str | None = Field(description="null where the file states none")
    first_frame: int | None = Field(description="null where it was never seen")
    last_frame: int | None = Field(description="null where it was never seen")
    observed: int = Field(description="number of frames in which it was seen")


class ImportedTracks(Result):
    """Data of ImportObservation of tracks, points or series."""

    tracks: str = Field(description="id of the track record")
    objects: list[ImportedTrack]
    shapes: list[ShapeSeries] | None = Field(default=None, description="left out where there are none")
    left_out: list[str] | None = Field(default=None, description="what was not taken; left out where nothing was")
    frames: list[int] = Field(max_length=2, description="first and last; empty where there are none")
    seconds_per_frame: float = Field(description="[s]")
    next: str = Field(description="call to make next")


class ImportedDepth(Result):
    """Data of ImportObservation of depth maps."""

    depth: str = Field(description="id of the depth maps")
    path: str = Field(description="of the file, which is read when needed")
    frames: list[int] = Field(description="frame of each map")
    height: int = Field(description="[px]")
    width: int = Field(description="[px]")
    known_share: float = Field(description="share of pixels with a depth, 0 to 1")
    nearest: float | None = Field(description="[m]; null where no pixel has a depth")
    farthest: float | None = Field(description="[m]; null where no pixel has a depth")
    next: str = Field(description="call to make next")


class ImportedMesh(Result):
    """Data of ImportObservation of a triangle mesh."""

    mesh: str = Field(description="id of the mesh, for shapes of kind mesh")
    file: str = Field(description="its name")
    vertices: int = Field(description="number of vertices")
    faces: int = Field(description="number of triangles")
    watertight: bool
    lower: Vector = Field(description="least x, y, z [m]")
    upper: Vector = Field(description="greatest x, y, z [m]")
    next: str = Field(description="call to make next")


class CalibratedCamera(Result):
    """Data of CalibrateCamera, and of ImportObservation of a camera."""

    camera: Camera
    rms: float | None = Field(description="root mean square reprojection error [px]; null where nothing was compared")
    largest_error: float | None = Field(description="[px]; null where nothing was compared")
    compared: int = Field(description="number of points compared")
    method: str = Field(description="how the camera was found")
    warnings: list[str] = Field(description="what was assumed or is doubtful")
    centre: Vector = Field(description="place of the camera in the world [m]")
    next: str = Field(description="call to make next")
