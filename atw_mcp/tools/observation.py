"""World construction: the objects of a case's video are found and followed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field, ValidationError

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.observation.importing import mesh_of
from atw_mcp.observation.observing import (
    chosen_image_observation,
    image_observation,
    keep_image_observation,
    latest_camera,
    motion_plane_of,
    shown_times,
    video_file,
)
from atw_mcp.observation.shape_records import ShapeRecord, keep_shapes, latest_shapes, series_rows, shape_inputs
from atw_mcp.perception.correction import correct
from atw_mcp.perception.corrections import Correction
from atw_mcp.perception.known_bodies import observe_known
from atw_mcp.perception.known_scene import KnownScene
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.observe import observe
from atw_mcp.perception.shapes import Material, deforming, image_shapes
from atw_mcp.results.observation import MeasuredShapes, ObservedObjects
from atw_mcp.tools.known_objects import KnownObject, bodies_of, corners_of, known_of
from atw_mcp.tools.world_arguments import Argument, CaseId, ObstacleArgument, Patience, PlaneArgument
from evidence_store import Case
from polyworld.world import MotionPlane

Given = TypeVar("Given", bound=Argument)
GROUP = ToolGroup("world construction")


class ShapeArgument(Argument):
    """Kind of a deformable object, so that its shape is measured in every frame."""

    object: str = Field(max_length=64, description="name of the observed object")
    kind: Material = Field(
        description="rope: its centreline; soft: how far it reaches in eight directions; cloth: the same, and which "
        "cells of the image it covers; fluid: those cells"
    )


@GROUP.tool(
    "ObserveObjects",
    title="Find and follow objects",
    read_only=False,
    returns=ObservedObjects | MeasuredShapes,
)
def observe_objects(
    app: App,
    case: CaseId,
    expected: Annotated[
        list[Annotated[str, Field(min_length=1, max_length=100)]] | None,
        Field(
            max_length=64,
            description="descriptions, used as names, e.g. 'blue metal sphere'",
        ),
    ] = None,
    known: Annotated[
        list[dict[str, Any]] | None,
        Field(
            min_length=1,
            max_length=64,
            description="objects as of ModelVideo, moving on the floor or in motion_plane: nothing else is looked for. "
            "They need shape, and color or pixel; their places in the world are measured with the camera",
        ),
    ] = None,
    obstacles: Annotated[
        list[dict[str, Any]] | None,
        Field(max_length=64, description="as of BuildWorld; known objects may be behind them"),
    ] = None,
    floor: Annotated[
        float | None, Field(description="z of the floor under known objects [m]; default 0, a side view none")
    ] = None,
    motion_plane: Annotated[
        PlaneArgument | None,
        Field(description="plane in which known objects move, where it is not the floor or a side view's"),
    ] = None,
    max_objects: Annotated[int, Field(ge=1, le=200, description="most objects to follow")] = 20,
    min_area: Annotated[int | None, Field(ge=4, le=10_000_000, description="smallest region of an object [px]")] = None,
    stride: Annotated[int, Field(ge=1, le=100, description="look at every n-th frame")] = 1,
    corrections: Annotated[
        list[Correction] | None,
        Field(
            min_length=1,
            max_length=50,
            description="what is wrong in the observation, as InspectFrames shows it. Outlines, places, regions and "
            "rests are kept: objects that have one are followed again from all of theirs. Other arguments but "
            "observation do not matter",
            examples=[[{"kind": "outline", "object": "red_ball", "frame": 12, "circle": [204, 131, 9.5]}]],
        ),
    ] = None,
    deformable: Annotated[
        list[ShapeArgument] | None,
        Field(
            min_length=1,
            max_length=32,
            description="observed objects that are ropes, cloth, soft bodies or fluids. Their shapes are measured "
            "from their masks, for BuildWorld and FitWorld. Other arguments but observation do not matter",
            examples=[[{"object": "cord", "kind": "rope"}]],
        ),
    ] = None,
    observation: Annotated[
        str | None,
        Field(
            description="observation id these are about; default: the latest. Alone: makes "
            "that earlier observation the case's latest again"
        ),
    ] = None,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Find every moving or distinct object in the video and follow it: masks, colour, material and shape, when it is
    visible, hidden, enters or leaves; and what seems to deform. The camera must not move. Next: InspectFrames to check,
    ObserveObjects with corrections where it is wrong or with deformable, then CalibrateCamera."""
    found = app.case(case)
    with explained(f"OpenCase(video=PATH) or ImportObservation(case={found.id!r})"):
        path = video_file(app, found)
    stride *= shown_times(found)
    if deformable is not None:
        if corrections is not None:
            raise ToolError("give corrections first, then deformable in another call: shapes follow from the masks")
        kinds = {item.object: item.kind for item in deformable}
        return _shapes(app, found, observation, kinds, patience_seconds)
    if corrections is not None:
        return _correction(app, found, path, observation, corrections, patience_seconds)
    if observation is not None:
        with explained(f"OpenCase(case={found.id!r}) lists the observations of the case"):
            identifier, seen = chosen_image_observation(app, found, observation)
        app.store.cases.add_observation(found.id, "objects", identifier)
        return observed_answer(found, identifier, seen)
    if known is not None:
        plane = None if motion_plane is None else motion_plane.to_plane()
        return _known(app, found, path, _Scene(known, obstacles or [], floor, plane), stride, patience_seconds)
    inputs = {
        "video": found.content,
        "expected": expected,
        "max_objects": max_objects,
        "min_area": min_area,
        "stride": stride,
    }

    def look(progress: Progress) -> ImageObservation:
        return observe(
            path,
            max_objects=max_objects,
            min_area=min_area,
            expected=expected,
            stride=stride,
            progress=lambda share, what: progress.report(share, 1.0, what),
            cancelled=progress.cancelled,
        )

    return _observation(app, found, "observe", inputs, look, f"observing {path.name}", patience_seconds)


