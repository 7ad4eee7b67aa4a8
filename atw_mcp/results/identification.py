"""Results of the tool that fits worlds."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.values import Frames


class BestDraft(Result):
    """An earlier fit of the same frames with a lower loss."""

    world: str = Field(description="its id")
    loss: float


class FitStart(Result):
    """One search of a fit, from a start of its own."""

    seed: int
    loss_searched: float = Field(description="before refinement")
    loss: float = Field(description="at its end")
    position_rmse: float | None = Field(description="[m]; null where it diverged or no position was observed")
    rotation_rmse: float | None = Field(description="[rad]; null where it diverged or no rotation was observed")


class FittedNumber(Result):
    """A fitted parameter."""

    name: str
    value: float = Field(description="in its unit")
    unit: str = Field(description="1 where it has none")
    standard_error: float | None = Field(description="in its unit; null where the data do not determine it")
    spread: float | None = Field(description="standard deviation of the last candidates; null without a search")
    at_bound: bool = Field(description="whether it lies on a bound of the search")


class LawOfResistance(Result):
    """A law of resistance that was tested."""

    name: str
    gain: float = Field(description="fall of chi-square")
    needed: float = Field(description="fall needed to be kept")
    kept: bool


class OpenQuestion(Result):
    """A question about objects that the data leave open."""

    object: str = Field(description="one or several names")
    reason: str


class PosteriorSample(Result):
    """The sample of what the data allow, which ensemble=N draws from."""

    members: int
    seed: int
    drawn_from_bounds: list[str] = Field(description="values that the data do not determine")
    minima: int = Field(description="number of minima the members come from")
    doubt: str | None = Field(default=None, description="left out where there is none")


class FittedWorld(Result):
    """Data of FitWorld."""

    world: str = Field(description="id of the fitted world")
    from_world: str = Field(description="id of the world it started from")
    verdict: Literal["good", "poor", "failed"]
    why: str = Field(description="empty for a good fit")
    warnings: list[str] = Field(description="where the minimum is doubtful")
    best_draft: BestDraft | None = Field(description="null where no earlier fit is better")
    loss: float = Field(description="mean Huber loss of the standardised misfit")
    starts: list[FitStart] = Field(description="best first")
    position_rmse: float | None = Field(description="on the frames fitted [m]; null where it diverges or none observed")
    position_rmse_of_starting_world: float | None = Field(description="[m]; null where that diverges or none observed")
    position_rmse_held_out: float | None = Field(description="[m]; null where no frames were held out or it diverges")
    rotation_rmse: float | None = Field(description="[rad]; null where it diverges or none observed")
    shape_rmse: dict[str, dict[str, float | None]] | None = Field(
        default=None, description="by object and readout, in its unit; left out where no shapes were observed"
    )
    shape_rms_in_sigma: float | None = Field(
        default=None, description="of all shapes, in standard deviations; left out where none were observed"
    )
    position_rmse_by_object: dict[str, float | None] | None = Field(description="[m]; null where it diverges")
    frames: Frames = Field(description="first and last frame fitted")
    values: list[FittedNumber] = Field(description="all but initial states")
    initial_states: str = Field(description="how many were fitted, and how to read them")
    contacts: str = Field(description="how values of two objects combine in a contact")
    resistance: list[LawOfResistance] = Field(description="empty where none was tested")
    undetermined: list[OpenQuestion]
    undetermined_whole: str | None = Field(description="how to read the rest; null where this is all")
    ensemble: PosteriorSample | None = Field(description="null where no sample could be drawn")
    unobserved: list[str] = Field(description="objects without observations")
    not_in_world: list[str] = Field(description="observed objects that the world lacks")
    rollouts: int = Field(description="number of simulations made")
    computed_now: bool = Field(description="false where an equal request had been computed before")
    next: str = Field(description="call to make next")
