"""Parts of the viewer's document about fits and gaps."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.viewer.parts import (
    Block,
    Interval,
    Part,
    Vector,
)


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
