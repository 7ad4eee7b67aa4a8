"""Fitting a world of a case to the tracks it models: what is asked, how it runs, what is kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.calls.error_curve import SIGMA, ErrorCurve, in_words
from atw_mcp.calls.jobs import Progress
from atw_mcp.fitting.verdict import FitVerdict, judge
from polyworld.core.reported import json_ready
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.accuracy import Accuracy, Prediction
from polyworld.estimation.declared import flat
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.fitted import FittedConstant, FittedRun, Method, StudyFit
from polyworld.estimation.study import Study, StudyRun
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from polyworld.world.parameters import read_parameter, specification

FROM_PRIOR = 0.5  # part of a prior's variance that the data must take away for a value to be theirs
SURFACE = "friction of the surface"
WITHIN_80 = 1.2816  # standard deviations that hold 80% of a normal distribution
AHEAD = ("cut", "0.5_s_after", "1_s_after")  # the clip


@dataclass(frozen=True)
class Override:
    """A parameter the agent searches in its own bounds, fixes, or adds; one value for all its paths.

    fixed: leave the parameter as the world has it. prior: mean and standard deviation of the value.
    """

    paths: tuple[str, ...]
    lower: float | None = None
    upper: float | None = None
    prior: tuple[float, float] | None = None
    fixed: bool = False


@dataclass(frozen=True)
class FitRequest:
    """Everything that determines the outcome of a fit, beside the worlds and the tracks."""

    method: Method = "least_squares"
    first_frame: int | None = None
    last_frame: int | None = None
    holdout_from: int | None = None
    fit_seconds_per_frame: bool = False
    fit_initial_states: bool = True
    materials: tuple[str, ...] | None = None
    overrides: tuple[Override, ...] = ()
    generations: int = 60
    population: int = 64
    seed: int = 0


@dataclass(frozen=True)
class FitInput:
    """One case of a fit: its name, the world to start from, and the frames of the tracks that it models."""

    case: str
    world: World
    tracks: ObservedTracks


@dataclass(frozen=True)
class CaseFit:
    """Outcome of a fit for one case.

    unobserved: objects of the world without observations; unmodelled: the reverse. unseen_spins: paths of the spins of
    objects of which no frame shows that they turn.
    """

    case: str
    run: FittedRun
    before: Accuracy | None
    verdict: FitVerdict
    unobserved: tuple[str, ...]
    unmodelled: tuple[str, ...]
    unseen_spins: tuple[str, ...]


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


def window(tracks: ObservedTracks, request: FitRequest) -> ObservedTracks:
    """The frames of the tracks that the request uses; raises ValueError naming the frames there are."""
    if len(tracks.frames) == 0:
        raise ValueError("the track record has no frames")
    first, last = int(tracks.frames[0]), int(tracks.frames[-1])
    begin = first if request.first_frame is None else request.first_frame
    end = last if request.last_frame is None else request.last_frame
    if not first <= begin < end <= last:
        raise ValueError(f"frames {begin}..{end} are outside the tracks: they cover frames {first}..{last}")
    held = request.holdout_from
    if held is not None and not begin < held <= end:
        raise ValueError(f"holdout_from must lie in frames {begin + 1}..{end}, got {held}")
    return tracks.window(begin, end)


def checked(world: World, overrides: Sequence[Override]) -> None:
    """Raise KeyError for an unknown path, ValueError for bounds that do not suit it."""
    for override in overrides:
        for path in override.paths:
            allowed = specification(world, path)
            lower = allowed.lower if override.lower is None else override.lower
            upper = allowed.upper if override.upper is None else override.upper
            if not (allowed.lower <= lower and upper <= allowed.upper):
                raise ValueError(
                    f"{path}: bounds {lower:g}..{upper:g} leave what is possible, {allowed.lower:g}..{allowed.upper:g} "
                    f"{allowed.unit}"
                )
            if not lower < upper:
                raise ValueError(f"{path}: lower {lower:g} must be below upper {upper:g}")


def edited(world: World, overrides: Sequence[Override], declared: list[Unknown]) -> list[Unknown]:
    """Return the declared constants as the agent asked: parameters fixed, bounded, tied or added.

    Where a friction is given or bounded, it is that of the object itself: the surface's is then left as it is.
    """
    taken = {path for override in overrides for path in override.paths}
    if any(path.endswith(".friction") for path in taken):
        declared = [replace(u, powers=()) for u in declared if u.name != SURFACE]
    found = [u for item in declared if (u := _without(item, taken)) is not None]
    for override in overrides:
        if override.fixed:
            continue
        usual = flat(world, override.paths, "+".join(path.removeprefix("objects.") for path in override.paths))
        lower = usual.lower if override.lower is None else override.lower
        upper = usual.upper if override.upper is None else override.upper
        found.append(_searched(usual, lower, upper, override.prior))
    return found


def _searched(usual: Unknown, lower: float, upper: float, prior: tuple[float, float] | None) -> Unknown:
    if usual.scale == "log" and prior is None and lower > 0.0:
        start = min(max(usual.start, lower), upper)
        return replace(usual, lower=lower, upper=upper, start=start, typical=0.25 * math.log(upper / lower))
    start = min(max(usual.start if prior is None else prior[0], lower), upper)
    typical = 0.25 * (upper - lower) if prior is None else prior[1]
    return replace(usual, scale="linear", lower=lower, upper=upper, start=start, typical=typical, prior=prior)


def _without(unknown: Unknown, taken: set[str]) -> Unknown | None:
    """Return an unknown without some of its paths; None where none is left."""
    powers = unknown.powers or (1.0,) * len(unknown.paths)
    kept = [(path, power) for path, power in zip(unknown.paths, powers, strict=True) if path not in taken]
    if not kept:
        return None
    return replace(unknown, paths=tuple(p for p, _ in kept), powers=tuple(w for _, w in kept) if unknown.powers else ())


@dataclass(frozen=True)
class FitRun:
    """Outcome of a fit of one case, or of several that share their constants. curve: the misfit over its iterations."""

    fit: StudyFit
    cases: tuple[CaseFit, ...]
    curve: ErrorCurve
    seed: int


def run_fit(inputs: Sequence[FitInput], request: FitRequest, progress: Progress) -> FitRun:
    """Fit the constants that cases share and the initial states of each; a cancelled fit returns the best so far."""
    curve = ErrorCurve("iteration", SIGMA)

    def watch(share: float, step: str, error: float) -> None:
        curve.add(error, error)  # a descent never rises: where the error does, it is of more of the data than before
        progress.note(share, 1.0, f"{step}, misfit {in_words(error, SIGMA)}")

    first = inputs[0].world
    options = FitOptions(
        method=request.method,
        edit=lambda declared: edited(first, request.overrides, declared),
        states=request.fit_initial_states,
        time_base=request.fit_seconds_per_frame,
        materials=request.materials,
        holdout=request.holdout_from,
        generations=request.generations,
        population=request.population,
        seed=request.seed,
    )
    study = Study(tuple(StudyRun(item.case, item.world, item.tracks) for item in inputs))
    found = fit(study, options, watch=watch, cancelled=progress.cancelled)
    cases = []
    for item, run in zip(inputs, found.runs, strict=True):
        moving, seen = item.world.moving_names, item.tracks.observed_names
        cases.append(
            CaseFit(
                item.case,
                run,
                run.accuracy_start,
                judge(run, item.tracks),
                tuple(n for n in moving if n not in seen),
                tuple(n for n in seen if n not in moving),
                tuple(
                    f"objects.{name}.angular_velocity.{axis}"
                    for name in item.tracks.names
                    if not item.tracks.shows_turning(name)
                    for axis in "xyz"
                ),
            )
        )
    return FitRun(found, tuple(cases), curve, request.seed)


def digest(run: FitRun, index: int) -> dict[str, Any]:
    """Return what is kept of a case of a fit, without wall time, so that equal fits give equal records."""
    found, case = run.fit, run.cases[index]
    values = [_value(c) for c in found.constants]
    document = {
        "method": found.method,
        "status": "cancelled" if found.cancelled else "completed",
        "world": case.run.world.id,
        "start": case.run.start.id,
        "seed": run.seed,
        "loss": found.misfit,
        "fitted_frames": list(case.run.frames),
        "accuracy_start": None if case.before is None else case.before.to_dict(),
        "accuracy": None if case.run.accuracy is None else case.run.accuracy.to_dict(),
        "held_out": None if case.run.held_out is None else case.run.held_out.to_dict(),
        "prediction": None if case.run.prediction is None else _prediction(case.run.prediction),
        "values": values,
        "initial_states": len(case.run.sample) and sum(_is_state(path) for path in case.run.sample),
        "undetermined": [
            {"parameters": [v["name"]], "reason": "the data say little about it: its value is the prior's"}
            for v in values
            if v["from_prior"]
        ],
        "rolling": found.rolling,
        "slack": list(case.run.slack),
        "effective": found.effective,
        "rollouts": found.rollouts,
        "curve": run.curve.to_dict(),
        "verdict": case.verdict.to_dict(),
        "unobserved": list(case.unobserved),
        "unmodelled": list(case.unmodelled),
        "study": [c.case for c in run.cases],
    }
    ready: dict[str, Any] = json_ready(document)
    return ready


def _is_state(path: str) -> bool:
    parts = path.split(".")
    return parts[0] == "objects" and len(parts) == 4


def _prediction(found: Prediction) -> dict[str, Any]:
    return {
        "first_frame_left_out": found.frame,
        "bodies": [
            {
                "object": body.object,
                "error": body.error,
                "error_had_it_stayed": body.stays,
                "noise": body.noise,
                "half_width80": dict(zip(AHEAD, body.spread, strict=True)),
                "decided_by": [{"constant": name, "share_of_variance": part} for name, part in body.decided_by],
            }
            for body in found.bodies
        ],
        "share_inside_80%": found.inside if np.isfinite(found.inside) else None,
    }


def _value(found: FittedConstant) -> dict[str, Any]:
    u = found.unknown
    prior = None
    if u.prior is not None:
        ends = [u.prior[0] + side * WITHIN_80 * u.prior[1] for side in (-1.0, 1.0)]
        prior = [float(np.clip(math.exp(x) if u.scale == "log" else x, u.lower, u.upper)) for x in ends]
    return {
        "name": u.name,
        "value": found.value,
        "unit": u.unit,
        "bounds": [u.lower, u.upper],
        "standard_error": found.standard_error,
        "interval80": list(found.interval),
        "prior80": prior,
        "from_prior": found.informed < FROM_PRIOR,
        "at_bound": found.at_bound,
        "paths": list(u.paths),
        "powers": list(u.powers),
        "scale": u.scale,
    }


@dataclass(frozen=True)
class Sample:
    """Equally probable parameter values of a fitted world, the fitted ones first, relative to the world `start`.

    rows: names, paths and units; values (N, P). from_prior: names of rows and constants that the data do not determine.
    constants: those fitted, with unit, paths and draws, from which these values follow.
    """

    start: World
    rows: tuple[dict[str, Any], ...]
    values: NDArray[np.float64]
    from_prior: tuple[str, ...]
    constants: tuple[FittedConstant, ...]
    effective: float
    seed: int
    until: float

    def to_dict(self) -> dict[str, Any]:
        """Return all but the values, JSON-ready."""
        return {
            "constants": {
                c.unknown.name: {"unit": c.unknown.unit, "paths": list(c.unknown.paths), "value": c.value}
                for c in self.constants
            },
            "unknowns": [dict(row) for row in self.rows],
            "from_prior": list(self.from_prior),
            "seed": self.seed,
            "effective": self.effective,
            "until": self.until,
        }


def sample_of(run: FitRun, index: int) -> Sample:
    """Return the posterior sample of one case of a fit: a row for each parameter, equal ones together."""
    found = run.cases[index].run
    known = {path: read_parameter(found.start, path) for path in found.sample}
    # An effect's numbers are kept whole: where one is at its default, a world that states it is another world.
    stated = {p for p in known if _is_state(p) or p.startswith("effects.")}
    kept = {p: v for p, v in found.sample.items() if np.ptp(v) > 0.0 or p in stated or known[p] != v[0]}
    rows: dict[bytes, tuple[list[str], NDArray[np.float64]]] = {}
    for path, values in kept.items():
        rows.setdefault(b"" + values.tobytes() + path.rpartition(".")[2].encode(), ([], values))[0].append(path)
    named: list[dict[str, Any]] = [
        {
            "name": "+".join(p.removeprefix("objects.").removeprefix("effects.") for p in paths),
            "paths": paths,
            "unit": specification(found.start, paths[0]).unit,
        }
        for paths, _ in rows.values()
    ]
    open_ = [c.unknown for c in run.fit.constants if c.informed < FROM_PRIOR]
    unshown = {p for u in open_ for p in u.paths} | set(run.cases[index].unseen_spins)
    step = found.start.time.seconds_per_frame
    columns = [v for _, v in rows.values()]
    return Sample(
        start=found.start,
        rows=tuple(named),
        values=np.stack(columns, axis=1) if columns else np.zeros((1, 0)),
        from_prior=(
            *(u.name for u in open_),
            *(str(row["name"]) for row in named if set(row["paths"]) <= unshown),
        ),
        constants=run.fit.constants,
        effective=run.fit.effective,
        seed=run.seed,
        until=found.frames[1] * step,
    )
