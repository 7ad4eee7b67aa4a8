"""Computations of the gap tools: the base's own fit, proposals, and what an added effect is worth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from atw_mcp.calls.jobs import Cancelled, Progress
from atw_mcp.gap.numbers import GapNumbers, clocks_of, compared_trial, residuals_of, since_start
from atw_mcp.gap.progress import GapProgress
from atw_mcp.gap.unknowns import unknown_of
from atw_mcp.gap.words import verdict_text, worth_text
from polyworld.core import interruption
from polyworld.data.recording import Recording
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis, Part
from polyworld.estimation.intervals import intervals95
from polyworld.estimation.run_segments import in_segments, of_whole_runs
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapReport, GapSettings, ebic, find_gap
from polyworld.gap.cautions import cautions
from polyworld.gap.comparison import Compared
from polyworld.gap.examine import fitted_base, with_refined_noise
from polyworld.gap.held_out import Split, held_out_gap
from polyworld.gap.localise import localise
from polyworld.gap.power import power_check
from polyworld.gap.report import effects_of, finite
from polyworld.gap.segment_jumps import segment_jumps
from polyworld.world import Effect, World
from polyworld.world.parameters import parameter_paths, with_parameters


@dataclass(frozen=True)
class Outcome:
    """Outcome of a piece of work: a summary for the agent, all of it as plain data, pictures as PNG files by name, the
    world that it made, if it made one, and the numbers behind the pictures, None in older records."""

    summary: str
    data: dict[str, Any]
    pictures: dict[str, bytes] = field(default_factory=dict)
    world: World | None = None
    numbers: GapNumbers | None = None


def examine(world: World, parts: Split, base: tuple[Unknown, ...], power: bool, progress: Progress) -> Outcome:
    """Fit what a world leaves open and look at what is left; power: also what each effect had to be to be seen."""
    steps = GapProgress(progress)
    steps.report(0.0, "fitting initial states and base parameters")
    with _interruptible():
        plan = design(world, in_segments(parts.fitted, world))
        trial = fitted_base(plan, base, cancelled=steps.cancelled, fitted=steps.fitted)
        steps.report(0.5, "looking at what is left")
        where = localise(trial.context.design, trial.context.noise, trial.fit, unknowns=trial.hypothesis.unknowns)
        found = {
            "explained": trial.passes,
            "curve": steps.curve.to_dict(),
            "goodness": trial.goodness.to_json(),
            "noise": trial.context.noise.to_json(),
            "where": where.to_json(),
            "cautions": list(cautions(trial.context.design)),
            "base": [
                {"name": u.name, "paths": list(u.paths), "value": float(v), "unit": u.unit}
                for u, v in zip(trial.hypothesis.unknowns, trial.values, strict=True)
            ],
        }
        if power:
            steps.report(0.7, "which effects could have been seen")
            found["power"] = [row.to_json() for row in power_check(trial)]
        steps.report(0.9, "velocity jumps between segments of the runs")
        seen, clocks = compared_trial(trial), clocks_of(parts)
        jumps = since_start(segment_jumps(trial), clocks)
        numbers = GapNumbers(residuals_of(trial, seen, None, clocks), jumps)
        pictures = _pictures(seen)
    return Outcome(f"{trial.goodness.summary()} {where.summary()}", finite(found), pictures, numbers=numbers)


def propose(
    world: World,
    parts: Split,
    base: tuple[Unknown, ...],
    candidates: Sequence[Candidate] | None,
    settings: GapSettings,
    progress: Progress,
) -> Outcome:
    """Search for what is missing; sealed data are looked at once the verdict stands, which they can only lower."""
    recording = parts.fitted
    steps = GapProgress(progress)
    steps.report(0.0, "base fit")
    with _interruptible():
        report = find_gap(
            world,
            recording,
            held_out=parts.held_out,
            held_out_world=parts.held_out_world,
            base=base,
            candidates=candidates,
            settings=settings,
            progress=steps.report,
            fitted=steps.fitted,
            cancelled=steps.cancelled,
        )
    summary = report.to_dict()
    best = report.verdict.best
    cut = report.context.design.recording
    chosen = report.verdict.credible or ((best,) if best is not None else ())
    summary["curve"] = steps.curve.to_dict()
    summary["base_world"] = _fitted_world(report.base, world).model_dump(mode="json")
    summary["proposals"] = [
        {
            "title": trial.hypothesis.title,
            "effects": effects_of(trial, report.intervals if trial is best else np.zeros((0, 2))),
            "passes": trial.passes,
            "ebic_behind": ebic.behind(trial, chosen[0]),
            "evidence": _evidence(report.base, trial),
            "world": of_whole_runs(_fitted_world(trial, world), recording, cut).model_dump(mode="json"),
        }
        for trial in chosen
    ]
    after = None if best is None else compared_trial(best)
    numbers = GapNumbers(residuals_of(report.base, compared_trial(report.base), after, clocks_of(parts)))
    return Outcome(verdict_text(summary), finite(summary), numbers=numbers)


def _fitted_world(trial: FittedHypothesis, world: World) -> World:
    """Return the fitted world, stepped as the one given: a search may have stepped it more coarsely."""
    steps = min(world.time.substep, trial.hypothesis.world.time.substep)
    return trial.hypothesis.fitted_world(trial.values).with_substep(steps)


def pictures_of(report: GapReport) -> dict[str, bytes]:
    """Draw the base's residuals, and those of the best hypothesis, on the data fitted."""
    best = report.verdict.best
    return _pictures(compared_trial(report.base), None if best is None else compared_trial(best))


