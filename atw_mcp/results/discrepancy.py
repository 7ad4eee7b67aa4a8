"""Results of the tools that find and close the gap between a world and its data."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.values import Vector

Axis = Literal["x", "y", "z"]
Quantity = Literal["position", "rotation", "spin"]
Verdict = Literal["identified", "identified_with_remainder", "ambiguous", "unexplained", "nothing_missing"]
Interval95 = Annotated[list[float | None], Field(min_length=2, max_length=2)]


class GapAnswer(Result):
    """The data that a gap was measured on, and what follows."""

    recording: str = Field(description="id of the observation")
    sealed_data: str = Field(description="which data are sealed, and why")
    next: str = Field(description="call to make next")


class Rhythm(Result):
    """An oscillation in the residuals."""

    frequency: float = Field(description="[Hz]")
    p: float = Field(description="probability of one as strong in noise")
    run: str
    name: str = Field(description="object")
    kind: Quantity
    axis: Axis


class GoodnessOfFit(Result):
    """Whether the fit leaves only noise."""

    passes: bool
    p: float | None = Field(description="probability of such residuals in noise; null where too few data can judge")
    ratio_to_noise: float | None = Field(description="of smooth residuals; null where too few data can judge")
    rhythm: Rhythm | None = Field(default=None, description="left out where there is none")


class Onset(Result):
    """From when on an object's motion differs."""

    run: str
    object: str
    time: float = Field(description="since the run's start [s]")
    strength: float = Field(description="standard deviations by which the first window that shows it is off")


class BaseValue(Result):
    """A parameter of the world itself, refitted."""

    name: str
    value: float = Field(description="in its unit")
    unit: str = Field(description="1 where it has none")


class FoundDiscrepancy(GapAnswer):
    """Data of FindDiscrepancy."""

    explained: bool = Field(description="whether only noise is left")
    goodness: GoodnessOfFit
    worst: list[str] = Field(description="series that fit worst")
    noise: str = Field(description="its level, correlation and outliers")
    share_of_gap: dict[str, dict[str, float]] = Field(
        description="share of the excess over noise by run, object, time, phase, region, speed, axis; empty where the "
        "data are explained"
    )
    onsets: list[Onset] = Field(description="earliest first")
    base: list[BaseValue]
    cautions: list[str] | None = Field(default=None, description="what these data leave open; left out where nothing")
    could_have_been_missed: list[str] | None = Field(default=None, description="with power=true: effects")
    and_more: int | None = Field(default=None, description="number of further ones; left out where that is all")
    would_have_been_seen: list[str] | None = Field(default=None, description="with power=true: effects")
    whole: str = Field(description="how to read all of it")


class EffectNumber(Result):
    """A fitted number of an effect."""

    value: float = Field(description="in its unit")
    unit: str = Field(description="1 where it has none")
    interval95: Interval95 | None = Field(
        default=None, description="left out where it was not computed; an end is null where it is unbounded"
    )


class ProposedEffect(Result):
    """An effect of a proposal."""

    name: str
    law: str = Field(description="its formula")
    label: str | None = Field(default=None, description="what it acts on; left out where that is everything")
    same_as: list[str] | None = Field(
        default=None, description="effects that these data do not distinguish from it; left out where there are none"
    )
    unknowns: dict[str, EffectNumber]


class ProposedHypothesis(Result):
    """Effects that would explain the data together."""

    hypothesis: int = Field(description="its number, for AddEffect")
    title: str
    explains: bool = Field(description="whether only noise is left")
    ebic_behind: float | None = Field(description="extended BIC above that of the best; null where it diverges")
    effects: list[ProposedEffect]


class RunnerUp(Result):
    """The best hypothesis of another name."""

    effects: list[str]
    ebic_behind: float | None = Field(description="extended BIC above that of the best; null where it diverges")
    held_out_behind: float | None = Field(description="mean chi2 lost on data left out; null where it diverges")
    held_out_error: float | None = Field(description="its standard error; null where it is unknown")
    passes: bool = Field(description="whether it leaves only noise")


class PlainLaw(Result):
    """A plain law, fitted by itself."""

    name: str
    label: str = Field(description="what it acts on; empty where that is everything")
    values: dict[str, float] = Field(description="SI units")
    ebic_behind: float | None = Field(description="extended BIC above that of the answer; null where it diverges")
    passes: bool = Field(description="whether it leaves only noise")


class ContradictingCheck(Result):
    """A check that lowered the verdict."""

    check: Literal["null_control", "held_out", "held_out_remainder", "runner_up", "nothing_held_out", "time_limit"]
    found: str


class StabilityOverRuns(Result):
    """The comparison of hypotheses with model error admitted."""

    chosen_in: dict[str, float] = Field(description="share of the subsets of runs in which each effect is chosen")
    held_out_gain: float | None = Field(description="mean fall of chi2 on runs left out; null where unknown")
    held_out_error: float | None = Field(description="its standard error; null where it is unknown")
    ebic_ahead: float | None = Field(description="extended BIC below that of no effect; null where unknown")
    model_error: dict[str, float] = Field(description="smooth residuals by kind of measurement, in units of the noise")
    competitors: list[list[str]] = Field(description="sets of effects that come near")
    reasons: list[str] = Field(description="why none is named; empty where one is")


