"""Parts of the viewer's document about a world: its bodies, joints, regions, effects and camera."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.viewer.parts import (
    Block,
    Part,
    Plane,
    Quaternion,
    Shape,
    Vector,
)

MovingKind = Literal["rigid", "rope", "cloth", "soft", "fluid"]


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
