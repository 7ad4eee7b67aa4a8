"""Results of the tools that open a case and observe its video."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.results.base import Result

Material = Literal["rope", "cloth", "soft", "fluid"]
Readout = Literal[
    "markers",
    "centreline",
    "curve",
    "outline",
    "image_occupancy",
    "grid_occupancy",
    "amount",
    "front",
    "level",
    "tension",
    "stretch",
]


class VideoFacts(Result):
    """Facts of a video file."""

    frame_count: int = Field(description="frames that decode")
    declared_frame_count: int = Field(description="frames that the header claims")
    width: int = Field(description="[px]")
    height: int = Field(description="[px]")
    frames_per_second: float = Field(description="the file's rate [1/s], 0 where it states none; not physical time")
    warnings: list[str] = Field(description="what is wrong with the file")


class FileFacts(Result):
    """Facts of a measured data file."""

    bytes: int = Field(description="size of the file [B]")


class CaseObservation(Result):
    """An observation of a case."""

    kind: Literal["objects", "tracks", "shapes", "recording", "camera", "depth", "mesh"]
    observation: str = Field(description="its id")


class CaseWorld(Result):
    """A world of a case."""

    world: str = Field(description="its id")
    origin: Literal["built", "given", "fitted", "effect_added", "intervention"] = Field(description="what made it")


class CaseBinding(Result):
    """A name in the questions, with the track and the object it stands for."""

    name: str = Field(description="the name in the question")
    track: str | None = Field(description="observed track; null where none")
    object: str | None = Field(description="object of the world; null where none")
    reason: str = Field(description="why")


class CaseAnswer(Result):
    """An answer that was given."""

    question: str
    answer: str | None = Field(description="null where unresolved")
    confidence: float | None = Field(description="0 to 1; null where none was given")
    evidence: list[str] = Field(description="ids of the evidence it rests on")
    missing: str = Field(description="why it is unresolved; empty where it is not")


class OpenedCase(Result):
    """Data of OpenCase for one case."""

    case: str = Field(description="its id")
    stage: Literal["World Modeling", "World Probing"]
    kind: Literal["video", "data"]
    path: str = Field(description="of the file, where it was last seen")
    facts: VideoFacts | FileFacts
    questions: list[str] = Field(description="oldest first")
    observations: list[CaseObservation] = Field(description="latest first")
    worlds: list[CaseWorld] = Field(description="oldest first")
    committed_world: str | None = Field(description="its id; null before CommitWorld")
    bindings: list[CaseBinding]
    answers: list[CaseAnswer] = Field(description="oldest first")
    next: str = Field(description="call to make next")


class ListedCase(Result):
    """One case of a list."""

    case: str = Field(description="its id")
    path: str = Field(description="of its file")
    committed_world: str | None = Field(description="its id; null before CommitWorld")


class CaseList(Result):
    """Data of OpenCase without arguments."""

    cases: list[ListedCase] = Field(description="oldest first")


class ObservedVideo(VideoFacts):
    """Facts of the video that was observed; frame_count is of the frames looked at."""

    sha256: str = Field(description="of the file's bytes")


class CueConfidence(Result):
    """How sure a look is named, each 0 to 1."""

    colour: float
    material: float
    shape: float


class StatusFrames(Result):
    """Numbers of frames by status; those of 0 are left out."""

    visible: int = 0
    occluded: int = Field(default=0, description="partly behind another object")
    truncated: int = Field(default=0, description="cut by the image border")
    hidden: int = Field(default=0, description="behind another object")
    absent: int = 0


class SeenObject(Result):
    """One object of an observation."""

    name: str
    colour: Literal[
        "red", "orange", "brown", "yellow", "green", "cyan", "blue", "purple", "gray", "black", "white", "unknown"
    ]
    material: Literal["metal", "rubber", "unknown"]
    shape: Literal["sphere", "cylinder", "cube", "box", "other", "unknown"]
    cue_confidence: CueConfidence
    rgb: list[int] = Field(min_length=3, max_length=3, description="typical colour, 0 to 255")
    entry_frame: int = Field(description="first frame that shows it")
    exit_frame: int = Field(description="last frame that shows it")
    enters: bool = Field(description="whether it comes in through the image border")
    exits: bool = Field(description="whether it leaves through the image border")
    frames: StatusFrames
    mean_confidence: float = Field(description="over the frames that show it, 0 to 1")


class SceneObjects(Result):
    """Objects found in a video."""

    frames: int = Field(description="number of frames looked at")
    objects: list[SeenObject]
    warnings: list[str] = Field(description="what is doubtful")
    next: str = Field(description="call to make next")


class DeformingObject(Result):
    """An object that seems to change its shape."""

    object: str
    may_be: Literal["rope", "cloth, soft or fluid"]
    length_over_width: float = Field(description="of its centreline, median")
    slenderness_spread: float = Field(description="standard deviation of ln(ratio of its principal axes)")
    hull_spread: float = Field(description="standard deviation of the share of its convex hull that it fills")


class ObservedObjects(SceneObjects):
    """Data of an observation of the video."""

    video: ObservedVideo
    deforming: list[DeformingObject] | None = Field(default=None, description="left out where none seems to deform")


class ShapeSeries(Result):
    """A shape followed through the frames."""

    object: str
    readout: Readout = Field(description="what was measured")
    view: Literal["image", "world"] = Field(description="image: in pixels")
    entries: int = Field(description="points, directions, cells or numbers in each frame")
    frames_seen: int = Field(description="number of frames in which it was measured")
    first_frame: int | None = Field(description="null where it was never measured")
    last_frame: int | None = Field(description="null where it was never measured")
    sigma: float | None = Field(description="median standard deviation, in its unit; null where never measured")


class MeasuredShapes(Result):
    """Data of ObserveObjects with `deformable`."""

    shapes: str = Field(description="id of these shapes")
    objects: str = Field(description="id of the observation they were measured in")
    kinds: dict[str, Material] = Field(description="what each object was taken for")
    measured: list[ShapeSeries]
    unit: Literal["px"]
    nothing_measured: list[str] = Field(description="objects of which nothing could be measured")
    next: str = Field(description="call to make next")