class NearMiss(Result):
    """Effects that would lower the misfit of data that are explained already."""

    effects: list[str]
    ebic_gain: float


class SeparatedPair(Result):
    """Two hypotheses whose forecasts an experiment separates."""

    first: list[str] = Field(description="effects")
    second: list[str] = Field(description="effects")
    sigmas: float = Field(description="standard deviations between the forecasts")


class DecidingExperiment(Result):
    """A run that would decide between hypotheses."""

    object: str
    position: Vector = Field(description="at the start [m]")
    velocity: Vector = Field(description="at the start [m/s]")
    angular_velocity: Vector = Field(description="at the start [rad/s]")
    duration: float = Field(description="[s]")
    interval: float = Field(description="between frames [s]")
    watch: str = Field(description="coordinate and instant that differ most")
    forecasts: dict[str, float | None] = Field(description="expected there, by hypothesis; null where it diverges")
    separations: list[SeparatedPair]
    decides: bool = Field(description="whether every pair is separated clearly")


class ForceNumber(Result):
    """A fitted number of a law of force."""

    value: float = Field(description="in its unit")
    unit: str = Field(description="1 where it has none")
    interval95: Interval95 = Field(description="an end is null where it is unbounded")


class AlternativeLaw(Result):
    """Another law of force."""

    expression: str
    ebic_behind: float | None = Field(description="extended BIC above that of the best; null where it diverges")


class ResidualForce(Result):
    """The law of the force that no effect of the catalogue explains."""

    explains: bool = Field(description="whether with it only noise is left")
    summary: str
    expression: str = Field(description="acceleration [m/s^2]; empty where no term helps")
    written: str = Field(description="the same with its numbers")
    numbers: dict[str, ForceNumber]
    direction: list[str] = Field(description="of each term")
    speed_exponent: list[ForceNumber] = Field(description="of terms that depend on a power of the speed")
    depends_on: list[str]
    chi2_before: float | None = Field(description="without it; null where that diverges")
    chi2_after: float | None = Field(description="with it; null where that diverges")
    data: int = Field(description="number of measurements")
    complete: bool = Field(description="whether all laws were tried")
    beside: list[str] = Field(description="effects of the catalogue that act with it")
    alternatives: list[AlternativeLaw]


class ProposedEffects(GapAnswer):
    """Data of ProposeEffects. Fields after plain_laws are left out where there is nothing to say."""

    verdict: Verdict
    proposals: list[ProposedHypothesis] = Field(description="best first")
    runner_up: RunnerUp | None = Field(description="null where no other name was fitted")
    goodness: str = Field(description="whether the best leaves only noise")
    noise: str = Field(description="its level, correlation and outliers")
    base: dict[str, float] = Field(description="refitted parameters of the world itself, SI units")
    null_control: str | None = Field(description="verdict on data of the world itself; null where it was not needed")
    set_aside: list[str] = Field(description="runs that behave unlike the rest")
    plain_laws: list[PlainLaw]
    remainder: str | None = Field(default=None, description="what the answer leaves unexplained")
    checks: list[ContradictingCheck] | None = None
    stability: StabilityOverRuns | None = None
    time_limit: float | None = Field(default=None, description="limit that ended the search [s]")
    other_forms: list[str] | None = Field(default=None, description="the same effects by another rule or on others")
    near_misses: list[NearMiss] | None = None
    experiment: DecidingExperiment | None = None
    residual_force: ResidualForce | None = None
    whole: str = Field(description="how to read all of it")


class FittedNumber(Result):
    """A fitted number of an effect, and where it stands in the world."""

    value: float = Field(description="in its unit")
    unit: str = Field(description="1 where it has none")
    interval95: Interval95 | None = Field(
        description="null where it was not computed; an end is null where it is unbounded"
    )
    paths: list[str] = Field(description="parameters of the world")


class AddedLaw(Result):
    """An effect that was added."""

    name: str
    label: str = Field(description="what it acts on; empty where that is everything")
    law: str = Field(description="its formula")
    same_as: list[str] = Field(description="effects that the data do not distinguish from it")
    unknowns: dict[str, FittedNumber]


class GainedByEffect(Result):
    """Gain of an effect on the data fitted."""

    chi2_before: float
    chi2_after: float
    measurements: float = Field(description="number of measurements")
    further_unknowns: float = Field(description="number of unknowns that the effect adds")
    bic_gain: float = Field(description="fall of the Bayesian information criterion")


class Gap(Result):
    """Root mean square residuals beyond the noise, without and with an effect."""

    gap_before: float = Field(description="in `unit`")
    gap_after: float = Field(description="in `unit`")
    noise_floor: float = Field(description="the noise itself, in `unit`")
    closed: float | None = Field(description="share closed; null where there was no gap")
    unit: str


class AddedEffect(GapAnswer):
    """Data of AddEffect."""

    world: str = Field(description="id of the world with the effect")
    from_world: str = Field(description="id of the world it was added to")
    laws: list[str] = Field(description="names of the effects in the world")
    effects: list[AddedLaw]
    explains: bool = Field(description="whether only noise is left in the data fitted")
    evidence: GainedByEffect
    fitted_data: Gap
    sealed: Gap | None = Field(description="on sealed data; null where none were sealed")
    pictures_of: Literal["sealed data", "data fitted"]
