"""Results of the tool that fits worlds."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.values import Frames


class BestDraft(Result):
    """An earlier fit of the same frames with smaller errors."""

    world: str = Field(description="its id")
    error_over_this: float = Field(description="its errors over this fit's; of losses where no frames were left out")
    on: Literal["predicted", "fitted"] = Field(description="the frames that were compared")


class Decides(Result):
    """A constant that decides where a body goes."""

    constant: str
    share_of_variance: float = Field(description="of where it is then, that the constant explains")


class HalfWidths(Result):
    """Half widths of the 80% interval of a place [m], by how far ahead it is predicted."""

    cut: float = Field(description="in the first frame left out")
    half_a_second: float = Field(alias="0.5_s_after", description="0.5 s after the clip")
    a_second: float = Field(alias="1_s_after", description="1 s after the clip")


class BodyPrediction(Result):
    """How one body is predicted from the frames before those left out."""

    object: str
    error: float | None = Field(description="root mean square distance [m]; null where it was not seen there")
    error_had_it_stayed: float | None = Field(description="error of a body that stays where it was last seen [m]")
    noise: float = Field(description="of a measured place [m]")
    half_width80: HalfWidths
    decided_by: list[Decides] = Field(description="what decides where it is 1 s after the clip")


class Prediction(Result):
    """How the frames left out are predicted."""

    first_frame_left_out: int
    bodies: list[BodyPrediction]
    inside: float | None = Field(
        alias="share_inside_80%", description="of its measured coordinates, 80% intervals hold"
    )


class FittedNumber(Result):
    """A fitted parameter."""

    name: str
    value: float = Field(description="in its unit")
    unit: str = Field(description="1 where it has none")
    interval80: list[float] = Field(description="holds 80% of what the data allow")
    prior80: list[float] | None = Field(description="holds 80% before the data; null where nothing is assumed")
    from_prior: bool = Field(description="whether the data say little and the value is the prior's")
    at_bound: bool = Field(description="whether it lies on a bound of the search")


class OpenQuestion(Result):
    """A question about objects that the data leave open."""

    object: str = Field(description="one or several names")
    reason: str


class PosteriorSample(Result):
    """The sample of what the data allow, which ensemble=N draws from."""

    members: int
    seed: int
    effective: float = Field(description="number of independent draws that the members are worth")


class FittedWorld(Result):
    """Data of FitWorld."""

    world: str = Field(description="id of the fitted world")
    from_world: str = Field(description="id of the world it started from")
    verdict: Literal["good", "doubtful", "poor"]
    why: str = Field(description="empty for a good fit")
    prediction: Prediction | None = Field(description="null where too few frames are there to leave any out")
    warnings: list[str] = Field(description="where the fit is doubtful")
    notes: list[str] = Field(description="what was made of the data")
    best_draft: BestDraft | None = Field(description="null where no earlier fit is better")
    loss: float = Field(description="mean robust square of the standardised misfit")
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
    contacts: str = Field(description="how values of two objects combine in a contact")
    rolling: str = Field(description="how what can roll moves, as the evidence has it")
    slack: list[float] = Field(
        description="by collision, how far it departs from its impact law, in standard deviations"
    )
    undetermined: list[OpenQuestion]
    undetermined_whole: str | None = Field(description="how to read the rest; null where this is all")
    ensemble: PosteriorSample | None = Field(description="null where no sample could be drawn")
    unobserved: list[str] = Field(description="objects without observations")
    not_in_world: list[str] = Field(description="observed objects that the world lacks")
    study: list[str] = Field(description="cases fitted together")
    rollouts: int = Field(description="number of simulations made")
    computed_now: bool = Field(description="false where an equal request had been computed before")
    next: str = Field(description="call to make next")
