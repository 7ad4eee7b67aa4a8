"""What the gap tools compute: numbers left free, the base's own fit, proposals, and what an added effect is worth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from atw_mcp.app import App
from atw_mcp.gap_pictures import map_picture, path_picture, residual_picture
from atw_mcp.gap_words import verdict_text, worth_text
from atw_mcp.jobs import Cancelled, Progress
from polyworld.discrepancy import GapReport, GapSettings, find_gap
from polyworld.discrepancy.candidate import Candidate, Unknown, Variant
from polyworld.discrepancy.comparison import Compared, compared
from polyworld.discrepancy.design import design
from polyworld.discrepancy.examine import fitted_base, with_refined_noise
from polyworld.discrepancy.holdback import HeldBack
from polyworld.discrepancy.hypothesis import Hypothesis, Part
from polyworld.discrepancy.localise import localise
from polyworld.discrepancy.power import power_check
from polyworld.discrepancy.report import effects_of, finite
from polyworld.discrepancy.seal import sealed_gap
from polyworld.discrepancy.search import SearchSettings
from polyworld.discrepancy.trial import Trial
from polyworld.parameter_tables import STATE_PARAMETERS
from polyworld.parameters import parameter_paths, read_parameter, specification
from polyworld.recording import Recording
from polyworld.world import Effect, World

STATES = {path.rpartition(".")[0] for path in STATE_PARAMETERS} | {"shift"}
ERRORS = 5.0  # standard errors that make an ordinary change of a fitted number
SHARE = 0.05  # of its range, where no standard error is known


def base_unknowns(app: App, world: World, paths: Sequence[str] | None) -> tuple[Unknown, ...]:
    """The numbers fitted anew in every hypothesis: those given by path, else those that FitWorld fitted in this world.

    Initial states are always free and not among them. Raises KeyError or ValueError for a path that cannot be fitted.
    """
    if paths is not None:
        return unknowns_at(world, paths)
    fitted = _last_fit(app, world)
    found = []
    for value in fitted or ():
        known = tuple(p for p in value["paths"] if not _is_state(p) and _readable(world, p))
        if known:
            error = value["standard_error"]
            found.append(_unknown(world, known, value["name"], value["lower"], value["upper"], error))
    return tuple(found)


def unknowns_at(world: World, paths: Sequence[str]) -> tuple[Unknown, ...]:
    """One unknown for each parameter path, in the range that a fit searches."""
    return tuple(_unknown(world, (path,), path) for path in dict.fromkeys(paths))


@dataclass(frozen=True)
class Examined:
    """Whether a world explains a recording, and where it does not."""

    explained: bool
    summary: str
    data: dict[str, Any]
    pictures: dict[str, bytes]


def examine(world: World, recording: Recording, base: tuple[Unknown, ...], power: bool, progress: Progress) -> Examined:
    """Fit what a world leaves open and look at what is left; power: also what each effect had to be to be seen."""
    progress.report(0.0, 1.0, "fitting initial states and base parameters")
    with _interruptible():
        trial = fitted_base(design(world, recording), base, cancelled=progress.cancelled)
        progress.report(0.5, 1.0, "looking at what is left")
        where = localise(trial.bench.design, trial.bench.noise, trial.fit, unknowns=trial.hypothesis.unknowns)
        told = {
            "explained": trial.passes,
            "goodness": trial.goodness.to_json(),
            "noise": trial.bench.noise.to_json(),
            "where": where.to_json(),
            "base": [
                {"name": u.name, "paths": list(u.paths), "value": float(v), "unit": u.unit}
                for u, v in zip(trial.hypothesis.unknowns, trial.values, strict=True)
            ],
        }
        if power:
            progress.report(0.7, 1.0, "which effects could have been seen")
            told["power"] = [row.to_json() for row in power_check(trial)]
        shown = _pictures(_compared(trial))
    verdict = trial.goodness.summary()
    return Examined(trial.passes, f"{verdict} {where.summary()}", finite(told), shown)


@dataclass(frozen=True)
class Proposed:
    """The outcome of a search: all of it, what an agent is shown, and a summary."""

    summary: str
    data: dict[str, Any]
    shown: dict[str, Any]


def propose(
    world: World,
    recording: Recording,
    base: tuple[Unknown, ...],
    candidates: Sequence[Candidate] | None,
    max_effects: int,
    seed: int,
    progress: Progress,
) -> Proposed:
    """Search for what is missing; the sealed data are not given to it."""
    settings = GapSettings(search=SearchSettings(max_effects=max_effects), seed=seed)
    with _interruptible():
        report = find_gap(
            world,
            recording,
            base=base,
            candidates=candidates,
            settings=settings,
            progress=lambda share, step: progress.report(share, 1.0, step),
            cancelled=progress.cancelled,
        )
    told = report.to_dict()
    chosen = report.verdict.credible or ((report.verdict.best,) if report.verdict.best is not None else ())
    told["base_world"] = report.base.hypothesis.fitted_world(report.base.values).model_dump(mode="json")
    told["proposals"] = [
        finite(
            {
                "title": trial.hypothesis.title,
                "effects": effects_of(trial, report.intervals if trial is report.verdict.best else np.zeros((0, 2))),
                "passes": trial.passes,
                "ebic": trial.ebic,
                "world": trial.hypothesis.fitted_world(trial.values).model_dump(mode="json"),
            }
        )
        for trial in chosen
    ]
    shown = {key: value for key, value in told.items() if key not in ("history", "world", "base_world", "proposals")}
    shown["proposals"] = [{key: value for key, value in item.items() if key != "world"} for item in told["proposals"]]
    shown["steps"] = len(told["history"])
    return Proposed(verdict_text(told), told, shown)


def pictures_of(report: GapReport) -> dict[str, bytes]:
    """The base's residuals, and those of the best hypothesis, on the data fitted."""
    best = report.verdict.best
    return _pictures(_compared(report.base), None if best is None else _compared(best))


