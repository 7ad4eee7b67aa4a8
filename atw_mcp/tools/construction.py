"""World construction, second half: a world is built, fitted and committed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.app import App
from atw_mcp.building import Built, Given, ObservedObject, Scene, build_world
from atw_mcp.fitting import FitRequest, Override, chosen_parameters, digest, run_fit, window
from atw_mcp.jobs import LongWork, Progress
from atw_mcp.observing import derivation, derived_tracks, imported_tracks, latest_camera, modelled_tracks
from atw_mcp.results import Answer, explained, plain
from atw_mcp.toolbox import ToolGroup
from atw_mcp.tools.world_arguments import (
    CaseId,
    EffectArgument,
    ObjectArgument,
    ObstacleArgument,
    ParameterArgument,
    Patience,
    PlaneArgument,
    Point,
    ShapeArgument,
    WallArgument,
)
from atw_mcp.track_records import TrackRecord
from evidence_store import Case, StoreError
from polyworld.identification import FitResult
from polyworld.parameters import STATE_PARAMETERS
from polyworld.tracks import ObservedTracks
from polyworld.world import Box, Cylinder, Effect, MotionPlane, Sphere, StaticObject, TimeBase, World

GROUP = ToolGroup("world construction")
STATES = {path.rpartition(".")[0] for path in STATE_PARAMETERS}


@GROUP.tool("BuildWorld", title="Build a world", read_only=False)
def build_world_tool(
    app: App,
    case: CaseId,
    seconds_per_frame: Annotated[
        float | None,
        Field(
            gt=0,
            le=1e4,
            description="physical time between frames [s]; default: one over the file's frame rate, which may be "
            "wrong (slow motion): FitWorld can fit it",
        ),
    ] = None,
    representation: Annotated[
        Literal["auto", "planar", "spatial"],
        Field(
            description="planar: objects slide on a plane with three degrees of freedom, fast; spatial: six. auto: "
            "planar unless an object leaves the floor"
        ),
    ] = "auto",
    objects: Annotated[
        list[ObjectArgument] | None,
        Field(max_length=64, description="what is known about single objects; the rest is taken from the observation"),
    ] = None,
    only: Annotated[
        list[str] | None, Field(max_length=64, description="names of the tracks to model; default: all")
    ] = None,
    default_shape: Annotated[
        ShapeArgument | None, Field(description="shape of every object whose shape is neither observed nor given")
    ] = None,
    floor: Annotated[
        float | Literal["none"] | None,
        Field(description="z of the floor [m], or 'none'; default 0, none for motion seen from the side"),
    ] = None,
    gravity: Annotated[
        Point | None, Field(description="gravitational acceleration [m/s^2]; default 0, 0, -9.81")
    ] = None,
    motion_plane: Annotated[
        PlaneArgument | None, Field(description="plane of motion of a planar world, where it is not the floor")
    ] = None,
    walls: Annotated[list[WallArgument] | None, Field(max_length=64, description="upright walls")] = None,
    obstacles: Annotated[list[ObstacleArgument] | None, Field(max_length=64, description="other fixed solids")] = None,
    effects: Annotated[list[EffectArgument] | None, Field(max_length=32, description="further laws")] = None,
    first_frame: Annotated[
        int | None, Field(ge=0, description="frame at which the world begins; default: the first of the tracks")
    ] = None,
    tracks: Annotated[
        str | None, Field(description="id of the track record to model; default: the latest observation of the case")
    ] = None,
    world: Annotated[
        dict[str, Any] | None,
        Field(
            description="instead of all this, a complete world as JSON; its schema: "
            "DescribeTool(tool='BuildWorld', argument='world') or the resource atw://schema/world"
        ),
    ] = None,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Build a draft world from what was observed: every tracked object with its shape and size, placed and set in
    motion as its track begins, on a floor. Friction, restitution and masses are defaults until FitWorld fits them.
    A changed world is a new world; build as many drafts as needed. Next: FitWorld, or InspectRollout to look."""
    found = app.case_to_model(case, "BuildWorld")
    if world is not None:
        return _from_document(app, found, world)
    with explained():
        given = {item.name: item.to_given() for item in objects or []}
        request = _BuildRequest(
            representation=representation,
            given=given,
            only=only,
            default_shape=None if default_shape is None else default_shape.to_shape(),
            gravity=(0.0, 0.0, -9.81) if gravity is None else _triple(gravity),
            floor=floor,
            motion_plane=None if motion_plane is None else motion_plane.to_plane(),
            statics=(
                *(wall.to_static(floor if isinstance(floor, float) else 0.0) for wall in walls or []),
                *(item.to_static() for item in obstacles or []),
            ),
            effects=tuple(item.to_effect() for item in effects or []),
            first_frame=first_frame,
            seconds_per_frame=seconds_per_frame,
        )
        how = None
        if tracks is None:
            solids = {
                name: item.shape for name, item in given.items() if isinstance(item.shape, Sphere | Box | Cylinder)
            }
            how = derivation(app, found, solids, request.plane_seen())
        if how is None:
            return _build(app, found, request, imported_tracks(app, found, tracks))
        record = derived_tracks(app, found, how, None)
        if record is not None:
            return _build(app, found, request, record)

    def work(progress: Progress) -> Answer:
        with explained():
            made = derived_tracks(app, found, how, progress)
            assert made is not None
            return _build(app, found, request, made)

    return LongWork(
        key=app.store.observations.key("world_tracks", how.inputs()) + repr(request),
        work=work,
        draft=Answer(summary="measuring positions in the world", data={}, case=found.id),
        patience=patience_seconds,
    )