@dataclass(frozen=True)
class _Scene:
    """Known facts of a scene: objects to look for, fixed solids, z of the floor [m], and the plane of motion."""

    known: list[dict[str, Any]]
    obstacles: list[dict[str, Any]]
    floor: float | None
    plane: MotionPlane | None


def _validated(name: str, kind: type[Given], items: list[dict[str, Any]]) -> list[Given]:
    """Return items as arguments of a kind; raises ToolError naming the fields that do not suit it."""
    try:
        return [kind.model_validate(item) for item in items]
    except ValidationError as error:
        listed = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise ToolError(f"{name}: {listed}; fields are {', '.join(kind.model_fields)}") from error


def _known(app: App, case: Case, path: Path, scene: _Scene, stride: int, patience: float) -> Answer | LongWork:
    camera = latest_camera(app, case)
    if camera is None:
        raise ToolError(f"known objects are looked for by size: CalibrateCamera(case={case.id!r}) comes first")
    items = _validated("known", KnownObject, scene.known)
    obstacles = _validated("obstacles", ObstacleArgument, scene.obstacles)
    with explained():
        bodies, solids = bodies_of([known_of(app, case, item) for item in items])
        fixtures = corners_of([s for item in obstacles for s in item.to_statics(partial(mesh_of, app, case))])
        plane = scene.plane or motion_plane_of(app, case, scene.floor or 0.0)
        across = frozenset(item.name for item in items if item.across)
        about = KnownScene(camera, plane, solids, fixtures, floor=scene.floor, across=across)

    def look(progress: Progress) -> ImageObservation:
        return observe_known(
            path,
            bodies,
            about,
            stride=stride,
            progress=lambda share, what: progress.report(share, 1.0, what),
            cancelled=progress.cancelled,
        )

    inputs = {
        "video": case.content,
        "known": [item.model_dump(exclude_none=True) for item in items],
        "scene": about.to_dict(),
        "stride": stride,
    }
    return _observation(app, case, "observe_known", inputs, look, f"looking for {len(bodies)} bodies", patience)


def _shapes(
    app: App, case: Case, observation: str | None, kinds: dict[str, Material], patience: float
) -> Answer | LongWork:
    with explained():
        identifier, seen = chosen_image_observation(app, case, observation)
    with explained(f"InspectFrames(case={case.id!r}) shows the objects and their names"):
        for name in kinds:
            seen.object(name)
    before = latest_shapes(app, case, identifier)
    if before is not None:  # what was said earlier of other objects still holds
        kinds = {**before.kinds, **kinds}
    declared = tuple(sorted({*kinds} if before is None else {*before.declared, *kinds}))
    inputs = shape_inputs(identifier, kinds, declared)
    kept = app.store.observations.find("shapes", inputs)
    if kept is not None:
        app.store.cases.add_observation(case.id, "shapes", kept.id)
        return _shapes_answer(case, ShapeRecord.of(kept))

    def work(progress: Progress) -> Answer:
        with explained():
            series = image_shapes(
                seen,
                kinds,
                progress=lambda share, what: progress.report(share, 1.0, what),
                cancelled=progress.cancelled,
            )
        return _shapes_answer(case, keep_shapes(app, case, inputs, seen.frames, series))

    return LongWork(
        key=app.store.observations.key("shapes", inputs) + case.id,
        work=work,
        draft=Answer(summary=f"measuring the shapes of {', '.join(kinds)}", data={}, case=case.id),
        patience=patience,
    )


