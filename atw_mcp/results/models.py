"""Results of the tool that runs learned models."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.observation import SceneObjects
from atw_mcp.results.values import Frames, Matrix, Vector
from polyworld.world.camera import Camera

Task = Literal["segmentation", "points", "depth", "pose", "mesh"]


class ModelAtHand(Result):
    """A model whose weights are here."""

    model: str = Field(description="its name")
    task: Task
    gives: str = Field(description="what it observes")
    family: str = Field(description="a transformers model type, program or command")
    licence: str = Field(description="as it states it, else unknown")
    megabytes: float = Field(description="size of its files [MB]")


class ModelLimits(Result):
    """Limits under which models run."""

    device: str = Field(description="auto or a PyTorch device")
    batch: int = Field(description="frames or objects computed at once")
    memory_gb: float | None = Field(description="most memory [GB]; null without a limit")


class ModelList(Result):
    """Data of RunModel without a model."""

    models: list[ModelAtHand]
    not_usable: list[str] = Field(description="other folders, and why they are no models")
    limits: ModelLimits
    to_add: str = Field(description="how to add a model")


class MadeWith(Result):
    """Provenance of a model's result."""

    model: str = Field(description="its name")
    task: Task
    family: str = Field(description="a transformers model type, program or command")
    licence: str
    weights_sha256: str
    device: str
    batch: int = Field(description="frames or objects computed at once")
    versions: dict[str, str | None] = Field(description="of packages; null where one is not installed")


class Merit(Result):
    """Merit of one object's masks in two observations, each 0 to 1."""

    first: float
    second: float


class MaskAgreement(Result):
    """One object as two observations have it."""

    first: str | None = Field(description="its name in the first; null where that has it not")
    second: str | None = Field(description="its name in the second; null where that has it not")
    mean_iou: float = Field(description="mean intersection over union of its masks, 0 to 1")
    frames_agreeing: int = Field(description="number of frames")
    frames_disagreeing: list[Frames]
    merit: Merit
    better: Literal["first", "second"]


class ModelMasks(SceneObjects):
    """Data of RunModel of a segmentation."""

    made_with: MadeWith
    first: str | None = Field(default=None, description="id of this observation; left out where nothing was compared")
    second: str | None = Field(default=None, description="id of the one compared; left out where nothing was compared")
    agreement: list[MaskAgreement] | None = Field(default=None, description="left out where nothing was compared")


class FocalLength(Result):
    """Focal length that a model sees."""

    pixels: float = Field(description="median over frames [px]")
    spread: float = Field(description="standard deviation over frames, relative")


class DepthScale(Result):
    """Predicted depth over that of the floor in the case's camera."""

    ratio: float = Field(description="median over pixels")
    spread: float = Field(description="relative")


class ModelDepth(Result):
    """Data of RunModel of depth."""

    made_with: MadeWith
    nearest: float = Field(description="[m]")
    farthest: float = Field(description="[m]")
    focal_length: FocalLength | None = Field(default=None, description="left out where the model gives none")
    intrinsics: Matrix | None = Field(default=None, description="K [px]; left out without a focal length")
    scale: DepthScale | None = Field(default=None, description="left out where the case has no camera")
    camera: Camera | None = Field(default=None, description="over the floor seen; left out where none could be placed")
    no_camera: str | None = Field(default=None, description="why no camera could be placed; left out where one was")
    warnings: list[str] | None = Field(default=None, description="about the camera placed; left out without one")
    camera_kept: str | None = Field(default=None, description="id of the calibration; left out where none was kept")
    depth: str | None = Field(default=None, description="id of the depth maps; left out with use='report'")
    next: str = Field(description="call to make next")


class ModelPoints(Result):
    """Data of RunModel of points."""

    tracks: str = Field(description="id of the track record")
    made_with: MadeWith
    points: dict[str, int] = Field(description="number of points followed, by object")
    frames_with_orientation: dict[str, int] = Field(description="number of frames, by object")
    next: str = Field(description="call to make next")


class ModelPoses(Result):
    """Data of RunModel of poses."""

    tracks: str = Field(description="id of the track record")
    made_with: MadeWith
    frames_with_pose: dict[str, int] = Field(description="number of frames, by object")
    next: str = Field(description="call to make next")


class ModelMesh(Result):
    """The mesh of one object."""

    object: str
    mesh: str = Field(description="id of the mesh, for shapes of kind mesh")
    extent: Vector = Field(description="along x, y, z [m]")
    scale_from: str = Field(description="what its size was taken from")
    watertight: bool


class ModelMeshes(Result):
    """Data of RunModel of meshes."""

    meshes: list[ModelMesh]
    made_with: MadeWith
    next: str = Field(description="call to make next")
