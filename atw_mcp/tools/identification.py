"""World construction, fourth part: a world is fitted to what was observed."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer, explained, plain
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.fitting.fitting import (
    EACH,
    FitRequest,
    FitRun,
    Override,
    chosen_parameters,
    digest,
    observed_of,
    run_fit,
    window,
)
from atw_mcp.fitting.reading import CONTACTS, doubts, lower_draft, next_step, open_questions, verdict_in_words
from atw_mcp.observation.observing import modelled_tracks
from atw_mcp.probing.ensembles import keep_sample, sample_in_words, stored_sample
from atw_mcp.results.identification import FittedWorld
from atw_mcp.tools.world_arguments import CaseId, ParameterArgument, Patience
from evidence_store import Case
from polyworld.data.tracks import ObservedTracks
from polyworld.world import World
from polyworld.world.parameter_tables import STATE_PARAMETERS

GROUP = ToolGroup("world construction")
PARAMETERS_EXAMPLE = [{"paths": ["objects.red.friction"], "lower": 0, "upper": 1}]
RESTARTS = {"prefixes": 3, "cem": 1, "random_search": 1, "refine": 1}
STATES = {path.rpartition(".")[0] for path in STATE_PARAMETERS}


@GROUP.tool("FitWorld", title="Fit a world to the observation", read_only=False, returns=FittedWorld)
def fit_world(
    app: App,
    case: CaseId,
    world: Annotated[str | None, Field(description="world id to start from; default: the latest draft")] = None,
    method: Annotated[
        Literal["prefixes", "cem_refined", "cem", "random_search", "refine"] | None,
        Field(
            description="default: prefixes for spatial rigid worlds, else cem_refined. prefixes: least "
            "squares over growing stretches, laws of resistance chosen by evidence; default for spatial worlds of "
            "rigid bodies. cem_refined: short global searches (cross-entropy, cem) from several seeds, each refined, "
            "the best kept; default elsewhere. refine: least squares from where the world is; random_search: for "
            "comparison"
        ),
    ] = None,
    fit_seconds_per_frame: Annotated[bool, Field(description="also fit the physical time between frames")] = False,
    fit_initial_states: Annotated[bool, Field(description="also fit positions and velocities at the start")] = True,
    each: Annotated[
        list[str] | None,
        Field(
            max_length=8,
            description="parameters of each object; default friction, restitution, mass, less those shared. "
            "There are mass, friction, restitution, rolling_resistance, torsional_radius, linear_damping, "
            "angular_damping; with method prefixes also rolling_resistance of what can roll",
        ),
    ] = None,
    shared: Annotated[
        list[str] | None,
        Field(
            max_length=8,
            description="parameters common to all objects; default the dampings. These are linear_damping and "
            "angular_damping; with method prefixes linear_damping and others where the evidence asks for them",
        ),
    ] = None,
    materials: Annotated[
        list[str] | None,
        Field(
            max_length=16,
            description="parameters of deformable objects, e.g. youngs_modulus; default by material, with friction of "
            "pulleys and rates of emitters",
        ),
    ] = None,
    parameters: Annotated[
        list[ParameterArgument] | None,
        Field(max_length=64, description="single parameters to add, tie, bound or fix", examples=[PARAMETERS_EXAMPLE]),
    ] = None,
    first_frame: Annotated[int | None, Field(ge=0, description="default: the first tracked")] = None,
    last_frame: Annotated[int | None, Field(ge=0, description="default: the last tracked")] = None,
    holdout_from: Annotated[
        int | None,
        Field(ge=1, description="first frame held out to judge the fit"),
    ] = None,
    generations: Annotated[
        int | None,
        Field(
            ge=1,
            le=2000,
            description="default 60; 20 for cem_refined, 12 with deformable objects",
        ),
    ] = None,
    population: Annotated[
        int | None, Field(ge=8, le=4096, description="candidates a generation; default 64; with deformable objects 24")
    ] = None,
    restarts: Annotated[
        int | None,
        Field(
            ge=1,
            le=50,
            description="independent searches; default 1, for cem_refined 5. With deformable "
            "objects 2, each refined; for prefixes 3 at most",
        ),
    ] = None,
    position_tolerance: Annotated[float, Field(ge=0, le=1e3, description="misfit that is not fitted [m]")] = 0.0,
    seed: Annotated[int, Field(ge=0, le=2**31 - 1, description="random seed")] = 0,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Search a world's unknown parameters until its simulated motion matches the observed motion. Returns a new world,
    its errors on the frames (position_rmse [m], rotation_rmse [rad], shape_rmse), warnings where the minimum is
    doubtful, every fitted value with its uncertainty, and what the data cannot determine. It also keeps a sample of
    the parameter values and initial states that the data allow, which Rollout, QueryWorld and CompareWorlds ask
    with ensemble=N. The same request is never computed twice. Next: InspectRollout to see it over the frames,
    CommitWorld when it follows the video; else FitWorld again with another seed, more restarts or other parameters."""
    found = app.case_to_model(case, "FitWorld")
    start = app.world(found, world)
    with explained(f"BuildWorld(case={found.id!r})"):
        record = modelled_tracks(app, found, start)
    rigid = not start.planar and not start.coupled and bool(start.objects)
    method = method or ("prefixes" if rigid else "cem_refined")
    request = FitRequest(
        method=method,
        first_frame=_first_frame(start, record.tracks) if first_frame is None else first_frame,
        last_frame=last_frame,
        holdout_from=holdout_from,
        fit_seconds_per_frame=fit_seconds_per_frame,
        fit_initial_states=fit_initial_states,
        overrides=tuple(_override(item) for item in parameters or []),
        generations=generations or (60 if method != "cem_refined" else 12 if start.coupled else 20),
        population=population or (24 if start.coupled else 64),
        restarts=restarts or RESTARTS.get(method, 2 if start.coupled else 5),
        position_tolerance=position_tolerance,
        seed=seed,
        each=tuple(name for name in EACH if name not in (shared or ())) if each is None else tuple(each),
        **({} if shared is None else {"shared": tuple(shared)}),
        **({} if materials is None else {"materials": tuple(materials)}),
    )
    with explained():
        observed = observed_of(start, record.tracks)
        names = list(observed.observed_names)
        tracks = window(observed, request)
        if holdout_from is not None and not tracks.frames[0] < holdout_from <= tracks.frames[-1]:
            raise ValueError(
                f"holdout_from must lie in frames {tracks.frames[0] + 1}..{tracks.frames[-1]}, got {holdout_from}"
            )
        unknowns = chosen_parameters(start, tracks, request)
    inputs = {
        "world": start.id,
        "observation": record.id,
        "request": plain({**vars(request), "overrides": [vars(item) for item in request.overrides]}),
        "parameters": plain([vars(item) for item in unknowns]),
    }
    kept = app.store.fits.find("fit", inputs)
    if kept is not None:
        fitted = World.model_validate_json(app.store.worlds.document(kept.document["world"]))
        _add_to_case(
            app, found, start, fitted, inputs, record.id, kept.document["verdict"]
        )  # it may have been fitted for another case
        return _fit_answer(app, found, start, fitted, kept.document, tracks, record.id, again=True)

    def work(progress: Progress) -> Answer:
        with explained():
            run = run_fit(start, tracks, unknowns, request, progress)
        return _keep_fit(app, found, start, run, inputs, tracks, record.id)

    return LongWork(
        key=app.store.fits.key("fit", inputs) + found.id,
        work=work,
        draft=Answer(
            summary=f"fitting {len(unknowns)} parameters of {start.id} by {method}",
            data={},
            case=found.id,
            world=start.id,
            observation=record.id,
            objects=tuple(names),
        ),
        patience=patience_seconds,
    )


