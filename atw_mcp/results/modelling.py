"""Results of the tool that models a video in one call."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.identification import FittedNumber, Prediction
from atw_mcp.results.values import Json

StepName = Literal["ObserveObjects", "CalibrateCamera", "BuildWorld", "FitWorld"]


class MatchedObject(Result):
    """A known object and the track taken for it."""

    object: str = Field(description="the known object")
    track: str
    confidence: float = Field(description="probability of this pair against the best assignment without it, 0 to 1")
    margin: float = Field(description="fall of the log likelihood without this pair [nats]")
    cues: dict[str, float] = Field(description="log likelihood ratio of each cue [nats]")
    seen_over_known_size: float | None = Field(description="null where a size is unknown")
    notes: list[str]


class UnlistedTrack(Result):
    """A track that no known object explains."""

    track: str = Field(description="its name")
    colour: str
    shape: str
    frames: int = Field(description="number of frames that show it")
    moves: bool
    mean_confidence: float = Field(description="over these frames, 0 to 1")


class BodyError(Result):
    """Error of one object's simulated places."""

    object: str
    error_m: float = Field(description="root mean square [m]")
    error_px: float | None = Field(description="root mean square [px]; null without a camera")
    error_over_radius: float
    error_over_noise: float | None = Field(description="of its track; null where that states none")
    frames: int = Field(description="number of frames compared")


class ModellingStep(Result):
    """A call that was made."""

    tool: StepName
    evidence: str = Field(description="id of its result")
    arguments: Json | None = Field(default=None, description="all but case; this and what follows: in the record")
    doubts: list[str] | None = None
    assumed: list[str] | None = Field(default=None, description="choices that were not made by the caller")
    to_correct: str | None = Field(default=None, description="calls to make where it is wrong")


class _Modelling(Result):
    """The parts of any outcome of a modelling."""

    matches: list[MatchedObject] | None = Field(default=None, description="left out where nothing was to match")
    found_by_colour_and_size: list[str] | None = Field(
        default=None, description="objects that were looked for instead; left out where none was"
    )
    unseen_objects: list[str] | None = Field(
        default=None, description="known objects without a track; left out where nothing was to match"
    )
    unlisted_tracks: list[UnlistedTrack] | None = Field(default=None, description="left out where nothing was to match")
    steps: list[ModellingStep]
    next: str = Field(description="call to make next")


class OtherWorld(Result):
    """The world in the other representation, which follows the video no better by more than its scatter."""

    world: str
    representation: Literal["planar", "spatial"]
    error_over_this: float = Field(description="its error over that of the world kept")


class ModelledVideo(_Modelling):
    """Data of ModelVideo."""

    world: str = Field(description="id of the fitted world")
    verdict: Literal["good", "doubtful", "poor"]
    doubts: list[str]
    kept: str | None = Field(default=None, description="facts taken from an earlier call, since this gave none")
    errors: list[BodyError] | None = Field(
        default=None, description="largest beside the body's size first; missing where the world diverges"
    )
    representation: Literal["planar", "spatial"]
    other: OtherWorld | None = Field(default=None, description="missing where one representation alone was fitted")
    rolling: str = Field(description="how what can roll moves, as the evidence has it")
    values: list[FittedNumber] | None = Field(default=None, description="constants: frictions, restitutions, dampings")
    contacts: str = Field(description="what friction and restitution of NAME are in a contact")
    prediction: Prediction | None = Field(default=None, description="of the frames left out, and of what comes after")


class StoppedModelling(_Modelling):
    """Data of ModelVideo where a step failed."""

    failed_step: StepName | Literal["matching"]
    reason: str
    failed_evidence: str | None = Field(description="id of its record; null where it was refused")
