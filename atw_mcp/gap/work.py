"""Computations of the gap tools: the base's own fit, proposals, and what an added effect is worth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from atw_mcp.calls.jobs import Cancelled, Progress
from atw_mcp.gap.numbers import GapNumbers, jumps_of, residuals_of, worst_series
from atw_mcp.gap.progress import GapProgress
from atw_mcp.gap.unknowns import unknown_of
from atw_mcp.gap.words import discrepancy_text, verdict_text, worth_text
from polyworld.core import interruption
from polyworld.core.reported import json_ready
from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapReport, GapSettings, find_gap
from polyworld.gap.candidate import Candidate, Variant, with_parts
from polyworld.gap.catalogue import catalogue
from polyworld.gap.cautions import cautions
from polyworld.gap.choose import score
from polyworld.gap.cross_validation import examined, fold_counts, folds_of, predicted
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import ground_of
from polyworld.gap.hypothesis import Hypothesis, Part
from polyworld.gap.localise import localise
from polyworld.gap.power import power_check
from polyworld.gap.report import Compared, compared, effects_of, plain_laws
from polyworld.gap.sealed import Split, gap_between, left_in_units, settled_alike
from polyworld.screening import screen
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
        found = examined(world, parts.fitted, base)
        steps.fitted(found)
        steps.report(0.5, "looking at what is left")
        seen, (gap, noise, unit) = compared(found), left_in_units(found)
        numbers = GapNumbers(residuals_of(seen), jumps_of(world, parts.fitted))
        data = {
            "explained": found.quiet,
            "error": found.error,
            "gap": gap,
            "noise": noise,
            "unit": unit,
            "worst": worst_series(numbers.residuals),
            "where": localise(found).to_json(),
            "kinks": [
                {"run": j.run, "name": j.name, "time": j.time, "change": j.size, "sigmas": j.size / j.sigma}
                for j in numbers.jumps or ()
            ],
            "cautions": [*cautions(world, parts.fitted), *(f.message for f in screen(world, parts.fitted).findings)],
            "base": [
                {"name": u.name, "paths": list(u.paths), "value": float(v), "unit": u.unit}
                for u, v in zip(base, found.values, strict=True)
            ],
            "curve": steps.curve.to_dict(),
        }
        if power:
            steps.report(0.7, "which effects could have been seen")
            data["power"] = [row.to_json() for row in power_check(found, tuple(catalogue().values()))]
        pictures = _pictures(seen)
    data = json_ready(data)
    return Outcome(discrepancy_text(data), data, pictures, numbers=numbers)


def propose(
    world: World,
    parts: Split,
    base: tuple[Unknown, ...],
    candidates: Sequence[Candidate] | None,
    settings: GapSettings,
    progress: Progress,
) -> Outcome:
    """Search for what is missing; sealed data are looked at once the verdict stands, which they can only lower."""
    steps = GapProgress(progress)
    steps.report(0.0, "base fit")
    with _interruptible():
        report = find_gap(
            world,
            parts.fitted,
            held_out=parts.held_out,
            held_out_world=parts.held_out_world,
            base=base,
            candidates=candidates,
            settings=settings,
            progress=steps.report,
            fitted=steps.fitted,
            cancelled=steps.cancelled,
        )
    data = result_of(report, world) | {"curve": steps.curve.to_dict()}
    return Outcome(verdict_text(data), data, numbers=GapNumbers(residuals_of(*_sides(report))))


def result_of(report: GapReport, world: World) -> dict[str, Any]:
    """Return a report as plain data, with the hypotheses that may be added, the next best one and the plain laws."""
    verdict = report.verdict
    best = verdict.best
    chosen = () if verdict.kind == "nothing_missing" else (best, *verdict.competitors)
    same = {f.hypothesis.names for f in verdict.equivalent}
    others = [f for f in report.pool if f.hypothesis.parts and f.hypothesis.names not in same]
    second = next((f for f in others if not best.hypothesis.names <= f.hypothesis.names), None)
    data: dict[str, Any] = json_ready(
        report.to_dict()
        | {
            "title": best.hypothesis.title,
            "proposals": [
                _described(one, best) | _addition(one, report.null, world) for one in chosen if one.hypothesis.parts
            ],
            "runner_up": None if second is None else _described(second, best),
            "plain_laws": [_described(one, best) for one in plain_laws(report.pool)],
        }
    )
    return data


def _described(one: Fitted, best: Fitted) -> dict[str, Any]:
    """Return a hypothesis with its effects, what it leaves, and how many nats it is behind the best."""
    return {
        "title": one.hypothesis.title,
        "effects": effects_of(one),
        "explains": one.quiet,
        "error": one.error,
        "behind": one.total - best.total,
    }


def _addition(one: Fitted, null: Fitted, world: World) -> dict[str, Any]:
    """Return what effects gain in the prediction of data left out, the runs that they were fitted to, and the fitted
    worlds without them and with them, stepped as the one given: a search may have stepped it more coarsely."""
    before, after = (f.hypothesis.fitted_world(f.values).with_substep(world.time.substep) for f in (null, one))
    return {
        "evidence": {
            "error_before": null.error,
            "error_after": one.error,
            "gained": null.total - one.total,
            "further_unknowns": len(one.values) - len(null.values),
        },
        "runs": [run.name for run in one.ground.recording.runs],
        "base_world": before.model_dump(mode="json"),
        "world": after.model_dump(mode="json"),
    }


def pictures_of(report: GapReport) -> dict[str, bytes]:
    """Draw the base's residuals, and those of the best hypothesis, on the data fitted."""
    return _pictures(*_sides(report))