def _keep_fit(
    app: App,
    case: Case,
    start: World,
    run: FitRun,
    inputs: dict[str, Any],
    tracks: ObservedTracks,
    observation: str,
) -> Answer:
    result = run.result
    document = plain(digest(run)) | {"position_tolerance": inputs["request"]["position_tolerance"]}
    with app.store.transaction():
        if run.start is not None and run.start.id != start.id:  # it has a law of resistance that the fit found
            # Before the fitted world, which is to be the latest draft.
            app.keep_world(case, run.start, how="given", parent=start, detail={"fit": "resistance"})
        _add_to_case(app, case, start, result.world, inputs, observation, document["verdict"])
        if run.sample is not None:
            assert run.start is not None
            keep_sample(app, result.world, run.start, run.sample)
        if result.status == "completed":  # a cancelled fit depends on when it was cancelled: do not reuse it
            app.store.fits.put("fit", inputs, document)
    return _fit_answer(app, case, start, result.world, document, tracks, observation, again=False)


def _add_to_case(
    app: App,
    case: Case,
    start: World,
    fitted: World,
    inputs: dict[str, Any],
    observation: str,
    verdict: dict[str, Any] | None,
) -> None:
    app.keep_world(
        case,
        fitted,
        how="fitted",
        parent=start,
        detail={"fit": app.store.fits.key("fit", inputs), "verdict": verdict, **inputs["request"]},
        observation=observation,
    )