@dataclass(frozen=True)
class _BuildRequest:
    """What BuildWorld was asked, in the engine's words."""

    representation: Literal["auto", "planar", "spatial"]
    given: dict[str, Given]
    only: list[str] | None
    default_shape: Any
    gravity: tuple[float, float, float]
    floor: float | Literal["none"] | None
    motion_plane: MotionPlane | None
    statics: tuple[StaticObject, ...]
    effects: tuple[Effect, ...]
    first_frame: int | None
    seconds_per_frame: float | None

    def plane_seen(self) -> MotionPlane | None:
        """The plane in which the video shows objects, where the agent says it; None leaves it to the camera."""
        if self.motion_plane is not None:
            return self.motion_plane
        return MotionPlane(point=(0.0, 0.0, self.floor)) if isinstance(self.floor, float) and self.floor else None


def _build(app: App, case: Case, request: _BuildRequest, record: TrackRecord) -> Answer:
    rate, rate_note = _seconds_per_frame(case, record, request.seconds_per_frame)
    observed = record.objects
    if request.default_shape is not None:
        observed = tuple(_with_shape(item, request.default_shape) for item in observed)
    tracks = record.tracks
    if request.first_frame is not None:
        tracks = window(tracks, FitRequest(first_frame=request.first_frame))
    plane = request.motion_plane
    if plane is None and record.plane is not None and abs(record.plane.normal[2]) < 0.5:
        plane = record.plane
    floor = request.floor
    if floor is None:
        floor = 0.0 if plane is None or plane.supports else "none"
    built = build_world(
        tracks,
        observed,
        given=request.given,
        chosen=request.only,
        scene=Scene(
            gravity=request.gravity,
            floor_height=None if floor == "none" else floor,
            motion_plane=plane,
            statics=request.statics,
            effects=request.effects,
        ),
        representation=request.representation,
        heights_assumed=record.heights_assumed,
        time=TimeBase(seconds_per_frame=rate, frame_count=_frame_count(case, tracks)),
        camera=latest_camera(app, case),
    )
    app.keep_world(case, built.world, how="built", observation=record.id)
    return _built_answer(case, built, record.id, rate_note)