def _shapes_answer(case: Case, record: ShapeRecord) -> Answer:
    rows = series_rows(record.series, record.frames)
    nothing = sorted(set(record.kinds) - {row["object"] for row in rows})
    measured = "; ".join(f"{row['readout']} of {row['object']} in {row['frames_seen']} frames" for row in rows)
    warned = f"; nothing could be measured of {', '.join(nothing)}" if nothing else ""
    return Answer(
        summary=f"shapes {record.id}: {measured or 'none'}{warned}",
        data={
            "shapes": record.id,
            "objects": record.objects,
            "kinds": record.kinds,
            "measured": rows,
            "unit": "px",
            "nothing_measured": nothing,
            "next": f"CalibrateCamera(case={case.id!r}), then BuildWorld(case={case.id!r}) with these objects as parts",
        },
        case=case.id,
        observation=record.id,
        objects=tuple(record.kinds),
    )


def _correction(
    app: App, case: Case, path: Path, observation: str | None, corrections: list[Correction], patience: float
) -> Answer | LongWork:
    with explained():
        base, seen = chosen_image_observation(app, case, observation)
    camera = latest_camera(app, case)
    places = any(item.kind == "place" for item in corrections)
    if places and camera is None:
        raise ToolError(f"a place in the world needs a camera. Next: CalibrateCamera(case={case.id!r})")
    said = [item.model_dump(exclude_none=True) for item in corrections]

    def look(progress: Progress) -> ImageObservation:
        return correct(
            seen,
            path,
            corrections,
            camera=camera,
            progress=lambda share, what: progress.report(share, 1.0, what),
            cancelled=progress.cancelled,
        )

    inputs: dict[str, Any] = {"observation": base, "corrections": said}
    if places and camera is not None:
        inputs["camera"] = camera.model_dump(mode="json")
    return _observation(app, case, "correct", inputs, look, f"{len(corrections)} corrections", patience)


def _observation(
    app: App,
    case: Case,
    kind: str,
    inputs: dict[str, Any],
    look: Callable[[Progress], ImageObservation],
    doing: str,
    patience: float,
) -> Answer | LongWork:
    """The observation of these inputs: as stored, or computed now and made the case's latest."""
    kept = app.store.observations.find(kind, inputs)
    if kept is not None:
        app.store.cases.add_observation(case.id, "objects", kept.id)
        return observed_answer(case, kept.id, image_observation(kept))

    def work(progress: Progress) -> Answer:
        with explained():
            seen = look(progress)
        content = keep_image_observation(app, case, seen, kind, inputs)
        return observed_answer(case, content.id, seen)

    return LongWork(
        key=app.store.observations.key(kind, inputs) + case.id,
        work=work,
        draft=Answer(summary=doing, data={}, case=case.id),
        patience=patience,
    )


def observed_answer(case: Case, identifier: str, seen: ImageObservation) -> Answer:
    """Answer with an overview of an observation of the video."""
    overview = seen.summary()
    overview["video"].pop("path")
    doubts = len(overview["warnings"])
    warned = f"; {doubts} warnings" if doubts else ""
    changing = deforming(seen)
    hint = f"; {', '.join(item.object for item in changing)} may be deformable" if changing else ""
    check = f"InspectFrames(case={case.id!r})"
    if changing:
        listed = ", ".join(f"{{object: {item.object!r}, kind: ...}}" for item in changing)
        check += f"; if it deforms, ObserveObjects(case={case.id!r}, deformable=[{listed}])"
    return Answer(
        summary=f"{len(seen.objects)} objects in {len(seen.frames)} frames: {', '.join(seen.names)}{hint}{warned}",
        data={
            **overview,
            **({"deforming": [item.to_dict() for item in changing]} if changing else {}),
            "next": f"{check}, then CalibrateCamera(case={case.id!r})",
        },
        case=case.id,
        observation=identifier,
        objects=seen.names,
    )