def _fit_answer(
    app: App,
    case: Case,
    start: World,
    fitted: World,
    document: dict[str, Any],
    tracks: ObservedTracks,
    observation: str,
    *,
    again: bool,
) -> Answer:
    def rmse(key: str) -> float | None:
        value: float | None = document[key]["position_rmse"] if document[key] else None
        return value

    before, after, held = rmse("accuracy_start"), rmse("accuracy"), rmse("held_out")
    said = "diverged" if document["accuracy"] is None else "" if after is None else f"position_rmse {after:.4g} m"
    shape = document["accuracy"].get("shape_rms_in_sigma") if document["accuracy"] else None
    said += "" if shape is None else f"{', ' if said else ''}shapes off by {shape:.3g} standard deviations (rms)"
    turn = document["accuracy"]["rotation_rmse"] if document["accuracy"] else None
    said += "" if turn is None else f", rotation_rmse {turn:.3g} rad"
    was = "which diverges" if document["accuracy_start"] is None else _short(document["accuracy_start"])
    verdict = document["verdict"]
    doubtful = doubts(fitted, document)
    rows, count = open_questions(document)
    fits = [item.id for item in app.store.evidence.of_case(case.id, tool="FitWorld") if item.status == "completed"]
    better = lower_draft([app.store.evidence.get(item) for item in fits], document, observation)
    if better is not None:
        doubtful.append(f"draft {better['world']} has a lower loss on the same frames, {better['loss']:.3g}")
    kept = "" if document["held_out"] is None else f", {_short(document['held_out'])} on the frames held out"
    cancelled = "cancelled; best so far: " if document["status"] == "cancelled" else ""
    whole = "ReadEvidence(evidence=this result's evidence id"
    sample = stored_sample(app, fitted.id)
    shown = {
        "world": fitted.id,
        "from_world": start.id,
        "verdict": verdict["verdict"],
        "why": verdict["why"],
        "warnings": doubtful,
        "best_draft": better,
        "loss": document["loss"],
        "starts": document["starts"],
        "position_rmse": after,
        "position_rmse_of_starting_world": before,
        "position_rmse_held_out": held,
        "rotation_rmse": turn,
        **(
            {"shape_rmse": document["accuracy"]["shape_rmse"], "shape_rms_in_sigma": shape} if shape is not None else {}
        ),
        "position_rmse_by_object": document["accuracy"]["position_rmse_by_object"] if document["accuracy"] else None,
        "frames": document["fitted_frames"],
        "values": [
            {key: value[key] for key in ("name", "value", "unit", "standard_error", "spread", "at_bound")}
            for value in document["values"]
            if not _is_state(value)
        ],
        "initial_states": f"{sum(map(_is_state, document['values']))} values fitted: {whole}, path='values')",
        "contacts": CONTACTS,
        "resistance": document["resistance"],
        "undetermined": rows,
        "undetermined_whole": None if count <= len(rows) else f"{count} rows: {whole}, path='undetermined')",
        "ensemble": None if sample is None else sample_in_words(sample),
        "unobserved": document["unobserved"],
        "not_in_world": document["unmodelled"],
        "rollouts": document["rollouts"],
        "computed_now": not again,
        "next": next_step(case.id, fitted.id, document),
    }
    step = fitted.time.seconds_per_frame
    frames = document["fitted_frames"]
    return Answer(
        summary=f"{cancelled}{verdict_in_words(document)} world {fitted.id}: {said}, loss {document['loss']:.3g}"
        f"{kept} (the starting world {start.id}, before any search: {was})"
        + "".join(f". WARNING: {text}" for text in doubtful),
        data={
            **{key: value for key, value in shown.items() if key not in ("initial_states", "undetermined_whole")},
            **document,  # whole lists
            "verdict": verdict["verdict"],
            "bodies": verdict["bodies"],
        },
        shown=shown,
        case=case.id,
        world=fitted.id,
        observation=observation,
        objects=tracks.observed_names,
        interval=(frames[0] * step, frames[1] * step),
        status="cancelled" if document["status"] == "cancelled" else "completed",
    )


def _short(accuracy: dict[str, Any]) -> str:
    """An accuracy in a few words: the error of positions, else that of shapes."""
    if accuracy["position_rmse"] is not None:
        return f"{accuracy['position_rmse']:.4g} m"
    shape = accuracy.get("shape_rms_in_sigma")
    return "nothing observed" if shape is None else f"{shape:.3g} standard deviations"


def _first_frame(world: World, tracks: ObservedTracks) -> int | None:
    """The first frame at which an object of the world joins, where the tracks begin before; else None: their own."""
    step = world.time.seconds_per_frame
    starts = [round(item.start_time / step) for item in world.objects if item.name in tracks.names]
    first = min(starts, default=0)
    return first if len(tracks.frames) and int(tracks.frames[0]) < first < int(tracks.frames[-1]) else None


def _is_state(value: dict[str, Any]) -> bool:
    return any(path.rpartition(".")[0].partition(".")[2].partition(".")[2] in STATES for path in value["paths"])


def _override(item: ParameterArgument) -> Override:
    if (item.prior_mean is None) != (item.prior_sd is None):
        raise ToolError(f"{item.paths}: a prior needs both prior_mean and prior_sd")
    prior = None if item.prior_mean is None or item.prior_sd is None else (item.prior_mean, item.prior_sd)
    return Override(tuple(item.paths), item.lower, item.upper, prior, item.fixed)