@dataclass(frozen=True)
class Proposal:
    """A fitted world with effects, and the base world that it is held against, fitted to the same data."""

    title: str
    before: World
    after: World
    effects: list[dict[str, Any]]

    @classmethod
    def of(cls, proposal: dict[str, Any], result: dict[str, Any]) -> Self:
        """One proposal of a stored result of `propose`."""
        return cls(
            proposal["title"],
            World.model_validate(result["base_world"]),
            World.model_validate(proposal["world"]),
            proposal["effects"],
        )


def with_effect(
    world: World, effect: Effect, recording: Recording, base: tuple[Unknown, ...], progress: Progress
) -> Proposal:
    """Add one effect to a world and fit its parameters, from the values given, together with the base."""
    child = World.model_validate({**world.model_dump(), "effects": [*world.model_dump()["effects"], effect]})
    unknowns = tuple(
        _unknown(child, (path,), path.rsplit(".", 1)[1])
        for path in parameter_paths(child)
        if path.startswith(f"effects.{effect.name}.")
    )
    variant = Variant(child, unknowns, ({u.name: u.start for u in unknowns},))
    law = "an expression" if effect.kind == "expression" else effect.kind
    own = Candidate(effect.name, "force", law, frozenset(), "", "", lambda *_: (variant,))
    with _interruptible():
        progress.report(0.0, 1.0, "fitting the world without the effect")
        ground = fitted_base(design(world, recording), base, cancelled=progress.cancelled)
        progress.report(0.4, 1.0, "fitting it with the effect")
        hypothesis = Hypothesis(child, base, (Part(own, variant),))
        start = np.concatenate([ground.values, [u.start for u in unknowns]])
        fitted = with_refined_noise(ground.bench.fit(hypothesis, start, ground.fit.states))
    return Proposal(
        effect.name,
        ground.hypothesis.fitted_world(ground.values),
        hypothesis.fitted_world(fitted.values),
        effects_of(fitted, np.zeros((0, 2))),
    )


