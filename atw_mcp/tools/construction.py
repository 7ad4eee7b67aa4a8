"""World construction, third part: a world is built."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.fitting.fitting import FitRequest, window
from atw_mcp.observation.importing import mesh_of
from atw_mcp.observation.observing import UNKNOWN_RATE, derivation, derived_tracks, latest_camera, track_record
from atw_mcp.observation.track_records import TrackRecord
from atw_mcp.perception.flight.placing import Surroundings
from atw_mcp.results.construction import BuiltWorld, GivenWorld
from atw_mcp.tools.known_objects import corners_of
from atw_mcp.tools.world_arguments import (
    CaseId,
    EffectArgument,
    ObjectArgument,
    ObstacleArgument,
    PartArgument,
    Patience,
    PlaneArgument,
    Point,
    ShapeArgument,
    WallArgument,
)
from atw_mcp.worlds.building import Built, Given, ObservedObject, Scene, build_world
from atw_mcp.worlds.built_answer import built_answer, place_in_words
from atw_mcp.worlds.given_worlds import DIVIDING, as_long_work, from_document
from atw_mcp.worlds.parts import Parts, longest_step, read_parts
from atw_mcp.worlds.sizes import check_described, described, takes_long
from evidence_store import Case
from polyworld.data.tracks import ObservedTracks
from polyworld.world import Effect, MotionPlane, StaticObject, TimeBase
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere, TriangleMesh, Wall

GROUP = ToolGroup("world construction")
OBJECTS_EXAMPLE = [
    {
        "name": "red",
        "shape": {"kind": "sphere", "radius": 0.1},
        "position": [0, 0, 0.1],
        "velocity": [1, 0, 0],
        "mass": 0.5,
    }
]


@GROUP.tool("BuildWorld", title="Build a world", read_only=False, returns=BuiltWorld | GivenWorld)
def build_world_tool(
    app: App,
    case: CaseId,
    seconds_per_frame: Annotated[
        float | None,
        Field(
            gt=0,
            le=1e4,
            description="physical time between frames [s]; default: one over the file's frame rate. That may be wrong "
            "(slow motion): FitWorld can fit it",
        ),
    ] = None,
    representation: Annotated[
        Literal["auto", "planar", "spatial"],
        Field(
            description="planar: motion in one plane; spatial: six degrees of freedom. auto: planar unless an object "
            "leaves the floor, or something described moves in space only; the result says why"
        ),
    ] = "auto",
    objects: Annotated[
        list[ObjectArgument] | None,
        Field(
            max_length=64,
            description="what is known of rigid objects; those not observed need shape and position. The rest is "
            "taken from the observation",
            examples=[OBJECTS_EXAMPLE],
        ),
    ] = None,
    parts: Annotated[
        list[PartArgument] | None,
        Field(
            max_length=256,
            description="deformable objects, fluids, what holds them, and joints of rigid objects. A rope or soft body "
            "that was observed under its name starts where it was seen",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        Field(max_length=64, description="tracks to model; default: all; []: none, what is described alone"),
    ] = None,
    default_shape: Annotated[ShapeArgument | None, Field(description="shape of objects without one")] = None,
    floor: Annotated[
        float | Literal["none"] | None,
        Field(
            description="z of the floor [m], or 'none'; default 0. A side view has none unless given, and z = 0 "
            "is the lower edge of the image"
        ),
    ] = None,
    gravity: Annotated[Point | None, Field(description="[m/s^2]; default 0, 0, -9.81")] = None,
    motion_plane: Annotated[
        PlaneArgument | None, Field(description="plane of motion, where it is not the floor")
    ] = None,
    walls: Annotated[
        list[WallArgument] | None,
        Field(max_length=64, description="upright walls", examples=[[{"name": "w", "start": [1, -1], "end": [1, 1]}]]),
    ] = None,
    obstacles: Annotated[
        list[ObstacleArgument] | None,
        Field(
            max_length=64,
            description="other fixed solids",
            examples=[
                [{"name": "ramp", "shape": {"kind": "box", "half_extents": [1, 0.5, 0.1]}, "position": [0, 0, 0]}]
            ],
        ),
    ] = None,
    effects: Annotated[
        list[EffectArgument] | None,
        Field(
            max_length=32,
            description="laws beyond gravity, contact and damping",
            examples=[[{"name": "air", "kind": "quadratic_drag", "parameters": {"coefficient": 0.1}}]],
        ),
    ] = None,
    wind: Annotated[Point | None, Field(description="air velocity, acts on cloth alone [m/s]")] = None,
    substep: Annotated[
        float | None,
        Field(
            gt=0,
            le=0.05,
            description="longest step [s]; default 0.002, with liquids alone up to 0.004. Deformable objects take "
            "smaller steps inside it as their stiffness asks; a fast fluid or thin fast things may need a smaller one",
        ),
    ] = None,
    first_frame: Annotated[
        int | None, Field(ge=0, description="frame at which it begins; default: the tracks' first")
    ] = None,
    tracks: Annotated[str | None, Field(description="track record id; default: the latest")] = None,
    observation: Annotated[
        str | None,
        Field(description="observation id, as OpenCase lists them; default: the latest"),
    ] = None,
    world: Annotated[
        dict[str, Any] | str | None,
        Field(
            description="instead of all this, a complete world, or its file: JSON, MJCF, URDF, USD; schema: "
            "DescribeTool(tool='BuildWorld', argument='world') or atw://schema/world"
        ),
    ] = None,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Build a draft world from what was observed: every tracked object with its shape and size, placed and set in
    motion as its track begins, on a floor; with what is described in objects and parts. Friction, restitution, masses
    and stiffnesses are defaults until FitWorld fits them. A changed world is a new world; build as many drafts as
    needed. Next: FitWorld, or InspectRollout to look."""
    found = app.case(case)
    if world is not None:
        return from_document(app, found, world, patience_seconds)
    with explained():
        meshes = partial(mesh_of, app, found)

        given = {item.name: item.to_given(meshes) for item in objects or []}
        request = _BuildRequest(
            representation=representation,
            given=given,
            only=only,
            default_shape=None if default_shape is None else default_shape.to_shape(meshes),
            gravity=(0.0, 0.0, -9.81) if gravity is None else _triple(gravity),
            floor=floor,
            motion_plane=None if motion_plane is None else motion_plane.to_plane(),
            statics=(
                *(wall.to_static(floor if isinstance(floor, float) else 0.0) for wall in walls or []),
                *(static for item in obstacles or [] for static in item.to_statics(meshes)),
            ),
            effects=tuple(item.to_effect() for item in effects or []),
            first_frame=first_frame,
            seconds_per_frame=seconds_per_frame,
            parts=read_parts(parts or []),
            wind=(0.0, 0.0, 0.0) if wind is None else _triple(wind),
            substep=substep,
        )
        deformables = described(request.parts)
        check_described(deformables, app.limits, planar=representation != "spatial")
        long = takes_long(deformables)
        how = None
        if tracks is not None and observation is not None:
            raise ValueError("give tracks or observation, not both: tracks are modelled as they are")
        if tracks is None and observation is None and _described_alone(app, found, request):
            return _built(app, found, request, None, patience_seconds, long=long)
        if tracks is None:
            solids = {
                name: item.shape for name, item in given.items() if isinstance(item.shape, Sphere | Box | Cylinder)
            }
            how = derivation(
                app,
                found,
                solids,
                request.motion_plane,
                floor if isinstance(floor, float) else 0.0,
                observation,
                about=_surroundings(request),
                seconds_per_frame=seconds_per_frame,
            )
        if how is None:
            return _built(app, found, request, track_record(app, found, tracks), patience_seconds, long=long)
        record = derived_tracks(app, found, how, None)
        if record is not None:
            return _built(app, found, request, record, patience_seconds, long=long)

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


