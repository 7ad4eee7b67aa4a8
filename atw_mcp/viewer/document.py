"""Describe what the viewer shows of a case: plain values and blocks of numbers, SI units throughout.

The page reads the same description: `web/src/document.ts` is generated from these models (`python -m
atw_mcp.viewer.typescript`).
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.viewer.parts import (
    Block,
    Interval,
    Part,
    Plane,
    Quaternion,
    Shape,
    Vector,
)

MovingKind = Literal["rigid", "rope", "cloth", "soft", "fluid"]


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


class Moving(Part):
    """An object that moves: a column of every rollout."""

    name: str
    kind: MovingKind
    color: str = Field(description="#rrggbb")
    mass: float | None = Field(description="[kg]")
    shape: Shape | None = Field(description="of a rigid object")
    form: str = Field(default="", description="its shape in words, where that says more than `shape`: 5 boxes")
    radius: float | None = Field(description="of a rope's line or a fluid's particle [m]")
    segments: Block | None = Field(description="int32 (s, 2): points that a rope joins")
    triangles: Block | None = Field(description="int32 (t, 3): points that are corners of cloth or of a soft surface")
    start_time: float = Field(description="when it joins the world [s]")


class Static(Part):
    """A fixed solid."""

    name: str
    color: str
    shape: Shape
    position: Vector = Field(description="[m]")
    orientation: Quaternion


class JointMark(Part):
    """A joint, an attachment or a pulley, where it is at the start.

    `anchor` moves with `object` where that is rigid, else with `other` where that is; else it stays. `other_anchor`
    moves with `other`, else stays. An attachment is where the points of `object` that it holds are.
    """

    name: str
    kind: str = Field(description="hinge, slider, ball, fixed, spring, attachment, pulley, ...")
    object: str
    other: str | None = Field(description="null: the world")
    anchor: Vector = Field(description="in world axes at the start [m]")
    other_anchor: Vector | None = Field(description="of a spring [m]")
    axis: Vector | None = Field(description="of a hinge, slider or pulley, world axes at the start")
    radius: float | None = Field(description="of a pulley [m]")
    held: list[int] = Field(default=[], description="points of `object` that an attachment holds")


class Region(Part):
    """A box of space that means something: a fluid's grid, a container, an emitter, a drain."""

    name: str
    kind: str
    lower: Vector = Field(description="[m]")
    upper: Vector = Field(description="[m]")
    object: str | None = Field(default=None, description="rigid object that carries it; null: it stays")


class Value(Part):
    """A number with its unit."""

    name: str
    value: float
    unit: str = Field(description="1 where it has none")


class Field3(Part):
    """The field of an effect in space, at the start, on a regular grid."""

    points: Block = Field(description="float32 (k, 3) [m]")
    vectors: Block = Field(description="float32 (k, 3)")
    unit: str
    what: str = Field(default="acceleration", description="what the vectors are, in words")
    uniform: bool = Field(default=False, description="the same everywhere")


class EffectMark(Part):
    """A law beyond the base model."""

    name: str
    kind: str
    title: str = Field(default="", description="standard name of the effect where that is not its kind: tilt")
    law: str = Field(description="its formula, in words")
    enabled: bool
    objects: list[str] | None = Field(description="null: all")
    parameters: list[Value]
    field: Field3 | None = Field(description="null where it has no field in space, or none that was evaluated")


class CameraView(Part):
    """A pinhole camera: pixel ~ K (R X + t)."""

    width: int
    height: int
    intrinsics: list[list[float]]
    rotation: list[list[float]]
    translation: Vector


class Following(Part):
    """How well a world follows the data that it was fitted to."""

    evidence: str = Field(description="id of the FitWorld or ModelVideo that judged it")
    verdict: Literal["good", "doubtful", "poor"]
    rms: float | None = Field(description="root mean square distance on the data fitted [m]")
    rms_held_out: float | None = Field(description="the same on data held out of the fit [m]")
    doubts: list[str] = Field(description="what is wrong or doubtful, worst first")


class Deformed(Part):
    """Points of a deformable object."""

    name: str
    points: Block = Field(description="float32 (T, k, 3) [m], NaN for particles that are not there")