@dataclass(frozen=True)
class Proposal:
    """A fitted world with effects, and the base world that it is held against, fitted to the same data."""

    title: str
    before: World
    after: World
    effects: list[dict[str, Any]]
    explains: bool
    evidence: dict[str, float]

    @classmethod
    def of(cls, proposal: dict[str, Any], result: dict[str, Any]) -> Self:
        """Read one proposal of a stored result of `propose`."""
        return cls(
            proposal["title"],
            World.model_validate(result["base_world"]),
            World.model_validate(proposal["world"]),
            proposal["effects"],
            proposal["passes"],
            proposal["evidence"],
        )


def with_effect(world: World, effect: Effect) -> World:
    """Return the world with one more effect; raises ValueError where it does not fit in."""
    document = world.model_dump()
    return World.model_validate({**document, "effects": [*document["effects"], effect.model_dump()]})


def fitted_effect(
    world: World, effect: Effect, recording: Recording, base: tuple[Unknown, ...], progress: Progress
) -> Proposal:
    """Add one effect to a world and fit its parameters, from the values given, together with the base."""
    child = with_effect(world, effect)
    unknowns = tuple(
        unknown_of(child, (path,), path.rsplit(".", 1)[1])
        for path in parameter_paths(child)
        if path.startswith(f"effects.{effect.name}.")
    )
    variant = Variant(child, unknowns, ({u.name: u.start for u in unknowns},))
    law = "an expression" if effect.kind == "expression" else effect.kind
    steps = GapProgress(progress)
    own = Candidate(effect.name, "force", law, "", "", lambda *_: (variant,))
    with _interruptible():
        steps.report(0.0, "fitting the world without the effect")
        plan = design(world, in_segments(recording, world))
        ground = fitted_base(plan, base, cancelled=steps.cancelled, fitted=steps.fitted)
        steps.report(0.4, "fitting it with the effect")
        hypothesis = Hypothesis(child, base, (Part(own, variant),))
        start = np.concatenate([ground.values, [u.start for u in unknowns]])
        fitted = with_refined_noise(ground.context.fit(hypothesis, start, ground.fit.states))
        intervals = intervals95(fitted.context, fitted)
    return Proposal(
        effect.name,
        ground.hypothesis.fitted_world(ground.values),
        hypothesis.fitted_world(fitted.values),
        effects_of(fitted, intervals),
        fitted.passes,
        _evidence(fitted.context.refit(ground), fitted),
    )