@dataclass(frozen=True)
class Worth:
    """What an added effect is worth, on the data fitted and on the sealed ones."""

    title: str
    world: World
    summary: str
    data: dict[str, Any]
    pictures: dict[str, bytes]


def worth(proposal: Proposal, parts: HeldBack, progress: Progress) -> Worth:
    """Hold a world with effects against the one without, initial states fitted anew: on fitted, then on sealed data."""
    with _interruptible():
        progress.report(0.6, 1.0, "before and after on the data fitted")
        fitted = sealed_gap(proposal.before, proposal.after, parts.fitted)
        gap = None
        shown = parts.fitted
        if parts.sealed is not None:
            progress.report(0.8, 1.0, "before and after on the sealed data")
            gap = sealed_gap(proposal.before, proposal.after, parts.sealed)
            shown = parts.sealed
        drawn = [_compared(fitted_base(design(world, shown), ())) for world in (proposal.before, proposal.after)]
    data = finite(
        {
            "effects": proposal.effects,
            "fitted_data": fitted.to_dict(),
            "sealed": None if gap is None else gap.to_dict(),
            "pictures_of": "sealed data" if gap is not None else "data fitted",
        }
    )
    return Worth(proposal.title, proposal.after, worth_text(data), data, _pictures(drawn[0], drawn[1]))


@contextmanager
def _interruptible() -> Iterator[None]:
    """The library's word for being stopped, as the jobs' own."""
    try:
        yield
    except InterruptedError as error:
        raise Cancelled from error


def _compared(trial: Trial) -> tuple[Compared, ...]:
    return compared(trial.bench.forward(trial.hypothesis), trial.bench.noise, trial.fit)


def _pictures(before: tuple[Compared, ...], after: tuple[Compared, ...] | None = None) -> dict[str, bytes]:
    return {
        "residuals.png": residual_picture(before, after),
        "paths.png": path_picture(before, after),
        "map.png": map_picture(before, after),
    }


def _last_fit(app: App, world: World) -> list[dict[str, Any]] | None:
    """Values of the fit that a world, or the nearest of its ancestors, came from; None where nothing was fitted."""
    identifier, seen = world.id, set[str]()
    while identifier not in seen:
        seen.add(identifier)
        ancestry = app.store.worlds.parents(identifier)
        if not ancestry:
            return None
        descent = ancestry[-1]
        if descent.how == "fitted" and "fit" in descent.detail:
            values: list[dict[str, Any]] = app.store.fits.get(descent.detail["fit"]).document["values"]
            return values
        identifier = descent.parent
    return None


def _unknown(
    world: World,
    paths: tuple[str, ...],
    name: str,
    lower: float | None = None,
    upper: float | None = None,
    error: float | None = None,
) -> Unknown:
    spec = specification(world, paths[0])
    value = read_parameter(world, paths[0])
    if value is None:
        raise ValueError(f"{paths[0]} is left to the touching object: give it a value before it is fitted")
    if _is_state(paths[0]):
        raise ValueError(f"{paths[0]} is an initial state: those are always fitted, each run's own")
    low = spec.search[0] if lower is None else lower
    high = spec.search[1] if upper is None else upper
    low, high = max(min(low, value), spec.lower), min(max(high, value), spec.upper)
    wide = SHARE * max(high - low, 1e-12)
    typical = min(max(ERRORS * error, 1e-3 * wide), wide) if error else wide
    return Unknown(name, paths, spec.unit, value, low, high, typical)


def _is_state(path: str) -> bool:
    parts = path.split(".")
    return parts[0] == "objects" and len(parts) == 4 and ".".join(parts[2:3]) in STATES


def _readable(world: World, path: str) -> bool:
    try:
        return read_parameter(world, path) is not None
    except KeyError:
        return False
