"""Observations made elsewhere: read once, kept by content, and made the case's latest of their kind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from atw_mcp.calls.app import App
from atw_mcp.calls.results import validation_text
from atw_mcp.cases.cases import path_hash
from atw_mcp.observation.observing import SIDE_VIEW, keep_calibration, keep_image_observation, video_file
from atw_mcp.observation.recording_records import READER
from atw_mcp.observation.track_records import TrackRecord, at_rate, read_record, to_document
from atw_mcp.perception.calibration import Calibration
from atw_mcp.perception.import_files import ImportDataError, read_json
from atw_mcp.perception.import_images import import_camera, import_depth, import_masks, import_mesh
from atw_mcp.perception.import_shapes import ImportedShapes, PointsAre, import_points, import_series
from atw_mcp.perception.import_tracks import clevrer_appearances, import_tracks
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.worlds.building import ObservedObject
from evidence_store import Case, Content
from polyworld.data.recording_header import RecordingForm
from polyworld.data.tracks import ObservedTracks, shapes_only
from polyworld.world.shapes import BodyShape, Box, Cylinder, Sphere

OFF_FRAME = 0.05  # [frames] by which times of shapes may miss those of the tracks: rounding, and no motion
_SHAPE: TypeAdapter[Any] = TypeAdapter(BodyShape)


# --- tracks ---


def keep_tracks(
    app: App, case: Case, path: Path, form: RecordingForm, position_sigma: float | None
) -> tuple[TrackRecord, tuple[str, ...]]:
    """Tracks in world coordinates, with what the file says about its objects, and what was not taken from it."""
    inputs = {
        "file": path_hash(path),
        "columns": dict(form.columns),
        "seconds_per_frame": form.seconds_per_frame,
        "position_sigma": position_sigma,
        "reader": READER,
    }
    found = import_tracks(path, form, position_sigma=position_sigma)
    tracks = found.tracks
    if form.seconds_per_frame is not None:
        tracks = at_rate(tracks, form.seconds_per_frame)  # also where the file states another rate
    document = to_document(
        tracks,
        objects_of(path, tracks),
        heights_assumed=bool(found.unmeasured),
        source={"kind": "imported", "file": path.name, "sha256": inputs["file"]},
        plane=SIDE_VIEW if found.unmeasured == "y" else None,
    )
    with app.store.transaction():
        content = app.store.observations.put("imported_tracks", inputs, document)
        app.store.cases.add_observation(case.id, "tracks", content.id)
    return TrackRecord.of(content), found.remarks


def keep_points(
    app: App,
    case: Case,
    path: Path,
    points_are: PointsAre,
    form: RecordingForm,
    position_sigma: float | None,
) -> tuple[TrackRecord, ImportedShapes]:
    """Points of deformable objects, added to the case's latest tracks, or alone."""
    base = read_record(app.store, case)
    step = form.seconds_per_frame if base is None else base.tracks.seconds_per_frame
    found = import_points(
        path, points_are=points_are, columns=form.columns, seconds_per_frame=step, position_sigma=position_sigma
    )
    inputs = {"points": path_hash(path), "points_are": points_are, "position_sigma": position_sigma}
    return _add_shapes(app, case, base, path, found, inputs, form), found


def keep_series(
    app: App, case: Case, path: Path, form: RecordingForm, value_sigma: float | None
) -> tuple[TrackRecord, ImportedShapes]:
    """Scalar series of deformable objects, added to the case's latest tracks, or alone."""
    base = read_record(app.store, case)
    step = form.seconds_per_frame if base is None else base.tracks.seconds_per_frame
    found = import_series(path, columns=form.columns, seconds_per_frame=step, sigma=value_sigma)
    inputs = {"series": path_hash(path), "value_sigma": value_sigma}
    return _add_shapes(app, case, base, path, found, inputs, form), found


def _add_shapes(
    app: App,
    case: Case,
    base: TrackRecord | None,
    path: Path,
    found: ImportedShapes,
    inputs: dict[str, Any],
    form: RecordingForm,
) -> TrackRecord:
    if base is None:
        clock = None if np.array_equal(found.clock, found.frames) else found.clock
        tracks = shapes_only(found.series, found.frames, found.seconds_per_frame, clock)
    else:
        rate, stated = base.tracks.seconds_per_frame, form.seconds_per_frame
        there = np.array([base.tracks.time_of(int(f)) / rate for f in found.frames])
        apart = found.clock - (found.frames if np.array_equal(found.clock, found.frames) else there)
        off = float(np.abs(apart).max(initial=0.0))
        if off > OFF_FRAME or np.any(np.diff(found.frames) < 1) or abs((stated or rate) / rate - 1.0) > 1e-9:
            own = (
                f"times {off * rate:.3g} s off the frames of" if stated is None else f"{stated:.6g} s per frame, unlike"
            )
            raise ImportDataError(
                f"{path.name} has {own} the tracks {base.id} that it joins, which have {rate:.6g} s per frame: import "
                "it with frame numbers, or with times that fall on those frames"
            )
        tracks = base.tracks.with_shapes(found.series, found.frames)
    joined = {**inputs, "base": None if base is None else base.id, "seconds_per_frame": form.seconds_per_frame}
    joined |= {"columns": dict(form.columns), "reader": READER}
    document = to_document(
        tracks,
        () if base is None else base.objects,
        heights_assumed=base is not None and base.heights_assumed,
        source={"kind": "imported", "file": path.name, "base": joined["base"]},
        plane=None if base is None else base.plane,
    )
    with app.store.transaction():
        content = app.store.observations.put("imported_shapes", joined, document)
        app.store.cases.add_observation(case.id, "tracks", content.id)
    return TrackRecord.of(content)