class Start(Part):
    """All objects of a world where they begin: one sample, as of a rollout."""

    names: list[str] = Field(description="all of the world's moving objects")
    times: Block = Field(description="float32 (1,), 0")
    positions: Block = Field(description="float32 (1, n, 3) [m], NaN where the world does not say where")
    orientations: Block = Field(description="float32 (1, n, 4) w, x, y, z")
    active: Block = Field(description="uint8 (1, n), all 1: those too that join the world later")
    deformed: list[Deformed]


class WorldView(Part):
    """A world."""

    id: str
    label: str = Field(description="a few words: as built, as fitted, without blue_cube")
    origin: str = Field(description="built, fitted, intervention, effect, ...")
    parent: str | None
    committed: bool
    planar: bool
    seconds_per_frame: float
    frame_count: int = Field(description="observed frames that it models; 0: none")
    gravity: Vector
    camera: CameraView | None
    moving: list[Moving]
    statics: list[Static]
    joints: list[JointMark]
    regions: list[Region]
    effects: list[EffectMark]
    floor: Plane | None = Field(description="the plane that planar objects slide on; null where there is none")
    parameters: list[Value] = Field(description="of objects, joints, effects: ball.mass, ...")
    follows: Following | None = Field(default=None, description="null where no fit made it")
    start: Start | None = Field(default=None, description="null where a rollout of it is shown, which has its start")


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


class FittedParameter(Part):
    """A fitted parameter with its spread."""

    name: str
    value: float
    unit: str
    interval95: Interval | None
    bounds: Interval | None = Field(description="of its search")
    at_bound: bool
    sample: Block | None = Field(description="float32 (k,): values that the data allow")
    logarithmic: bool = Field(default=False, description="searched on a logarithmic scale")
    note: str = Field(default="", description="why the data do not determine it; empty where they do")


class Curve(Part):
    """The error over the course of a search."""

    step: str = Field(description="what is counted: generation, evaluation, iteration")
    steps: list[float]
    current: list[float | None]
    best: list[float | None]
    unit: str


class FitView(Part):
    """A fit."""

    evidence: str
    source_world: str | None
    world: str | None
    summary: str
    parameters: list[FittedParameter]
    curve: Curve | None


# --- the gap ---


class GapSeries(Part):
    """Residuals of one kind of one object in one run, before an effect was added and after."""

    run: str = Field(description="empty where there is but one: its times are then those of the worlds and the film")
    object: str
    times: Block = Field(description="float32 (T,) [s] since the start of the run")
    observed: Block = Field(description="float32 (T, 3) where the object was [m]")
    before: Block = Field(description="float32 (T, 3) simulated without the effect [m]; NaN for rotations and spins")
    residual_before: Block = Field(description="float32 (T, 3) in standard deviations of the noise")
    after: Block | None = Field(description="float32 (T, 3) simulated with the effect [m]")
    residual_after: Block | None
    kind: Literal["position", "rotation", "spin"] = "position"
    held_out: list[Interval] = Field(description="intervals of time held out of the fit [s], each fitted a start only")


class Jump(Part):
    """A sudden change of velocity that nothing known explains."""

    run: str = Field(description="as in the series")
    object: str
    time: float = Field(description="[s] since the start of the run")
    sigmas: float = Field(description="its size, in its standard deviations")
    position: Vector | None = Field(description="[m]")
    velocity_change: Vector | None = Field(description="0 along axes that were not measured [m/s]")


class Candidate(Part):
    """A hypothesis about what is missing."""

    title: str
    behind: float | None = Field(
        description="nats of evidence below the best; null where it diverges or was not compared"
    )
    explains: bool
    values: list[FittedParameter]


class GapView(Part):
    """A step of the gap workflow: a discrepancy found, effects proposed, or an effect added."""

    evidence: str
    tool: Literal["FindDiscrepancy", "ProposeEffects", "AddEffect"]
    world: str | None
    verdict: str = Field(description="in plain words")
    summary: str
    series: list[GapSeries]
    jumps: list[Jump]
    candidates: list[Candidate] = Field(description="best first")
    gap_before: float | None = Field(description="residuals beyond the noise, root mean square, in `gap_unit`")
    gap_after: float | None = Field(description="the same with the effect")
    noise: float | None = Field(description="in `gap_unit`")
    gap_unit: str = Field("m", description="m, rad or rad/s")
    gap_held_out: bool = Field(True, description="measured on held-out data; false: on the data fitted")


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