def _evidence(ground: FittedHypothesis, trial: FittedHypothesis) -> dict[str, float]:
    """Compute what effects gain on the data fitted, under the same noise: chi2, and BIC, which counts unknowns."""
    gain = ebic.bic(ground.chi2, 0, trial.context) - ebic.bic(trial.chi2, trial.hypothesis.extra, trial.context)
    return {
        "chi2_before": ground.chi2,
        "chi2_after": trial.chi2,
        "measurements": trial.context.observations,
        "further_unknowns": trial.hypothesis.extra,
        "bic_gain": gain,
    }


def worth(proposal: Proposal, parts: Split, progress: Progress) -> Outcome:
    """Compare a world with effects to the one without, initial states refitted: on fitted, then on sealed data.

    Where the data are a single run, the world made starts as that run did.
    """
    pair, clocks = (proposal.before, proposal.after), clocks_of(parts)
    with _interruptible():
        progress.report(0.6, 1.0, "before and after on the data fitted")
        fitted = held_out_gap(*pair, parts.fitted)
        trials = _alone(pair, parts.fitted, progress)
        sides = [compared_trial(trial) for trial in trials]
        residuals = residuals_of(trials[0], sides[0], sides[1], clocks)
        made = proposal.after if len(parts.fitted.runs) > 1 else _starting_as(trials[1])
        gap = None
        if parts.held_out is not None:
            progress.report(0.8, 1.0, "before and after on the sealed data")
            pair = (parts.held_out_world(pair[0]), parts.held_out_world(pair[1]))
            gap = held_out_gap(*pair, parts.held_out)
            trials = _alone(pair, parts.held_out, progress)
            sides = [compared_trial(trial) for trial in trials]
            residuals += residuals_of(trials[0], sides[0], sides[1], clocks, held_out=True)
    data = finite(
        {
            "effects": proposal.effects,
            "explains": proposal.explains,
            "evidence": proposal.evidence,
            "fitted_data": fitted.to_dict(),
            "sealed": None if gap is None else gap.to_dict(),
            "pictures_of": "sealed data" if gap is not None else "data fitted",
        }
    )
    says = "the data fitted are explained" if proposal.explains else "the data fitted are still not explained"
    text = f"{proposal.title}: {says}; {worth_text(data)}"
    return Outcome(text, data, _pictures(sides[0], sides[1]), made, GapNumbers(residuals))


def _alone(worlds: Sequence[World], recording: Recording, progress: Progress) -> list[FittedHypothesis]:
    """Fit the initial states of each world and nothing else."""
    recording = in_segments(recording, *worlds)  # alike for all, to be compared run by run
    return [fitted_base(design(world, recording), (), cancelled=progress.cancelled) for world in worlds]


def _starting_as(trial: FittedHypothesis) -> World:
    """Return the world with the initial state of the only run, or of its first part."""
    run, states = trial.context.design.runs[0], trial.fit.states[0]
    numbers: dict[str, float] = {}
    at = 0
    for own in run.states:
        values = states[at : at + len(own.labels)]
        at += len(own.labels)
        numbers |= {path: float(value[0]) for path, value in own.overrides(values[None], {}).items()}
    return with_parameters(trial.hypothesis.world, numbers)


@contextmanager
def _interruptible() -> Iterator[None]:
    """Raise the jobs' `Cancelled` where the library raises InterruptedError."""
    try:
        yield
    except InterruptedError as error:
        raise Cancelled from error


def _pictures(before: tuple[Compared, ...], after: tuple[Compared, ...] | None = None) -> dict[str, bytes]:
    from atw_mcp.gap.pictures import map_picture, path_picture, residual_picture  # matplotlib is slow to import

    drawn = {}
    for name, draw in {"residuals.png": residual_picture, "paths.png": path_picture, "map.png": map_picture}.items():
        interruption.check()
        drawn[name] = draw(before, after)
    return drawn
