"""Fitting a world of a case to the tracks it models: what is asked, how it runs, what is kept."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from atw_mcp.calls.error_curve import ErrorCurve
from atw_mcp.calls.jobs import Progress
from atw_mcp.fitting.progress import SEARCHED, FitProgress
from atw_mcp.fitting.verdict import FitVerdict, judge
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    CemSettings,
    FitProblem,
    FitResult,
    ObjectiveSettings,
    OrdinarySettings,
    Outlying,
    PosteriorSample,
    PrefixSettings,
    SearchSettings,
    Shown,
    Start,
    Tested,
    Unknown,
    alternative_minima,
    choose_resistance,
    default_unknowns,
    fit_by_prefixes,
    fit_by_random_search,
    in_order,
    laws_of_resistance,
    multistart,
    outlying_frames,
    plausible_unknowns,
    refine,
    refit_with_wider_bounds,
    release_shared,
    restarts,
    sample_posterior,
    support_constraints,
)
from polyworld.world import World
from polyworld.world.parameters import read_parameter, specification

Method = Literal["prefixes", "cem_refined", "cem", "random_search", "refine"]


STAGES = {
    "released": (SEARCHED, 0.68),
    "completed": (0.68, 0.75),
    "alternatives": (0.75, 0.85),
    "posterior": (0.85, 1.0),
}
"""Shares of the whole between which the stages after a search lie, measured as `SEARCHED` is."""
SHARED = ("linear_damping", "angular_damping")
EACH = ("friction", "restitution", "mass")


@dataclass(frozen=True)
class Override:
    """A parameter the agent searches in its own bounds, fixes, or adds; one value for all its paths.

    fixed: leave the parameter as the world has it.
    """

    paths: tuple[str, ...]
    lower: float | None = None
    upper: float | None = None
    prior: tuple[float, float] | None = None
    fixed: bool = False


@dataclass(frozen=True)
class FitRequest:
    """Everything that determines the outcome of a fit, beside the world and the tracks.

    shared: None chooses laws of resistance by evidence where the method is `prefixes`, else dampings are fitted.
    """

    method: Method = "cem_refined"
    first_frame: int | None = None
    last_frame: int | None = None
    holdout_from: int | None = None
    fit_seconds_per_frame: bool = False
    fit_initial_states: bool = True
    shared: tuple[str, ...] | None = None
    each: tuple[str, ...] = EACH
    materials: tuple[str, ...] | None = None
    overrides: tuple[Override, ...] = ()
    generations: int = 60
    population: int = 64
    restarts: int = 1
    position_tolerance: float = 0.0
    seed: int = 0


def observed_of(world: World, tracks: ObservedTracks) -> ObservedTracks:
    """Select what a record shows of the world's objects: tracks of all, shapes of those that are deformable in it.

    Raises ValueError where it shows none.
    """
    soft = {item.name for item in world.deformables}
    names = [
        name for name in world.moving_names if name in tracks.names or (name in soft and name in tracks.observed_names)
    ]
    if not names:
        raise ValueError(
            f"nothing observed belongs to an object of the world; observed {list(tracks.observed_names)}, objects "
            f"{list(world.moving_names)}"
        )
    chosen = tracks.select(names)
    return replace(chosen, shapes=tuple(item for item in chosen.shapes if item.object in soft))


def chosen_parameters(
    world: World, tracks: ObservedTracks, request: FitRequest, ordinary: OrdinarySettings | None = None
) -> list[Unknown]:
    """Choose the unknowns of a fit: those the tracks can show, changed as the agent asked.

    ordinary: priors of a spatial world fitted by `prefixes`, and from how many on bodies alike share parameters.
    Raises KeyError for an unknown path, ValueError for bounds that do not suit it or when nothing is left.
    """
    # Held-out frames must not inform the search's start.
    seen = tracks if request.holdout_from is None else tracks.window(int(tracks.frames[0]), request.holdout_from - 1)
    by_evidence = request.method == "prefixes" and request.shared is None
    parameters = default_unknowns(
        world,
        seen,
        shared=() if by_evidence else SHARED if request.shared is None else request.shared,
        each=request.each,
        initial_conditions=request.fit_initial_states,
        time_base=request.fit_seconds_per_frame,
        materials=request.materials,
    )
    if request.method == "prefixes" and request.fit_initial_states:
        parameters = plausible_unknowns(world, seen, parameters, ordinary)
    for override in request.overrides:
        for path in override.paths:
            specification(world, path)
        taken = set(override.paths)
        before = next((p for p in parameters if taken & set(p.paths)), None)
        # A tied parameter of which only some objects are taken out keeps the others.
        parameters = [p for item in parameters if (p := _without(item, taken)) is not None]
        if not override.fixed:
            parameters.append(_searched(world, override, before))
    if not parameters:
        raise ValueError("nothing to fit: no parameter shows in these tracks, or every one of them was fixed")
    return parameters


def window(tracks: ObservedTracks, request: FitRequest) -> ObservedTracks:
    """The frames of the tracks that the request uses; raises ValueError naming the frames there are."""
    if len(tracks.frames) == 0:
        raise ValueError("the track record has no frames")
    first, last = int(tracks.frames[0]), int(tracks.frames[-1])
    begin = first if request.first_frame is None else request.first_frame
    end = last if request.last_frame is None else request.last_frame
    if not first <= begin < end <= last:
        raise ValueError(f"frames {begin}..{end} are outside the tracks: they cover frames {first}..{last}")
    return tracks.window(begin, end)


@dataclass(frozen=True)
class FitRun:
    """Outcome of a fit: its result, all its starts (none for a method without them), and the seed that was asked for.

    start: the world that the values refer to, which may have got a law of resistance. sample: of the posterior; None
    where the fit was cancelled or diverges. tested: laws of resistance beside friction and rolling. widened: bounds
    that the fit widened by itself, by name. curve: the error over the steps of all stages.
    """

    result: FitResult
    starts: tuple[Start, ...] = ()
    seed: int = 0
    sample: PosteriorSample | None = None
    start: World | None = None
    tested: tuple[Tested, ...] = ()
    widened: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    outlying: tuple[Outlying, ...] = ()
    verdict: FitVerdict | None = None
    curve: ErrorCurve | None = None


def run_fit(
    world: World, tracks: ObservedTracks, parameters: list[Unknown], request: FitRequest, progress: Progress
) -> FitRun:
    """Search, choose resistance by evidence, widen bounds that exclude the minimum, then sample the posterior.

    `prefixes`: least squares over growing stretches. `cem_refined`: the cross-entropy method from several seeds, least
    squares from each outcome. A cancelled search returns the best found so far, with status `cancelled`.
    """
    objective = ObjectiveSettings(position_tolerance=request.position_tolerance)
    if request.method == "refine":
        parameters = _at_present_values(world, parameters)
    fitted = {path for u in parameters for path in u.paths}
    constraints = support_constraints(world, tracks, fitted) if request.method == "prefixes" else []
    problem = FitProblem(
        world,
        tracks,
        parameters,
        objective=objective,
        holdout_from=request.holdout_from,
        constraints=constraints,
    )
    watched = FitProgress(progress, problem, request.method)
    run = replace(_run_search(problem, request, progress, watched), start=world, curve=watched.curve)
    if run.result.status == "cancelled":
        return _judged(problem, run)
    if request.method == "prefixes":
        watched.stage("comparing shared with separate contact parameters", *STAGES["released"])
        problem, run = _released(problem, run, request, progress)
        watched.stage("choosing laws of resistance by evidence", *STAGES["completed"])
        problem, run = _completed(problem, run, request, progress)
        if run.result.status == "cancelled":
            return _judged(problem, run)
        watched.stage("searching for other minima", *STAGES["alternatives"])
        run = _with_alternatives(problem, run, request, progress)
    watched.stage("sampling the posterior", *STAGES["posterior"])
    fixed = {path for override in request.overrides if override.fixed for path in override.paths}
    names = run.result.by_name.keys()
    outcomes = [run.result, *(s.best for s in run.starts[1:] if s.best.by_name.keys() == names)]
    sample = sample_posterior(problem, outcomes, known=fixed, seed=request.seed)
    return _judged(problem, replace(run, sample=sample, outlying=outlying_frames(problem, run.result)))


def _with_alternatives(problem: FitProblem, run: FitRun, request: FitRequest, progress: Progress) -> FitRun:
    """Other minima that a first start which reached the noise leaves unknown, as further starts; the best first."""
    if len(run.starts) > 1:
        return run
    others = alternative_minima(problem, run.result, seed=request.seed, cancelled=progress.cancelled)
    starts = in_order([run.starts[0], *(Start(other) for other in others)])
    return replace(run, result=starts[0].best, starts=starts)


def _judged(problem: FitProblem, run: FitRun) -> FitRun:
    shown = Shown(problem.world, problem.window)
    return replace(run, verdict=judge(run.result, problem.window, frozenset(shown.begins)))


def _released(problem: FitProblem, run: FitRun, request: FitRequest, progress: Progress) -> tuple[FitProblem, FitRun]:
    """Contact parameters of bodies alike, and their masses, each for itself where the evidence asks for that."""
    best, rest = run.starts[0], run.starts[1:]
    apart = OrdinarySettings(alike=len(problem.world.objects) + 1)
    own = chosen_parameters(problem.world, problem.window, request, apart)
    problem, best = release_shared(problem, best, own, cancelled=progress.cancelled)
    return problem, replace(run, result=best.best, starts=(best, *rest))


def _completed(problem: FitProblem, run: FitRun, request: FitRequest, progress: Progress) -> tuple[FitProblem, FitRun]:
    """Laws of resistance that the evidence asks for, and bounds that the minimum wants to leave."""
    best, rest = run.starts[0], run.starts[1:]
    tested: tuple[Tested, ...] = ()
    if request.shared is None:
        taken = {path for u in problem.space.unknowns for path in u.paths}
        taken |= {path for override in request.overrides for path in override.paths}
        laws = laws_of_resistance(problem.world, problem.window, taken)
        problem, best, tested = choose_resistance(problem, best, laws, cancelled=progress.cancelled)
    given = {path for override in request.overrides for path in override.paths}
    problem, best, widened = refit_with_wider_bounds(problem, best, keep=given, cancelled=progress.cancelled)
    found = replace(run, result=best.best, starts=(best, *rest), start=problem.world, tested=tested, widened=widened)
    return problem, found


def _run_search(problem: FitProblem, request: FitRequest, progress: Progress, watched: FitProgress) -> FitRun:
    if request.method == "refine":
        watched.stage("refining", 0.0, SEARCHED)
        return FitRun(refine(problem, cancelled=progress.cancelled))

    if request.method == "prefixes":
        settings = PrefixSettings(request.restarts, request.seed)
        starts = fit_by_prefixes(problem, settings, progress=watched.start, cancelled=progress.cancelled)
        return FitRun(starts[0].best, starts, request.seed)
    elites = max(2, request.population // 4)
    search = SearchSettings(
        generations=request.generations,
        cem=CemSettings(population=request.population, elites=elites, carried=min(4, elites)),
        seed=request.seed,
    )
    if request.method == "random_search":
        search = replace(search, generations=request.generations * request.restarts)
        found = fit_by_random_search(problem, search, progress=watched.generation, cancelled=progress.cancelled)
        return FitRun(found, seed=request.seed)
    # Neighbouring seeds must not repeat each other's searches.
    search = replace(search, seed=request.seed * request.restarts)
    if request.method == "cem_refined":
        starts = multistart(
            problem, search, request.restarts, progress=watched.generation, cancelled=progress.cancelled
        )
    else:
        searches = restarts(
            problem, search, request.restarts, progress=watched.generation, cancelled=progress.cancelled
        )
        starts = in_order(Start(found) for found in searches)
    stopped = any(result.status == "cancelled" for start in starts for result in start.results)
    return FitRun(replace(starts[0].best, status="cancelled" if stopped else "completed"), starts, request.seed)


def digest(run: FitRun) -> dict[str, Any]:
    """A fit's outcome without wall time, so that equal fits give equal records.

    rollouts are of all stages; history and the spread of a value are those of the search.
    """
    document = run.result.to_dict() | {"seed": run.seed}
    document.pop("seconds")
    if run.starts:
        document["rollouts"] = sum(result.rollouts for start in run.starts for result in start.results)
        spread = {value.name: value.spread for value in run.starts[0].searched.values}
        for value in document["values"]:
            value["spread"] = spread.get(value["name"])
        searches = sorted((start.searched for start in run.starts), key=lambda result: result.seed)
        document["history"] = [vars(point).copy() for result in searches for point in result.history]
    document["starts"] = [
        {
            "seed": start.searched.seed,
            "loss_searched": start.searched.loss,
            "loss": start.best.loss,
            "position_rmse": None if start.best.accuracy is None else _finite(start.best.accuracy.position),
            "rotation_rmse": None if start.best.accuracy is None else _finite(start.best.accuracy.rotation),
        }
        for start in run.starts
    ]
    document["curve"] = None if run.curve is None else run.curve.to_dict()
    document["verdict"] = None if run.verdict is None else run.verdict.to_dict()
    document["resistance"] = [vars(tested) for tested in run.tested]
    document["widened"] = {name: list(bounds) for name, bounds in run.widened.items()}
    document["outlying"] = [{**vars(found), "frames": list(found.frames)} for found in run.outlying]
    return document


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _without(parameter: Unknown, taken: set[str]) -> Unknown | None:
    paths = tuple(path for path in parameter.paths if path not in taken)
    if not paths:
        return None
    return replace(parameter, paths=paths)


def _searched(world: World, override: Override, before: Unknown | None) -> Unknown:
    spec = specification(world, override.paths[0])
    lower = override.lower if override.lower is not None else (before.lower if before else spec.search[0])
    upper = override.upper if override.upper is not None else (before.upper if before else spec.search[1])
    for path in override.paths:
        allowed = specification(world, path)
        if not (allowed.lower <= lower and upper <= allowed.upper):
            raise ValueError(
                f"{path}: bounds {lower:g}..{upper:g} leave what is possible, {allowed.lower:g}..{allowed.upper:g} "
                f"{allowed.unit}"
            )
    if not lower < upper:
        raise ValueError(f"{override.paths[0]}: lower {lower:g} must be below upper {upper:g}")
    value = read_parameter(world, override.paths[0])
    # A stiffness or a viscosity may be any of several powers of ten; what rigid objects have is searched as it is.
    wide = lower > 0.0 and upper / lower > 10.0 and not _is_rigid(world, override.paths[0])
    centre = math.sqrt(lower * upper) if wide else 0.5 * (lower + upper)
    return Unknown(
        name=before.name if before is not None and before.paths == override.paths else "+".join(override.paths),
        paths=override.paths,
        unit=spec.unit,
        lower=lower,
        upper=upper,
        start=centre if value is None else min(max(value, lower), upper),
        typical=0.25 * (math.log(upper / lower) if wide else upper - lower),
        prior=override.prior,
        scale="log" if wide else "linear",
        enters=before.enters if before is not None else 0.0,
    )


def _is_rigid(world: World, path: str) -> bool:
    parts = path.split(".")
    soft = {item.name for item in world.deformables}
    return parts[0] not in ("pulleys", "emitters") and not (parts[0] == "objects" and parts[1] in soft)


def _at_present_values(world: World, parameters: list[Unknown]) -> list[Unknown]:
    """The parameters with the world's own values as starts: refining begins where the world is."""
    moved = []
    for parameter in parameters:
        value = read_parameter(world, parameter.paths[0])
        start = parameter.start if value is None else value
        lower, upper = min(parameter.lower, start), max(parameter.upper, start)
        moved.append(replace(parameter, start=start, lower=lower, upper=upper))
    return moved
