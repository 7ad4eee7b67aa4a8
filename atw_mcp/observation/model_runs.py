"""Runs of learned models on a case: what goes in, what is kept of it and with which provenance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import Progress
from atw_mcp.models import (
    ModelError,
    Prompt,
    Provenance,
    camera_over_floor,
    follow,
    follow_points,
    intrinsics_of,
    poses,
    predict_depth,
    prompts_from,
    queries_on,
    rotations,
)
from atw_mcp.models.folders import Task
from atw_mcp.observation.importing import keep_depth, mesh_of
from atw_mcp.observation.mesh_runs import prepare_mesh
from atw_mcp.observation.observing import (
    derivation,
    derived_tracks,
    image_observation,
    keep_calibration,
    latest_camera,
    latest_image_observation,
    track_record,
    video_file,
)
from atw_mcp.observation.run_requests import (
    Prepared,
    RunOutcome,
    RunRequest,
    asked_names,
    callbacks_of,
    frames_of,
    inputs_of,
    latest_observed,
    masks_by_others,
    stride_of,
)
from atw_mcp.observation.track_records import TrackRecord, to_document
from atw_mcp.perception.agreement import agreement, by_agreement
from atw_mcp.perception.calibration import CalibrationError
from atw_mcp.perception.masks import Mask
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.video import load
from atw_mcp.worlds.building import ObservedObject
from atw_mcp.worlds.heights import hull_vertices
from evidence_store import Case, Content
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.shapes import BodyShape, ConvexMesh


def prepare(app: App, case: Case, request: RunRequest) -> Prepared:
    """Check a run against its case; raises ModelError or ValueError saying what is missing and how to get it."""
    if request.use == "agreement" and request.model.task != "segmentation":
        raise ModelError(f"use='agreement' compares masks; {request.model.name} gives {request.model.task}")
    if request.prompts and request.model.task != "segmentation":
        raise ModelError(f"prompts are for segmentation; {request.model.name} gives {request.model.task}")
    makers: dict[Task, Callable[[App, Case, RunRequest], Prepared]] = {
        "segmentation": _segmentation,
        "points": _points,
        "depth": _depth,
        "pose": _pose,
        "mesh": prepare_mesh,
    }
    return makers[request.model.task](app, case, request)


# --- masks ---


def _segmentation(app: App, case: Case, request: RunRequest) -> Prepared:
    latest = masks_by_others(app, case, request.model)
    if not request.prompts and latest is None:
        raise ModelError(
            f"{request.model.name} follows what it is shown: give prompts, or let "
            f"ObserveObjects(case={case.id!r}) find the objects first"
        )
    if request.use == "agreement" and latest is None:
        raise ModelError(f"there is no observation to agree with: ObserveObjects(case={case.id!r}) first")
    prompts = request.prompts
    stride = request.stride
    if not prompts:
        assert latest is not None
        seen = latest[1]
        stride = stride_of(seen)
        only = [item.name for item in request.objects] or None
        prompts = tuple(
            Prompt(p.object, seen.frames[p.row], p.box, p.positive, p.negative) for p in prompts_from(seen, only)
        )
    off = sorted({p.row for p in prompts if p.row % stride})
    if off:
        raise ModelError(f"with stride {stride} frames {off} are not looked at: prompt in multiples of {stride}")
    inputs = {
        **inputs_of(case, request),
        "prompts": [vars(p) for p in prompts],
        "stride": stride,
        "against": None if latest is None else latest[0],
        "use": request.use,
    }
    return Prepared("model_masks", inputs, partial(_segment, app, case, request, prompts, stride, latest, inputs))


def _segment(
    app: App,
    case: Case,
    request: RunRequest,
    prompts: tuple[Prompt, ...],
    stride: int,
    latest: tuple[str, ImageObservation] | None,
    inputs: dict[str, Any],
    progress: Progress,
) -> RunOutcome:
    kept = app.store.observations.find("model_masks", inputs)
    if kept is None:
        info, frames = load(video_file(app, case), stride=stride)
        rows = tuple(Prompt(p.object, p.row // stride, p.box, p.positive, p.negative) for p in prompts)
        found = follow(request.model, frames, rows, request.limits, **callbacks_of(progress))
        seen = found.observation(info, frames, tuple(range(0, stride * len(frames), stride)))
        rated = None if latest is None else agreement(seen, latest[1], frames)
        if request.use == "agreement" and latest is not None:
            seen, rated = by_agreement(seen, latest[1], frames, [p.object for p in prompts])
        document = {
            "names": list(seen.names),
            "observation": seen.to_dict(),
            "model": found.provenance.to_dict(),
            "agreement": None if rated is None or latest is None else [item.to_dict() for item in rated],
        }
        kept = app.store.observations.put("model_masks", inputs, document)
    if request.use != "report":
        app.store.cases.add_observation(case.id, "objects", kept.id)
    seen = image_observation(kept)
    doubtful = [
        r["first"] for r in kept.document["agreement"] or [] if r["first"] and r["second"] and r["mean_iou"] < 0.7
    ]
    compared = "" if latest is None else f"; compared with {latest[0]}"
    doubts = f"; the two disagree about {', '.join(doubtful)}" if doubtful else ""
    overview = seen.summary()
    overview.pop("video")
    return RunOutcome(
        kept.id,
        f"{request.model.name} followed {', '.join(seen.names) or 'nothing'} through {len(seen.frames)} frames"
        f"{compared}{doubts}",
        {
            **overview,
            "made_with": kept.document["model"],
            **({} if latest is None else {"first": kept.id, "second": latest[0]}),
            **({} if kept.document["agreement"] is None else {"agreement": kept.document["agreement"]}),
            "next": f"InspectFrames(case={case.id!r}), then CalibrateCamera(case={case.id!r})"
            if request.use != "report"
            else "the same with use='model' or use='agreement' makes it the case's observation",
        },
        seen.names,
    )


# --- depth ---


def _depth(app: App, case: Case, request: RunRequest) -> Prepared:
    inputs = {**inputs_of(case, request), "stride": request.stride}
    return Prepared("model_depth", inputs, partial(_measure_depth, app, case, request, inputs))


def _measure_depth(app: App, case: Case, request: RunRequest, inputs: dict[str, Any], progress: Progress) -> RunOutcome:
    info, frames = load(video_file(app, case), stride=request.stride)
    numbers = range(0, request.stride * len(frames), request.stride)
    found = predict_depth(request.model, frames, numbers, request.limits, **callbacks_of(progress))
    camera = latest_camera(app, case)
    focal = None if found.focal is None else float(np.median(found.focal))
    latest = latest_image_observation(app, case)
    objects = None if latest is None else _ever(latest[1])
    data: dict[str, Any] = {
        "made_with": found.provenance.to_dict(),
        "nearest": float(np.nanmin(found.depth.depth)),
        "farthest": float(np.nanmax(found.depth.depth)),
    }
    summary = [f"{request.model.name}: depth of {len(frames)} frames"]
    if found.focal is not None and focal is not None:
        data["focal_length"] = {"pixels": focal, "spread": float(np.std(found.focal) / focal)}
        data["intrinsics"] = intrinsics_of(focal, (info.width, info.height)).tolist()
        summary.append(f"focal length {focal:.0f} px")
    if camera is not None:
        data["scale"] = scale_hint(found.depth.depth, camera, objects)
        summary.append(f"its metres are {data['scale']['ratio']:.3g} of the case's on the floor")
    elif focal is not None:
        try:
            made = camera_over_floor(found.depth, focal, objects)
        except CalibrationError as error:
            data["no_camera"] = str(error)
        else:
            data["camera"] = made.to_dict()["camera"]
            data["warnings"] = list(made.warnings)
            summary.append(f"camera {made.camera.centre[2]:.3g} m above the floor it sees")
            if request.use == "model":
                data["camera_kept"] = keep_calibration(app, case, made, inputs, side_view=False).id
    if request.use == "model":
        folder = app.derived_files
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"{app.store.observations.key('model_depth', inputs)}.npz"
        np.savez(file, depth=found.depth.depth, frames=np.asarray(found.depth.frames))
        kept = keep_depth(app, case, file, None, file)
        data["depth"] = kept.id
    else:
        document = {k: v for k, v in data.items() if k != "camera_kept"}
        kept = app.store.observations.put("model_depth", inputs, document)
    data["next"] = (
        f"BuildWorld(case={case.id!r}) takes positions from depth"
        if camera is not None or "camera_kept" in data
        else f"CalibrateCamera(case={case.id!r}, points=[...]{', intrinsics=...' if focal is not None else ''})"
    )
    return RunOutcome(kept.id, "; ".join(summary), data)


def scale_hint(depth: np.ndarray[Any, np.dtype[np.float32]], camera: Camera, objects: Mask | None) -> dict[str, float]:
    """Predicted depth over that of the floor z = 0 in a camera: median ratio over pixels, and its relative spread."""
    v, u = np.mgrid[0 : camera.height : 4, 0 : camera.width : 4]
    floor = camera.onto_plane(np.stack([u, v], axis=-1).astype(float), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    expected = camera.to_camera(floor)[..., 2]
    ratio = np.nanmedian(depth[:, ::4, ::4], axis=0) / expected
    usable = np.isfinite(ratio) & (expected > 0)
    if objects is not None:
        usable &= ~objects[::4, ::4]
    if not usable.any():
        raise ModelError("the camera of the case sees no floor to compare the depth with")
    middle = float(np.median(ratio[usable]))
    return {"ratio": middle, "spread": float(1.4826 * np.median(np.abs(ratio[usable] - middle)) / middle)}


def _ever(seen: ImageObservation) -> Mask:
    """Pixels in which an object is seen in any frame."""
    covered = np.zeros((seen.video.height, seen.video.width), dtype=bool)
    for item in seen.objects:
        for stored in item.masks:
            if stored is not None:
                covered |= stored.decode()
    return covered


# --- tracks: points and poses ---


def _points(app: App, case: Case, request: RunRequest) -> Prepared:
    identifier, seen = latest_observed(app, case, request)
    inputs = {**inputs_of(case, request), "observation": identifier, "objects": asked_names(request, seen)}
    return Prepared("model_tracks", inputs, partial(_turn, app, case, request, seen, inputs))


def _turn(
    app: App, case: Case, request: RunRequest, seen: ImageObservation, inputs: dict[str, Any], progress: Progress
) -> RunOutcome:
    record, camera = _tracked(app, case, progress)
    frames = frames_of(app, case, seen)
    names = [name for name in inputs["objects"] if name in record.tracks.names]
    queries = queries_on(seen, frames, names)
    found = follow_points(request.model, frames, queries, request.limits, **callbacks_of(progress))
    common = [f for f in record.tracks.frames if int(f) in set(seen.frames)]
    if len(common) != len(record.tracks.frames) or len(seen.frames) != len(common):
        raise ObservationError("the tracks and the observation are of different frames: observe with the same stride")
    shapes = {item.name: item.shape for item in record.objects}
    tracks = rotations(found, record.tracks, camera, shapes, record.plane or MotionPlane())
    turned = [n for n in names if (tracks.orientation_confidence[:, tracks.index(n)] > 0).any()]
    seen_in = {n: int((tracks.orientation_confidence[:, tracks.index(n)] > 0).sum()) for n in turned}
    kept = _keep_tracks(app, case, request, inputs, tracks, record, found.provenance)
    return RunOutcome(
        kept.id,
        f"{request.model.name} followed {len(queries)} points; orientations of {', '.join(turned) or 'nothing'}",
        {
            "tracks": kept.id,
            "made_with": found.provenance.to_dict(),
            "points": {n: sum(q.object == n for q in queries) for n in names},
            "frames_with_orientation": seen_in,
            "next": f"BuildWorld(case={case.id!r})",
        },
        tuple(turned),
    )


def _pose(app: App, case: Case, request: RunRequest) -> Prepared:
    identifier, seen = latest_observed(app, case, request)
    inputs = {
        **inputs_of(case, request),
        "observation": identifier,
        "objects": asked_names(request, seen),
        "meshes": {o.name: o.mesh for o in request.objects},
    }
    return Prepared("model_tracks", inputs, partial(_place, app, case, request, seen, inputs))


def _place(
    app: App, case: Case, request: RunRequest, seen: ImageObservation, inputs: dict[str, Any], progress: Progress
) -> RunOutcome:
    record, camera = _tracked(app, case, progress)
    shapes: dict[str, BodyShape] = {o.name: o.shape for o in record.objects if o.shape is not None}
    for item in request.objects:
        if item.mesh is not None:
            shapes[item.name] = ConvexMesh(vertices=hull_vertices(mesh_of(app, case, item.mesh)[0]))
    asked = {name: shapes[name] for name in inputs["objects"] if name in shapes}
    if not asked:
        raise ModelError("a pose needs the object's shape: give objects=[{name, mesh}], or build the world first")
    step = record.tracks.seconds_per_frame
    frames = frames_of(app, case, seen)
    tracks = poses(request.model, seen, frames, camera, asked, step, request.limits, **callbacks_of(progress))
    looks = {o.name: o for o in record.objects}
    objects = [
        ObservedObject(
            name, shape, looks[name].color if name in looks else None, looks[name].material if name in looks else None
        )
        for name, shape in asked.items()
    ]
    provenance = Provenance(request.model, request.limits.device, request.limits.batch)
    kept = _keep_tracks(app, case, request, inputs, tracks, None, provenance, objects)
    placed = {n: int((tracks.confidence[:, tracks.index(n)] > 0).sum()) for n in asked}
    return RunOutcome(
        kept.id,
        f"{request.model.name}: poses of {', '.join(asked)}",
        {
            "tracks": kept.id,
            "made_with": provenance.to_dict(),
            "frames_with_pose": placed,
            "next": f"BuildWorld(case={case.id!r})",
        },
        tuple(asked),
    )


def _tracked(app: App, case: Case, progress: Progress) -> tuple[TrackRecord, Camera]:
    camera = latest_camera(app, case)
    if camera is None:
        raise ModelError(f"case {case.id!r} has no camera: CalibrateCamera(case={case.id!r}) first")
    how = derivation(app, case, {})
    record = track_record(app, case, None) if how is None else derived_tracks(app, case, how, progress)
    assert record is not None
    return record, camera


def _keep_tracks(
    app: App,
    case: Case,
    request: RunRequest,
    inputs: dict[str, Any],
    tracks: ObservedTracks,
    record: TrackRecord | None,
    provenance: Provenance,
    objects: Sequence[ObservedObject] = (),
) -> Content:
    base = None if record is None else record.id
    document = to_document(
        tracks,
        objects if record is None else record.objects,
        heights_assumed=record is not None and record.heights_assumed,
        source={"kind": "imported", "base": base, "model": provenance.to_dict()},
        plane=None if record is None else record.plane,
    )
    with app.store.transaction():
        kept = app.store.observations.put("model_tracks", {**inputs, "base": base}, document)
        if request.use != "report":
            app.store.cases.add_observation(case.id, "tracks", kept.id)
    return kept


# --- meshes ---