def _sides(report: GapReport) -> tuple[tuple[Compared, ...], tuple[Compared, ...] | None]:
    """Return the data fitted beside what the base makes of them, and what the best hypothesis does."""
    best = report.verdict.best
    return compared(report.null), compared(best) if best.hypothesis.parts else None


def fitted_effect(
    world: World, effect: Effect, recording: Recording, base: tuple[Unknown, ...], progress: Progress
) -> dict[str, Any]:
    """Add one effect to a world and fit its parameters, from the values given, together with the base.

    Return it as `propose` lists its proposals.
    """
    child = with_parts(world, effects=(*world.effects, effect))
    unknowns = tuple(
        unknown_of(child, (path,), path.rsplit(".", 1)[1])
        for path in parameter_paths(child)
        if path.startswith(f"effects.{effect.name}.")
    )
    variant = Variant(child, unknowns, ({},))
    law = "an expression" if effect.kind == "expression" else effect.kind
    own = Part(Candidate(effect.name, "force", law, lambda *_: (variant,)), variant)
    steps = GapProgress(progress)
    with _interruptible():
        steps.report(0.0, "fitting the world without the effect")
        null = examined(world, recording, base)
        steps.fitted(null)
        steps.report(0.4, "fitting it with the effect")
        ground = ground_of(child, recording, null.ground.settings)
        fitted = predicted(fit(ground, Hypothesis(ground.world, base, (own,)), growing=True))
        steps.fitted(fitted)
        score([null, fitted], fold_counts(ground, folds_of(ground, ground.settings)))
    made: dict[str, Any] = json_ready(_described(fitted, fitted) | _addition(fitted, null, world))
    return made


def worth(proposal: dict[str, Any], parts: Split, progress: Progress) -> Outcome:
    """Compare a proposal's world with effects to the one without, initial states refitted: on fitted, then on sealed
    data.

    Where the data are a single run, the world made starts as that run did.
    """
    before, after = (World.model_validate(proposal[key]) for key in ("base_world", "world"))
    recording, settings, gap = parts.fitted.select(proposal["runs"]), GapSettings(), None
    with _interruptible():
        progress.report(0.6, 1.0, "before and after on the data fitted")
        fits = settled_alike((before, after), recording, settings)
        fitted, sides = gap_between(*fits), [compared(one) for one in fits]
        residuals = residuals_of(sides[0], sides[1])
        made = after if len(recording.runs) > 1 else _starting_as(fits[1], after)
        if parts.held_out is not None:
            progress.report(0.8, 1.0, "before and after on the sealed data")
            there = (parts.held_out_world(before), parts.held_out_world(after))
            fits = settled_alike(there, parts.held_out, settings)
            gap, sides = gap_between(*fits), [compared(one) for one in fits]
            residuals += residuals_of(sides[0], sides[1], parts)
    data = json_ready(
        {
            **{key: proposal[key] for key in ("effects", "explains", "evidence")},
            "fitted_data": fitted.to_json(),
            "sealed": None if gap is None else gap.to_json(),
            "pictures_of": "data fitted" if gap is None else "sealed data",
        }
    )
    says = "the data fitted are explained" if proposal["explains"] else "the data fitted are still not explained"
    text = f"{proposal['title']}: {says}; {worth_text(data)}"
    return Outcome(text, data, _pictures(sides[0], sides[1]), made, GapNumbers(residuals))


def _starting_as(one: Fitted, world: World) -> World:
    """Return the world with the initial state of the only run."""
    states = one.problem.runs[0][0].states.overrides(one.of_states()[0][None], {})
    return with_parameters(world, {path: float(value[0]) for path, value in states.items()})


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
