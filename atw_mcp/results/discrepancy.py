"""Results of the tools that find and close the gap between a world and its data."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.values import Vector

Verdict = Literal["identified", "identified_with_remainder", "ambiguous", "unexplained", "nothing_missing"]
Interval95 = Annotated[list[float | None], Field(min_length=2, max_length=2)]
ERROR = "of predicting data left out, in standard deviations of the noise: near 1 where only noise is left"
BEHIND = "nats of evidence below the best: 3 are 20 to 1; null where it diverges"


class GapAnswer(Result):
    """The data that a gap was measured on, and what follows."""

    recording: str = Field(description="id of the observation")
    sealed_data: str = Field(description="which data are sealed, and why")
    next: str = Field(description="call to make next")


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

    explained: bool = Field(description="whether nothing is missing that these data could show")
    error: float | None = Field(description=f"{ERROR}; null where it diverges")
    gap: float | None = Field(description="root mean square residual beyond the noise, in `unit`")
    noise: float = Field(description="measured before any fit, root mean square, in `unit`")
    unit: str
    worst: list[str] = Field(description="series that fit worst")
    share_of_gap: dict[str, dict[str, float]] = Field(
        description="share of the excess over noise by run, object, time, phase, region, speed, axis; empty where the "
        "data are explained"
    )
    onsets: list[Onset] = Field(description="earliest first")
    kinks: list[str] = Field(description="sudden changes of velocity that nothing known explains, the largest first")
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
    interval95: Interval95 = Field(description="an end is null where it is unbounded")


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
    explains: bool = Field(description="whether nothing is left that these data could show")
    behind: float | None = Field(description=BEHIND)
    error: float | None = Field(description=f"{ERROR}; null where it diverges")
    effects: list[ProposedEffect]


class HeldOutError(Result):
    """Errors of predicting data left out, in standard deviations of the noise."""

    before: float | None = Field(description="without an effect; null where it diverges")
    after: float | None = Field(description="with those of the best hypothesis; null where it diverges")


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


class AlternativeLaw(Result):
    """Another law of force."""

    expression: str
    behind: float | None = Field(description=BEHIND)


class ResidualForce(Result):
    """The law of the force that no effect of the catalogue explains."""

    explains: bool = Field(description="whether with it only noise is left")
    summary: str
    expression: str = Field(description="acceleration [m/s^2]")
    written: str = Field(description="the same with its numbers")
    numbers: dict[str, EffectNumber]
    direction: list[str] = Field(description="of each term")
    speed_exponent: list[EffectNumber] = Field(description="of terms that depend on a power of the speed")
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
    reasons: list[str] = Field(description="what kept the verdict from being more")
    proposals: list[ProposedHypothesis] = Field(description="the one named, or the nearest, then its competitors")
    error: HeldOutError
    frequencies: dict[str, float] = Field(description="share of the bootstraps over runs that choose each effect")
    stable: float = Field(description="share of them that choose all effects of the best hypothesis")
    noise: float | None = Field(description="of positions, median [m]; null where none were measured")
    base: dict[str, float] = Field(description="refitted parameters of the world itself, SI units")
    runner_up: str | None = Field(description="the best of another name; null where none was fitted")
    set_aside: list[str] = Field(description="runs that behave unlike the rest")
    plain_laws: list[str] = Field(description="plain laws alone and in pairs, best first")
    equivalent: list[list[str]] | None = Field(default=None, description="sets of effects that predict the same motion")
    time_limit: float | None = Field(default=None, description="limit that ended the search [s]")
    experiment: DecidingExperiment | None = None
    residual_force: ResidualForce | None = None
    whole: str = Field(description="how to read all of it")


class FittedNumber(EffectNumber):
    """A fitted number of an effect, and where it stands in the world."""

    paths: list[str] = Field(description="parameters of the world")


class AddedLaw(Result):
    """An effect that was added."""

    name: str
    label: str = Field(description="what it acts on; empty where that is everything")
    law: str = Field(description="its formula")
    same_as: list[str] = Field(description="effects that the data do not distinguish from it")
    unknowns: dict[str, FittedNumber]


class GainedByEffect(Result):
    """Gain of an effect in the prediction of data left out."""

    error_before: float | None = Field(description=ERROR)
    error_after: float | None = Field(description="the same with the effect")
    gained: float | None = Field(description="nats of evidence, 3 are 20 to 1")
    further_unknowns: int = Field(description="number of unknowns that the effect adds")


class Gap(Result):
    """Residuals without and with an effect, initial states refitted."""

    before: float = Field(description="root mean square residual, in standard deviations of the noise")
    after: float = Field(description="the same with the effect")
    share: float = Field(description="of the gap beyond the noise that is left, in standard deviations")
    by_run: dict[str, list[float]] = Field(description="both errors of each run")
    gap_before: float = Field(description="root mean square residual beyond the noise, in `unit`")
    gap_after: float = Field(description="the same with the effect")
    noise_floor: float = Field(description="the noise itself, in `unit`")
    closed: float | None = Field(description="share closed; null where there was no gap")
    unit: str


class AddedEffect(GapAnswer):
    """Data of AddEffect."""

    world: str = Field(description="id of the world with the effect")
    from_world: str = Field(description="id of the world it was added to")
    laws: list[str] = Field(description="names of the effects in the world")
    effects: list[AddedLaw]
    explains: bool = Field(description="whether nothing is left in the data fitted")
    evidence: GainedByEffect
    fitted_data: Gap
    sealed: Gap | None = Field(description="on sealed data; null where none were sealed")
    pictures_of: Literal["sealed data", "data fitted"]