def _from_document(app: App, case: Case, document: dict[str, Any]) -> Answer:
    with explained("DescribeTool(tool='BuildWorld', argument='world') gives the schema of a world"):
        made = World.model_validate(document)
    record = app.store.cases.observations(case.id, "tracks")
    observation = record[0][1] if record else None
    app.keep_world(case, made, how="given", observation=observation)
    names = tuple(item.name for item in made.objects)
    return Answer(
        summary=f"draft world {made.id} with {len(names)} objects, as given",
        data={"world": made.id, "objects": made.objects, "statics": made.statics},
        case=case.id,
        world=made.id,
        observation=observation,
        objects=names,
    )


def _built_answer(case: Case, built: Built, observation: str, rate_note: str | None) -> Answer:
    made = built.world
    names = tuple(item.name for item in made.objects)
    assumed = [*built.assumed, *([rate_note] if rate_note else [])]
    return Answer(
        summary=f"draft world {made.id}: {len(names)} objects, {built.representation} ({built.why})",
        data={
            "world": made.id,
            "representation": built.representation,
            "why": built.why,
            "objects": [
                {
                    "name": item.name,
                    "shape": item.shape,
                    "color": item.appearance.color,
                    "start_frame": round(item.start_time / made.time.seconds_per_frame),
                    "position": item.position,
                    "velocity": item.velocity,
                }
                for item in made.objects
            ],
            "statics": [static.name for static in made.statics],
            "seconds_per_frame": made.time.seconds_per_frame,
            "camera": made.camera is not None,
            "assumed": assumed,
            "left_out": list(built.left_out),
            "next": f"FitWorld(case={case.id!r}, world={made.id!r})",
        },
        case=case.id,
        world=made.id,
        observation=observation,
        objects=names,
    )