def _built(
    app: App, case: Case, request: _BuildRequest, record: TrackRecord | None, patience: float, *, long: bool
) -> Answer | LongWork:
    """Build at once, or as long work where soft bodies have to be divided into many elements."""
    if not long:
        return _build(app, case, request, record)
    key = f"build {case.id} {None if record is None else record.id} {request!r}"
    return as_long_work(case, key, patience, DIVIDING, lambda: _build(app, case, request, record))


@dataclass(frozen=True)
class _BuildRequest:
    """Request of BuildWorld, in the engine's terms."""

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
    parts: Parts
    wind: tuple[float, float, float]
    substep: float | None


def _surroundings(request: _BuildRequest) -> Surroundings | None:
    """Return what observed bodies fly over and move on; None where there is no floor or nothing falls down on it."""
    if request.floor == "none" or request.gravity[2] >= 0.0 or request.gravity[:2] != (0.0, 0.0):
        return None
    convex = [item for item in request.statics if not isinstance(item.shape, Plane | Wall | TriangleMesh)]
    corners = {item.name: own for item, own in zip(convex, corners_of(convex), strict=True)}
    return Surroundings(request.gravity, request.floor or 0.0, corners)


def _described_alone(app: App, case: Case, request: _BuildRequest) -> bool:
    """Whether the world is made of what was described, and of nothing that was observed."""
    if request.only == []:
        return True
    observed = {kind for kind, _ in app.store.cases.observations(case.id)} & {"tracks", "objects"}
    described = any(own.position is not None for own in request.given.values()) or request.parts.deformables
    return not observed and bool(described)