def objects_of(path: Path, tracks: ObservedTracks) -> list[ObservedObject]:
    """Shape, colour and material of the tracked objects, where the file gives them.

    A JSON file may list "objects": [{"name", "shape", "color", "material"}], shapes as in a world. CLEVRER
    annotations name kinds but no sizes: their objects stand on the floor, so the height of the centre is half
    the size.
    """
    plain = [ObservedObject(name) for name in tracks.names]
    if path.suffix.lower() != ".json":
        return plain
    data = read_json(path)
    if isinstance(data, dict) and "object_property" in data:
        looks = clevrer_appearances(path)
        found = []
        for name in tracks.names:
            look, kind = looks[name]
            heights = tracks.positions[tracks.confidence[:, tracks.index(name)] > 0, tracks.index(name), 2]
            shape = _standing(kind, round(float(np.median(heights)), 2)) if len(heights) else None
            found.append(ObservedObject(name, shape, look.color, look.material))
        return found
    listed = data.get("objects") if isinstance(data, dict) else None
    if not isinstance(listed, list):
        return plain
    said = {item["name"]: item for item in listed if isinstance(item, dict) and "name" in item}
    unknown = sorted(set(said) - set(tracks.names))
    if unknown:
        raise ImportDataError(f"{path.name}: objects {unknown} have no track; tracks: {list(tracks.names)}")
    return [_listed(path, said.get(name, {"name": name})) for name in tracks.names]


def _listed(path: Path, item: dict[str, Any]) -> ObservedObject:
    try:
        shape = None if item.get("shape") is None else _SHAPE.validate_python(item["shape"])
    except ValidationError as error:
        raise ImportDataError(f"{path.name}: shape of {item['name']!r}: {validation_text(error)}") from error
    return ObservedObject(item["name"], shape, item.get("color"), item.get("material"))


def _standing(kind: str, half: float) -> Sphere | Box | Cylinder:
    if kind == "sphere":
        return Sphere(radius=half)
    if kind == "cylinder":
        return Cylinder(radius=half, half_height=half)
    return Box(half_extents=(half, half, half))


# --- the rest ---


def keep_masks(app: App, case: Case, path: Path) -> tuple[str, ImageObservation]:
    """Masks of the case's video."""
    seen = import_masks(path, video_file(app, case))
    inputs = {"video": case.content, "masks": path_hash(path)}
    return keep_image_observation(app, case, seen, "imported_masks", inputs).id, seen


def keep_camera(app: App, case: Case, path: Path, size: tuple[int, int] | None) -> tuple[str, Calibration]:
    """A camera, as if calibrated here."""
    camera = import_camera(path, size)
    if size is not None and (camera.width, camera.height) != size:
        raise ImportDataError(
            f"{path.name} is for {camera.width} x {camera.height}, the video is {size[0]} x {size[1]}"
        )
    made = Calibration(camera, (), None, f"imported from {path.name}")
    content = keep_calibration(app, case, made, {"file": path_hash(path), "size": size}, side_view=False)
    return content.id, made


def keep_depth(app: App, case: Case, path: Path, metres_per_unit: float | None, origin: Path) -> Content:
    """Depth maps: kept by reference to where they are from, since they are far larger than everything else."""
    depth = import_depth(path, metres_per_unit=metres_per_unit)
    inputs = {"file": path_hash(path), "metres_per_unit": metres_per_unit}
    known = np.isfinite(depth.depth)
    document = {
        "path": str(origin),
        "frames": list(depth.frames),
        "height": int(depth.depth.shape[1]),
        "width": int(depth.depth.shape[2]),
        "known_share": float(known.mean()),
        "nearest": float(np.nanmin(depth.depth)) if known.any() else None,
        "farthest": float(np.nanmax(depth.depth)) if known.any() else None,
    }
    return _keep(app, case, "depth", inputs, document)


def keep_mesh(app: App, case: Case, path: Path, scale: float) -> Content:
    """A triangle mesh, for the shape of an object or of an obstacle."""
    mesh = import_mesh(path, scale=scale)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    document = {
        "file": path.name,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "watertight": mesh.watertight,
        "lower": low.tolist(),
        "upper": high.tolist(),
    }
    inputs = {"file": path_hash(path), "scale": scale}
    return _keep(app, case, "mesh", inputs, document, {"vertices": mesh.vertices, "faces": mesh.faces})


def mesh_of(app: App, case: Case, identifier: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (k, 3) [m] and faces (m, 3) of a mesh of the case; raises ValueError naming the meshes it has."""
    known = [mesh for _, mesh in app.store.cases.observations(case.id, "mesh")]
    if identifier not in known:
        step = f"ImportObservation(case={case.id!r}, kind='mesh', path=...)"
        raise ValueError(f"case {case.id!r} has no mesh {identifier!r}; its meshes: {known}. Next: {step}")
    arrays = app.store.observations.get(identifier).arrays
    return arrays["vertices"], arrays["faces"]


def _keep(
    app: App, case: Case, kind: str, inputs: dict[str, Any], document: dict[str, Any], arrays: Any = None
) -> Content:
    with app.store.transaction():
        content = app.store.observations.put(kind, inputs, document, arrays)
        app.store.cases.add_observation(case.id, kind, content.id)
    return content
