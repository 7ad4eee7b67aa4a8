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
    FitInput,
    FitRequest,
    FitRun,
    Override,
    checked,
    digest,
    observed_of,
    run_fit,
    sample_of,
    window,
)
from atw_mcp.fitting.reading import (
    CONTACTS,
    ROLLING,
    better_draft,
    doubts,
    draft_in_words,
    next_step,
    notes,
    open_questions,
    prediction_in_words,
    sharing,
    verdict_in_words,
)
from atw_mcp.observation.observing import modelled_tracks
from atw_mcp.probing.ensembles import keep_sample, sample_in_words, stored_sample
from atw_mcp.results.identification import FittedWorld
from atw_mcp.tools.world_arguments import CaseId, ParameterArgument, Patience
from atw_mcp.worlds.last_fit import last_fit
from evidence_store import Case
from polyworld.data.tracks import ObservedTracks
from polyworld.world import World

GROUP = ToolGroup("world construction")
GIVEN = ("friction", "restitution", "rolling_resistance", "linear_damping")
PARAMETERS_EXAMPLE = [{"paths": ["objects.red.friction"], "lower": 0, "upper": 1}]


@GROUP.tool("FitWorld", title="Fit a world to the observation", read_only=False, returns=FittedWorld)
def fit_world(
    app: App,
    case: CaseId,
    world: Annotated[str | None, Field(description="world id to start from; default: the latest draft")] = None,
    cases: Annotated[
        list[str] | None,
        Field(
            max_length=32,
            description="further cases that share constants with this one, by material: clips of one laboratory. Each "
            "gets a fitted world of its own from its latest draft",
        ),
    ] = None,
    method: Annotated[
        Literal["least_squares", "cem", "random_search"],
        Field(
            description="least_squares: from local polynomials, collisions as soft links. cem (cross-entropy) and "
            "random_search: for comparison"
        ),
    ] = "least_squares",
    fit_seconds_per_frame: Annotated[bool, Field(description="also fit the physical time between frames")] = False,
    fit_initial_states: Annotated[bool, Field(description="also fit positions and velocities at the start")] = True,
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
        Field(
            ge=1,
            description="first frame that the fit never sees; default: the last fifth is left out, predicted, then "
            "fitted too",
        ),
    ] = None,
    generations: Annotated[int | None, Field(ge=1, le=2000, description="of a search; default 60")] = None,
    population: Annotated[int | None, Field(ge=8, le=4096, description="candidates a generation; default 64")] = None,
    seed: Annotated[int, Field(ge=0, le=2**31 - 1, description="random seed")] = 0,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Fit constants and initial states so that simulated motion matches the observed motion, and say how well frames
    that were left out are predicted. Constants (friction, restitution, dampings) are tied by material where BuildWorld
    states one, else by object; masses given are kept. Returns a new world, the error on frames left out (prediction),
    intervals 0.5 and 1 s ahead with what decides them, every value with its 80% interval and prior, and what the data
    leave open. A sample of what the data allow is kept for Ask, and ensemble=N of Rollout and CompareWorlds. The
    same request is never computed twice. Next: InspectRollout to see it over the frames, CommitWorld when it follows
    the video."""
    found = app.case(case)
    start = app.draft(found, world)
    request = FitRequest(
        method=method,
        first_frame=first_frame,
        last_frame=last_frame,
        holdout_from=holdout_from,
        fit_seconds_per_frame=fit_seconds_per_frame,
        fit_initial_states=fit_initial_states,
        materials=None if materials is None else tuple(materials),
        overrides=(*_given(app, start, parameters or []), *(_override(item) for item in parameters or [])),
        generations=generations or 60,
        population=population or 64,
        seed=seed,
    )
    members = [(found, start), *_further(app, found, cases or [])]
    inputs_of, observations = [], []
    for own, draft in members:
        with explained(f"BuildWorld(case={own.id!r})"):
            record = modelled_tracks(app, own, draft)
        with explained():
            frames = request if own.id == found.id else FitRequest(holdout_from=None)
            first = _first_frame(draft, record.tracks) if frames.first_frame is None else frames.first_frame
            tracks = window(observed_of(draft, record.tracks), _starting(frames, first))
        inputs_of.append(FitInput(own.id, draft, tracks))
        observations.append(record.id)
    with explained():
        checked(start, request.overrides)
    key = {
        "worlds": [draft.id for _, draft in members],
        "observations": observations,
        "request": plain({**vars(request), "overrides": [vars(item) for item in request.overrides]}),
    }
    kept = app.store.fits.find("fit", {**key, "case": 0})
    if kept is not None:
        fitted = World.model_validate_json(app.store.worlds.document(kept.document["world"]))
        # It may have been fitted for another case.
        _keep_start(app, found, start, World.model_validate_json(app.store.worlds.document(kept.document["start"])))
        _add_to_case(app, found, start, fitted, {**key, "case": 0}, observations[0], kept.document["verdict"])
        return _fit_answer(app, found, start, fitted, kept.document, inputs_of[0].tracks, observations[0], again=True)

    def work(progress: Progress) -> Answer:
        with explained():
            run = run_fit(inputs_of, request, progress)
        for index in range(len(members) - 1, -1, -1):
            answer = _keep_fit(app, members[index], run, index, key, inputs_of[index].tracks, observations[index])
        return answer

    return LongWork(
        key=app.store.fits.key("fit", key) + found.id,
        work=work,
        draft=Answer(
            summary=f"fitting {start.id}" + (f" with {', '.join(cases)}" if cases else ""),
            data={},
            case=found.id,
            world=start.id,
            observation=observations[0],
            objects=inputs_of[0].tracks.observed_names,
        ),
        patience=patience_seconds,
    )


def _further(app: App, found: Case, cases: list[str]) -> list[tuple[Case, World]]:
    """Return further cases with their latest worlds; raises ToolError for one that has none or is the case itself."""
    members = []
    for name in dict.fromkeys(cases):
        own = app.case(name)
        if own.id == found.id:
            raise ToolError(f"cases lists {name!r}, which is the case itself: list the others only")
        members.append((own, app.draft(own)))
    return members


def _starting(request: FitRequest, first: int | None) -> FitRequest:
    return FitRequest(**{**vars(request), "first_frame": first})


def _keep_fit(
    app: App,
    member: tuple[Case, World],
    run: FitRun,
    index: int,
    key: dict[str, Any],
    tracks: ObservedTracks,
    observation: str,
) -> Answer:
    case, start = member
    inputs = {**key, "case": index}
    fitted = run.cases[index].run
    document = plain(digest(run, index))
    with app.store.transaction():
        _keep_start(app, case, start, fitted.start)
        _add_to_case(app, case, start, fitted.world, inputs, observation, document["verdict"])
        if document["status"] == "completed":  # a cancelled fit depends on when it was cancelled: do not reuse it
            app.store.fits.put("fit", inputs, document)
            if fitted.accuracy is not None:
                keep_sample(app, fitted.world, sample_of(run, index))
    return _fit_answer(app, case, start, fitted.world, document, tracks, observation, again=False)


def _keep_start(app: App, case: Case, start: World, guessed: World) -> None:
    """Keep the world that a sample refers to, in which initial states are first guesses and a law of resistance acts;
    before the fitted one, which is to be the latest draft."""
    if guessed.id != start.id:
        app.keep_world(case, guessed, how="given", parent=start, detail={"fit": "start"})


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
    accuracy, before, held = document["accuracy"], document["accuracy_start"], document["held_out"]
    verdict = document["verdict"]
    doubtful = doubts(fitted, document)
    rows, count = open_questions(document)
    fits = [item.id for item in app.store.evidence.of_case(case.id, tool="FitWorld") if item.status == "completed"]
    better = better_draft([app.store.evidence.get(item) for item in fits], document, observation)
    cancelled = "cancelled; best so far: " if document["status"] == "cancelled" else ""
    sample = stored_sample(app, fitted.id)
    pooled = "" if len(document["study"]) > 1 else sharing(app, case, fitted.id, document["values"])
    shape = accuracy.get("shape_rms_in_sigma") if accuracy else None
    shown = {
        "world": fitted.id,
        "from_world": start.id,
        "verdict": verdict["verdict"],
        "why": verdict["why"],
        "prediction": document["prediction"],
        "warnings": doubtful,
        "notes": notes(document),
        "best_draft": better,
        "loss": document["loss"],
        "position_rmse": accuracy["position_rmse"] if accuracy else None,
        "position_rmse_of_starting_world": before["position_rmse"] if before else None,
        "position_rmse_held_out": held["position_rmse"] if held else None,
        "rotation_rmse": accuracy["rotation_rmse"] if accuracy else None,
        **({"shape_rmse": accuracy["shape_rmse"], "shape_rms_in_sigma": shape} if shape is not None else {}),
        "position_rmse_by_object": accuracy["position_rmse_by_object"] if accuracy else None,
        "frames": document["fitted_frames"],
        "values": [
            {k: value[k] for k in ("name", "value", "unit", "interval80", "prior80", "from_prior", "at_bound")}
            for value in document["values"]
        ],
        "contacts": CONTACTS,
        "rolling": ROLLING[document["rolling"]],
        "slack": document["slack"],
        "undetermined": rows,
        "undetermined_whole": None
        if count <= len(rows)
        else f"{count} rows: ReadEvidence(evidence=this result's evidence id, path='undetermined')",
        "ensemble": None if sample is None else sample_in_words(sample),
        "unobserved": document["unobserved"],
        "not_in_world": document["unmodelled"],
        "study": document["study"],
        "rollouts": document["rollouts"],
        "computed_now": not again,
        "next": next_step(case.id, fitted.id, document, pooled),
    }
    step, frames = fitted.time.seconds_per_frame, document["fitted_frames"]
    ahead = prediction_in_words(document)
    return Answer(
        summary=f"{cancelled}{verdict_in_words(document)} world {fitted.id}: {_short(accuracy)}"
        + (f"; {ahead}" if ahead else "")
        + f" (the starting world {start.id}, before any fit: {_short(before)})"
        + "".join(f". WARNING: {text}" for text in doubtful)
        + ("" if better is None else f". Note: {draft_in_words(better)}"),
        data={
            **{key: value for key, value in shown.items() if key not in ("undetermined", "undetermined_whole")},
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


def _short(accuracy: dict[str, Any] | None) -> str:
    """An accuracy in a few words: the error of positions, else that of shapes."""
    if accuracy is None:
        return "diverges"
    said = [] if accuracy["position_rmse"] is None else [f"position_rmse {accuracy['position_rmse']:.4g} m"]
    shape, turn = accuracy.get("shape_rms_in_sigma"), accuracy["rotation_rmse"]
    said += [] if shape is None else [f"shapes off by {shape:.3g} standard deviations (rms)"]
    said += [] if turn is None else [f"rotation_rmse {turn:.3g} rad"]
    return ", ".join(said) or "nothing observed"


def _first_frame(world: World, tracks: ObservedTracks) -> int | None:
    """The first frame at which an object of the world joins, where the tracks begin before; else None: their own."""
    step = world.time.seconds_per_frame
    starts = [round(item.start_time / step) for item in world.objects if item.name in tracks.names]
    first = min(starts, default=0)
    return first if len(tracks.frames) and int(tracks.frames[0]) < first < int(tracks.frames[-1]) else None


def _given(app: App, world: World, asked: list[ParameterArgument]) -> list[Override]:
    """Return what BuildWorld was given of bodies, which is known: what differs from its defaults and no fit found."""
    fit = last_fit(app, world)
    fitted = {path for value in ([] if fit is None else fit.values) for path in value["paths"]}
    fitted |= {path for item in asked for path in item.paths}
    found = []
    for item in world.objects:
        for field in GIVEN:
            path, default = f"objects.{item.name}.{field}", type(item).model_fields[field].default
            if path not in fitted and getattr(item, field) != default:
                found.append(Override((path,), fixed=True))
    return found


def _override(item: ParameterArgument) -> Override:
    if (item.prior_mean is None) != (item.prior_sd is None):
        raise ToolError(f"{item.paths}: a prior needs both prior_mean and prior_sd")
    prior = None if item.prior_mean is None or item.prior_sd is None else (item.prior_mean, item.prior_sd)
    return Override(tuple(item.paths), item.lower, item.upper, prior, item.fixed)