def _no_tracks(case: Case) -> TrackRecord:
    """Return an empty track record, for a world that models no tracks."""
    frame = 1.0 / float(case.facts.get("frames_per_second") or 0.0 or 1.0 / UNKNOWN_RATE)
    none = ObservedTracks(
        names=(),
        frames=np.zeros(0, dtype=np.int64),
        seconds_per_frame=frame,
        positions=np.zeros((0, 0, 3)),
        position_sigma=np.zeros((0, 0)),
        orientations=np.zeros((0, 0, 4)),
        confidence=np.zeros((0, 0)),
        orientation_confidence=np.zeros((0, 0)),
        symmetry=(),
    )
    return TrackRecord("", none, (), False, {"kind": "described"}, None)


def _build(app: App, case: Case, request: _BuildRequest, found: TrackRecord | None) -> Answer:
    record = _no_tracks(case) if found is None else found
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
            parts=request.parts,
            wind=request.wind,
        ),
        representation=request.representation,
        heights_assumed=record.heights_assumed,
        airborne=frozenset(record.source.get("motions", {})),
        time=TimeBase.model_validate(
            {
                "seconds_per_frame": rate,
                "frame_count": _frame_count(case, tracks),
                **(longest_step(request.parts) if request.substep is None else {"substep": request.substep}),
            }
        ),
        camera=latest_camera(app, case),
        limits=app.limits,
    )
    observation = None if found is None else found.id
    app.keep_world(case, built.world, how="built", observation=observation)
    return built_answer(case, built, observation, [*([rate_note] if rate_note else []), *_in_the_air(record, built)])


def _in_the_air(record: TrackRecord, built: Built) -> list[str]:
    """Which frames show an object in free flight or on an obstacle, where its ray to the floor does not place it."""
    found = []
    for name in built.world.moving_names:
        parts = [p for p in record.source.get("motions", {}).get(name, []) if p["motion"] != "floor"]
        if parts:
            listed = ", ".join(f"{place_in_words(p['motion'])} in frames {p['first']}..{p['last']}" for p in parts)
            found.append(f"{name} leaves the floor ({listed}): places in flight follow from gravity and its size")
    return found


def _seconds_per_frame(case: Case, record: TrackRecord, given: float | None) -> tuple[float, str | None]:
    if given is not None:
        return given, None
    rate = record.tracks.seconds_per_frame
    if record.source["kind"] == "described":
        return rate, f"{rate:.6g} s per frame, between the samples of rollouts: there is nothing observed"
    if record.source["kind"] == "imported":
        return rate, f"{rate:.6g} s per frame, from the imported tracks"
    source = "from the file's frame rate" if case.facts.get("frames_per_second") else "although the file states no rate"
    if "clock" in case.facts:
        source = "the mean by the file's time stamps, which every frame keeps"
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