@GROUP.tool("FitWorld", title="Fit a world to the observation", read_only=False)
def fit_world(
    app: App,
    case: CaseId,
    world: Annotated[str | None, Field(description="world id to start from; default: the latest draft")] = None,
    method: Annotated[
        Literal["cem", "random_search", "refine"],
        Field(
            description="cem: cross-entropy method, global; refine: least squares from where the world is, to polish "
            "a fitted world; random_search: for comparison"
        ),
    ] = "cem",
    fit_seconds_per_frame: Annotated[
        bool, Field(description="also fit the physical time between frames, where the file's rate is not trusted")
    ] = False,
    fit_initial_states: Annotated[bool, Field(description="also fit where and how fast objects begin")] = True,
    each: Annotated[
        list[str] | None,
        Field(
            max_length=8,
            description="physical parameters fitted for each object: mass, friction, restitution, "
            "rolling_resistance, torsional_radius, linear_damping, angular_damping; "
            "default friction, restitution and mass",
        ),
    ] = None,
    shared: Annotated[
        list[str] | None,
        Field(
            max_length=8,
            description="physical parameters with one value for all objects; default linear_damping, angular_damping",
        ),
    ] = None,
    parameters: Annotated[
        list[ParameterArgument] | None,
        Field(max_length=64, description="single parameters to add, to tie, to bound or to keep fixed"),
    ] = None,
    first_frame: Annotated[int | None, Field(ge=0, description="first frame used; default: the first tracked")] = None,
    last_frame: Annotated[int | None, Field(ge=0, description="last frame used; default: the last tracked")] = None,
    holdout_from: Annotated[
        int | None,
        Field(ge=1, description="frames from this one on are not fitted but used to judge the fit: give it to test it"),
    ] = None,
    generations: Annotated[int, Field(ge=1, le=2000, description="generations of the search")] = 60,
    population: Annotated[int, Field(ge=8, le=4096, description="candidates a generation")] = 64,
    restarts: Annotated[int, Field(ge=1, le=50, description="independent searches, of which the best counts")] = 1,
    position_tolerance: Annotated[
        float, Field(ge=0, le=1e3, description="misfit the model is not asked to reproduce [m]")
    ] = 0.0,
    seed: Annotated[int, Field(ge=0, le=2**31 - 1, description="random seed; equal seeds give equal worlds")] = 0,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Search a world's unknown parameters until its simulated motion matches the observed motion. Returns a new
    world, its error on the frames (position_rmse [m]), every fitted value with its uncertainty, and what the data
    cannot determine. The same request is never computed twice. Next: InspectRollout to see it over the frames,
    FitWorld(method="refine") to polish, CommitWorld when it follows the video."""
    found = app.case_to_model(case, "FitWorld")
    start = app.world(found, world)
    with explained(f"BuildWorld(case={found.id!r})"):
        record = modelled_tracks(app, found, start)
    request = FitRequest(
        method=method,
        first_frame=first_frame,
        last_frame=last_frame,
        holdout_from=holdout_from,
        fit_seconds_per_frame=fit_seconds_per_frame,
        fit_initial_states=fit_initial_states,
        overrides=tuple(_override(item) for item in parameters or []),
        generations=generations,
        population=population,
        restarts=restarts,
        position_tolerance=position_tolerance,
        seed=seed,
        **({} if each is None else {"each": tuple(each)}),
        **({} if shared is None else {"shared": tuple(shared)}),
    )
    with explained():
        names = [item.name for item in start.objects if item.name in record.tracks.names]
        tracks = window(record.tracks.select(names), request)
        if holdout_from is not None and not tracks.frames[0] < holdout_from <= tracks.frames[-1]:
            raise ValueError(
                f"holdout_from must lie in frames {tracks.frames[0] + 1}..{tracks.frames[-1]}, got {holdout_from}"
            )
        unknowns = chosen_parameters(start, tracks, request)
    inputs = {
        "world": start.id,
        "observation": record.id,
        "request": plain({**vars(request), "overrides": [vars(item) for item in request.overrides]}),
        "parameters": [item.to_dict() for item in unknowns],
    }
    kept = app.store.fits.find("fit", inputs)
    if kept is not None:
        fitted = World.model_validate_json(app.store.worlds.document(kept.document["world"]))
        return _fit_answer(found, start, fitted, kept.document, tracks, record.id, again=True)

    def work(progress: Progress) -> Answer:
        with explained():
            result = run_fit(start, tracks, unknowns, request, progress)
        return _keep_fit(app, found, start, result, inputs, tracks, record.id)

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
    result: FitResult,
    inputs: dict[str, Any],
    tracks: ObservedTracks,
    observation: str,
) -> Answer:
    document = plain(digest(result))
    with app.store.transaction():
        app.keep_world(
            case,
            result.world,
            how="fitted",
            parent=start,
            detail={"fit": app.store.fits.key("fit", inputs), "method": result.method, "seed": result.seed},
            observation=observation,
        )
        if result.status == "completed":  # a cancelled fit depends on when it was cancelled: do not reuse it
            app.store.fits.put("fit", inputs, document)
    return _fit_answer(case, start, result.world, document, tracks, observation, again=False)


def _fit_answer(
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
    said = "diverged" if after is None else f"position_rmse {after:.4g} m"
    was = "a diverging one" if before is None else f"{before:.4g} m"
    kept = "" if document["held_out"] is None else f", {held:.4g} m on the frames held out"
    cancelled = "cancelled; best so far: " if document["status"] == "cancelled" else ""
    shown = {
        "world": fitted.id,
        "from_world": start.id,
        "method": document["method"],
        "position_rmse": after,
        "position_rmse_before": before,
        "position_rmse_held_out": held,
        "rotation_rmse": document["accuracy"]["rotation_rmse"] if document["accuracy"] else None,
        "position_rmse_by_object": document["accuracy"]["position_rmse_by_object"] if document["accuracy"] else None,
        "frames": document["fitted_frames"],
        "values": [
            {key: value[key] for key in ("name", "value", "unit", "standard_error", "spread", "at_bound")}
            for value in document["values"]
            if not _is_state(value)
        ],
        "initial_states": f"{sum(map(_is_state, document['values']))} values fitted: ReadEvidence(path='values')",
        "undetermined": document["undetermined"],
        "unobserved": document["unobserved"],
        "not_in_world": document["unmodelled"],
        "rollouts": document["rollouts"],
        "computed_now": not again,
        "next": f"InspectRollout(case={case.id!r}, world={fitted.id!r}), then "
        f"CommitWorld(case={case.id!r}, world={fitted.id!r})",
    }
    step = fitted.time.seconds_per_frame
    frames = document["fitted_frames"]
    return Answer(
        summary=f"{cancelled}fitted world {fitted.id}: {said} (before: {was}){kept}",
        data={"world": fitted.id, "from_world": start.id, **document},
        shown=shown,
        case=case.id,
        world=fitted.id,
        observation=observation,
        objects=tracks.names,
        interval=(frames[0] * step, frames[1] * step),
        status="cancelled" if document["status"] == "cancelled" else "completed",
    )


@GROUP.tool("CommitWorld", title="Commit the world", read_only=False)
def commit_world(
    app: App,
    case: CaseId,
    world: Annotated[str, Field(description="id of the world every probe will start from")],
) -> Answer:
    """End World Modeling: fix the world that every probe of this case starts from. This is final for the case
    (OpenCase with another name opens the same file afresh). Next: Rollout."""
    found = app.case_to_model(case, "CommitWorld")
    chosen = app.world(found, world)
    try:
        app.store.cases.commit_world(found.id, chosen.id)
    except StoreError as error:  # another process was faster
        raise ToolError(f"{error}. Next: Rollout(case={found.id!r})") from error
    names = tuple(item.name for item in chosen.objects)
    return Answer(
        summary=f"committed {chosen.id}: World Probing begins",
        data={"world": chosen.id, "objects": list(names), "next": f"Rollout(case={found.id!r})"},
        case=found.id,
        world=chosen.id,
        observation=app.store.cases.modelled_observation(found.id, chosen.id),
        objects=names,
    )


def _is_state(value: dict[str, Any]) -> bool:
    return any(path.rpartition(".")[0].partition(".")[2].partition(".")[2] in STATES for path in value["paths"])


def _override(item: ParameterArgument) -> Override:
    if (item.prior_mean is None) != (item.prior_sd is None):
        raise ToolError(f"{item.paths}: a prior needs both prior_mean and prior_sd")
    prior = None if item.prior_mean is None or item.prior_sd is None else (item.prior_mean, item.prior_sd)
    return Override(tuple(item.paths), item.lower, item.upper, prior, item.fixed)


def _seconds_per_frame(case: Case, record: TrackRecord, given: float | None) -> tuple[float, str | None]:
    if given is not None:
        return given, None
    rate = record.tracks.seconds_per_frame
    if record.source["kind"] == "imported":
        return rate, f"{rate:.6g} s per frame, from the imported tracks"
    source = "from the file's frame rate" if case.facts.get("frames_per_second") else "although the file states no rate"
    return rate, (
        f"{rate:.6g} s per frame, {source}: give seconds_per_frame, or fit it with FitWorld(fit_seconds_per_frame=true)"
    )


def _frame_count(case: Case, tracks: ObservedTracks) -> int:
    counted = case.facts.get("frame_count")
    return int(counted) if counted else (int(tracks.frames[-1]) + 1 if len(tracks.frames) else 0)


def _with_shape(item: ObservedObject, shape: Any) -> ObservedObject:
    return item if item.shape is not None else replace(item, shape=shape)


def _triple(values: list[float]) -> tuple[float, float, float]:
    return values[0], values[1], values[2]
