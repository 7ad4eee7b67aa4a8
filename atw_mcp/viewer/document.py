"""Describe what the viewer shows of a case: plain values and blocks of numbers, SI units throughout.

The page reads the same description: `web/src/document.ts` is generated from these models (`python -m
atw_mcp.viewer.typescript`).
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.viewer.fit_parts import Curve, FitView, GapView
from atw_mcp.viewer.parts import (
    Block,
    Interval,
    Part,
    Vector,
)
from atw_mcp.viewer.world_parts import Deformed, WorldView

# --- the case ---


class Chance(Part):
    """The probability of a statement that an ensemble was asked about."""

    evidence: str
    statement: str = Field(description="in words")
    probability: float = Field(description="that it is true")
    interval90: Interval | None
    less_sure_because: str = Field(description="why it is nearer to chance than the count; empty where it is not")


class Answer(Part):
    """An answer to a question of the case."""

    question: str
    answer: str | None = Field(description="null: unresolved")
    confidence: float | None
    evidence: list[str] = Field(description="ids of the evidence it rests on")
    missing: str = Field(description="why it is unresolved; empty where it is not")
    chances: list[Chance] = Field(default=[], description="of its evidence")


class Binding(Part):
    """The meaning of a name in a question."""

    name: str
    track: str | None
    object: str | None


class CaseView(Part):
    """The case itself."""

    id: str
    kind: Literal["video", "data", "none"] = Field(description="none: a case opened by name, without a file")
    file: str = Field(description="name of its file; empty without one")
    questions: list[str]
    answers: list[Answer] = Field(description="oldest first")
    bindings: list[Binding]
    committed_world: str | None
    file_seconds_per_frame: float | None = Field(
        default=None, description="by the rate that the video's file states [s], which is not always physical time"
    )
    clock: list[float] | None = Field(
        default=None,
        description="when each frame was taken, in units of the time between frames; null where frame f was at f",
    )


class EvidenceRow(Part):
    """A result of a tool."""

    id: str
    tool: str
    status: Literal["running", "completed", "failed", "cancelled", "diverged"]
    summary: str
    world: str | None
    rollout: str | None
    observation: str | None
    objects: list[str]
    interval: Interval | None = Field(description="[s]")


class Node(Part):
    """A record that results rest on."""

    id: str
    kind: Literal["case", "observation", "world", "fit", "rollout", "evidence", "answer"]
    title: str = Field(description="a word or two")
    detail: str = Field(description="a sentence")


class Edge(Part):
    """One record derived from another."""

    source: str = Field(description="id of the node it was derived from")
    target: str = Field(description="id of the node derived")
    how: str


class Provenance(Part):
    """From the answers back to the pixels."""

    nodes: list[Node]
    edges: list[Edge]


# --- what was observed ---


class Film(Part):
    """The video of the case as a browser can play it."""

    mime: str
    data: Block | None = Field(description="uint8, the file; null where `url` says where it is")
    url: str | None
    width: int = Field(description="of the original frames, to which all pixels refer [px]")
    height: int = Field(description="[px]")
    frame_count: int
    media_times: Block = Field(description="float32 (frame_count,): when each frame begins in this file [s]")
    note: str = Field(description="how it was made from the case's file")


class Outlined(Part):
    """The outlines of one observed object."""

    name: str
    color: str = Field(description="#rrggbb")
    points: Block = Field(description="uint16 (p, 2): corners of polygons, pixels of the original frame")
    starts: Block = Field(description="int32 (q + 1,): where each polygon begins in points")
    frames: Block = Field(description="int32 (q,): the frame of each polygon, ascending")
    status: list[str] = Field(description="one a frame of `Observed.frames`")
    confidence: Block = Field(description="float32 (F,)")


class Observed(Part):
    """Outlines of all objects seen in the video."""

    id: str
    frames: Block = Field(description="int32 (F,): frame numbers that were looked at")
    objects: list[Outlined]
    camera_motion: Block | None = Field(
        default=None, description="float32 (F, 2, 3): maps from the first frame's pixels to each frame's; null: none"
    )


class Tracks(Part):
    """Measured positions of one run."""

    id: str
    run: str = Field(description="empty where there is but one")
    names: list[str]
    times: Block = Field(description="float32 (T,) [s], in the time base of the worlds that model it")
    positions: Block = Field(description="float32 (T, n, 3) [m], NaN where there is none")
    sigma: Block = Field(description="float32 (T, n) standard deviation of a coordinate [m], NaN where unknown")
    held_out_from: float | None = Field(description="time from which on they were held out of fits [s]")


# --- worlds ---


# --- rollouts ---


class Quantity(Part):
    """A series of a rollout."""

    name: str = Field(description="kinetic_energy, potential_energy, largest_tension, volume, ...")
    object: str
    unit: str
    values: Block = Field(description="float32 (T,)")


class EventMark(Part):
    """An event of a rollout."""

    kind: Literal["contact_begin", "contact_end", "entry", "exit", "rest", "release"]
    time: float = Field(description="[s]")
    participants: list[str]
    position: Vector | None
    impulse: float | None = Field(description="[N s]")
    speed: float | None = Field(description="[m/s]")


class EffectPush(Part):
    """The acceleration that an effect gives each object."""

    effect: str
    accelerations: Block = Field(description="float32 (T, n, 3) [m/s^2]; 0 where it does not act")


class Misfit(Part):
    """How far a rollout is from what was observed of an object."""

    object: str
    times: Block = Field(description="float32 (F,) [s]")
    distance: Block = Field(description="float32 (F,) [m], NaN where nothing was observed")
    sigmas: Block = Field(description="float32 (F,) in standard deviations of the measurement, NaN where unknown")
    rms: float | None = Field(description="root mean square distance [m]")


class Spread(Part):
    """Where the members of an ensemble of the same world are: the 5% and 95% quantiles of each coordinate."""

    members: int
    times: Block = Field(description="float32 (S,) [s]")
    low: Block = Field(description="float32 (S, n, 3) [m], NaN where no member has the object")
    high: Block = Field(description="float32 (S, n, 3) [m]")


class EditWords(Part):
    """An intervention that made a branch."""

    action: str
    object: str | None
    text: str


class RolloutView(Part):
    """A world run forward."""

    id: str
    world: str
    label: str
    base: str | None = Field(description="rollout of the unedited world; null where this is one, or it was not run")
    edits: list[EditWords] = Field(description="empty where it is no branch")
    status: Literal["completed", "diverged", "truncated"]
    why_ended: str | None
    horizon: float = Field(description="[s]")
    names: list[str] = Field(description="columns: all of the world's moving objects")
    times: Block = Field(description="float32 (T,) [s]")
    positions: Block = Field(description="float32 (T, n, 3) [m]")
    orientations: Block = Field(description="float32 (T, n, 4) w, x, y, z")
    velocities: Block = Field(description="float32 (T, n, 3) [m/s]")
    spins: Block = Field(description="float32 (T, n, 3) [rad/s]")
    active: Block = Field(description="uint8 (T, n)")
    deformed: list[Deformed]
    quantities: list[Quantity]
    events: list[EventMark]
    pushes: list[EffectPush]
    misfits: list[Misfit] = Field(description="empty for branches, which are meant to differ")
    sampled: str = Field(description="empty, or how the samples shown were chosen from those stored")
    spread: Spread | None = Field(default=None, description="null where no ensemble of the world is stored")


class Displaced(Part):
    """How far an object is from where it was in another rollout."""

    object: str
    most: float = Field(description="greatest distance [m]")
    time: float = Field(description="when [s]")


class ShiftedEvent(Part):
    """An event that both rollouts have, at different times."""

    event: EventMark = Field(description="as it is in base")
    shift: float = Field(description="how much later it is in edited [s]")


class ComparisonView(Part):
    """Two rollouts compared."""

    base: str
    edited: str
    evidence: str | None
    summary: str
    displaced: list[Displaced]
    gone: list[EventMark] = Field(description="events of base that edited lacks")
    new: list[EventMark]
    shifted: list[ShiftedEvent] = Field(default=[], description="by more than base's time between two samples")


# --- fits ---


# --- the gap ---


# --- work under way ---


class Running(Part):
    """Work that is not finished."""

    evidence: str
    tool: str
    message: str
    done: float
    total: float | None
    seconds_left: float | None
    curve: Curve | None


class ViewDocument(Part):
    """Everything that the viewer shows of one case."""

    format: Literal["atw-view/1"] = "atw-view/1"
    made_by: str = Field(description="atw-mcp and its version")
    case: CaseView
    missing: list[str] = Field(description="what is not shown, and why; one sentence each")
    film: Film | None
    observed: Observed | None
    tracks: list[Tracks]
    worlds: list[WorldView] = Field(description="oldest first")
    rollouts: list[RolloutView] = Field(description="oldest first")
    comparisons: list[ComparisonView]
    fits: list[FitView]
    gaps: list[GapView]
    evidence: list[EvidenceRow] = Field(description="oldest first")
    provenance: Provenance
    running: list[Running]
    shown: list[str] = Field(description="ids of one or two rollouts to open with; empty: the viewer chooses")
