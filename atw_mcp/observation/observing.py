"""Observations of a case as the tools need them: the video, the camera, and the tracks a world is to model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import Progress
from atw_mcp.cases.cases import path_hash
from atw_mcp.observation.shape_records import ShapeRecord, latest_shapes, shapes_in_world
from atw_mcp.observation.track_records import TrackRecord, read_record, to_document
from atw_mcp.perception.calibration import Calibration
from atw_mcp.perception.depth_tracks import depth_tracks
from atw_mcp.perception.flight.placing import Surroundings, with_flights
from atw_mcp.perception.given_places import unplaced, with_given_places
from atw_mcp.perception.import_images import import_depth
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.observation import ObservedObject as SeenObject
from atw_mcp.perception.tracks import estimate_sizes, world_tracks
from atw_mcp.worlds.building import ObservedObject
from evidence_store import Case, Content
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane, World
from polyworld.world.camera import Camera
from polyworld.world.shapes import BodyShape, Box, Cylinder, Sphere

SIDE_VIEW = MotionPlane(point=(0.0, 0.0, 0.0), normal=(0.0, -1.0, 0.0), supports=False)
UNKNOWN_RATE = 0.04  # [s] between frames of a file that states no rate; BuildWorld says so


def video_file(app: App, case: Case) -> Path:
    """The case's video; raises ValueError where there is none, it may not be read, or it changed."""
    if case.kind != "video":
        raise ValueError(f"case {case.id!r} is measured data and has no video")
    path = app.files.film(case.path)
    parts = sorted(path.iterdir()) if path.is_dir() else [path]
    if _known_hash(path, tuple((str(p), p.stat().st_size, p.stat().st_mtime_ns) for p in parts)) != case.content:
        raise ValueError(
            f"{path} changed since case {case.id!r} was opened: OpenCase(video=PATH) with the original file, wherever "
            "it is now, continues the case"
        )
    return path


@lru_cache(maxsize=64)
def _known_hash(path: Path, facts: tuple[tuple[str, int, int], ...]) -> str:
    del facts  # only there so that a changed file is read again
    return path_hash(path)


def shown_times(case: Case) -> int:
    """How many times the case's video shows each picture before the next: each is looked at once."""
    return int(case.facts.get("shown_times", 1))


def moment_of(case: Case, frame: float) -> float:
    """When a frame of the case's video was taken, in units of seconds_per_frame; beyond it, frame by frame."""
    clock = case.facts.get("clock")
    if clock is None:
        return float(frame)
    near = min(max(frame, 0), len(clock) - 1)
    return float(np.interp(near, np.arange(len(clock)), clock)) + frame - near


# --- what was seen, in pixels ---


def keep_image_observation(
    app: App, case: Case, observation: ImageObservation, kind_of_work: str, inputs: dict[str, Any]
) -> Content:
    """Store what was seen and make it the case's latest."""
    document = {"names": list(observation.names), "observation": observation.to_dict()}
    with app.store.transaction():
        content = app.store.observations.put(kind_of_work, inputs, document)
        app.store.cases.add_observation(case.id, "objects", content.id)
    return content


def latest_image_observation(app: App, case: Case) -> tuple[str, ImageObservation] | None:
    """The latest observation of the video with its id, or None."""
    found = app.store.cases.observations(case.id, "objects")
    if not found:
        return None
    return found[0][1], image_observation(app.store.observations.get(found[0][1]))


def chosen_image_observation(app: App, case: Case, identifier: str | None) -> tuple[str, ImageObservation]:
    """An observation of the case's video with its id, default the latest; of tracks, the one they derive from.

    Raises ValueError naming the observations there are, latest first, or what to call where there is none."""
    known = [found for _, found in app.store.cases.observations(case.id, "objects")]
    if not known:
        raise ValueError(
            f"case {case.id!r} has no observation of its video yet. Next: ObserveObjects(case={case.id!r})"
        )
    if identifier is not None and identifier in (found for _, found in app.store.cases.observations(case.id, "tracks")):
        identifier = TrackRecord.of(app.store.observations.get(identifier)).source.get("objects", identifier)
    if identifier is not None and identifier not in known:
        raise ValueError(
            f"case {case.id!r} has no observation {identifier!r} of its video; its observations, latest first: {known}"
        )
    chosen = known[0] if identifier is None else identifier
    return chosen, image_observation(app.store.observations.get(chosen))


def image_observation(content: Content) -> ImageObservation:
    """The observation in a stored record."""
    return ImageObservation.from_dict(content.document["observation"])


# --- the camera ---


def keep_calibration(
    app: App, case: Case, calibration: Calibration, inputs: dict[str, Any], *, side_view: bool
) -> Content:
    """Store a camera and make it the case's latest. side_view: motion is in the plane y = 0, not on the floor."""
    with app.store.transaction():
        content = app.store.observations.put("camera", inputs, {**calibration.to_dict(), "side_view": side_view})
        app.store.cases.add_observation(case.id, "camera", content.id)
    return content


def latest_camera(app: App, case: Case) -> Camera | None:
    """The camera the case was last calibrated with, or None."""
    found = app.store.cases.observations(case.id, "camera")
    if not found:
        return None
    return Camera.model_validate(app.store.observations.get(found[0][1]).document["camera"])


def motion_plane_of(app: App, case: Case, floor: float = 0.0) -> MotionPlane:
    """The plane in which objects move: the floor, at z = `floor`, or y = 0 for a camera calibrated as a side view."""
    found = app.store.cases.observations(case.id, "camera")
    if found and app.store.observations.get(found[0][1]).document["side_view"]:
        return SIDE_VIEW
    return MotionPlane(point=(0.0, 0.0, floor))


# --- tracks in world coordinates ---


@dataclass(frozen=True)
class Derivation:
    """How world tracks follow from what was seen: observation, camera, plane of motion, and sizes that are known."""

    observation: str
    camera: str
    plane: MotionPlane
    solids: dict[str, Sphere | Box | Cylinder]
    seconds_per_frame: float
    depth: str | None = None
    shapes: str | None = None
    about: Surroundings | None = None

    def inputs(self) -> dict[str, Any]:
        """Return what determines the tracks."""
        return {
            "objects": self.observation,
            "camera": self.camera,
            "plane": self.plane.model_dump(mode="json"),
            "solids": {name: solid.model_dump(mode="json") for name, solid in sorted(self.solids.items())},
            "seconds_per_frame": self.seconds_per_frame,
            "depth": self.depth,
            **({} if self.shapes is None else {"shapes": self.shapes}),
            **({} if self.about is None else {"about": self.about.to_dict()}),
        }


def derivation(
    app: App,
    case: Case,
    solids: dict[str, Sphere | Box | Cylinder],
    plane: MotionPlane | None = None,
    floor: float = 0.0,
    observation: str | None = None,
    *,
    about: Surroundings | None = None,
    seconds_per_frame: float | None = None,
) -> Derivation | None:
    """How an observation of the case's video becomes tracks; None where it is the latest and imported tracks are newer.

    plane: where objects move (default: the floor, at z = `floor`, or y = 0 for a camera calibrated as a side view).
    observation: its id, default the latest. about: what bodies fly and move on; with it, known solids that leave the
    floor are placed where they are. seconds_per_frame [s]: default from the file's rate. Raises ValueError saying what
    is missing: an observation, or a camera.
    """
    if observation is not None:
        chosen_image_observation(app, case, observation)
    for kind, identifier in app.store.cases.observations(case.id):
        if observation is not None:
            identifier = observation
            break
        if kind == "tracks" and app.store.observations.get(identifier).document["source"]["kind"] == "imported":
            return None
        if kind == "objects":
            break
    else:
        step = f"ObserveObjects(case={case.id!r}) or " if case.kind == "video" else ""
        raise ValueError(_no_tracks(app, case, f"{step}ImportObservation(case={case.id!r})"))
    cameras = app.store.cases.observations(case.id, "camera")
    if not cameras:
        raise ValueError(
            f"case {case.id!r} has objects in pixels but no camera: CalibrateCamera(case={case.id!r}) places "
            "them in the world"
        )
    camera = app.store.observations.get(cameras[0][1])
    free = plane is None and not camera.document["side_view"]
    plane = plane or motion_plane_of(app, case, floor)
    rate = float(case.facts.get("frames_per_second") or 0.0)
    seen = app.store.observations.get(identifier).document["names"]
    known = {name: solid for name, solid in solids.items() if name in seen}
    depth = app.store.cases.observations(case.id, "depth")
    shapes = latest_shapes(app, case, identifier)
    return Derivation(
        identifier,
        camera.id,
        plane,
        known,
        seconds_per_frame or (1.0 / rate if rate > 0 else UNKNOWN_RATE),
        depth[0][1] if depth else None,
        None if shapes is None else shapes.id,
        about if free and known and not depth else None,
    )


def derived_tracks(app: App, case: Case, how: Derivation, progress: Progress | None) -> TrackRecord | None:
    """The tracks of a derivation, made the case's latest; without `progress` only where they are stored already."""
    found = app.store.observations.find("world_tracks", how.inputs())
    if found is None:
        if progress is None:
            return None
        found = app.store.observations.put("world_tracks", how.inputs(), _derive(app, how, progress))
    app.store.cases.add_observation(case.id, "tracks", found.id)
    return TrackRecord.of(found)


def _derive(app: App, how: Derivation, progress: Progress) -> dict[str, Any]:
    seen = image_observation(app.store.observations.get(how.observation))
    camera = Camera.model_validate(app.store.observations.get(how.camera).document["camera"])

    if how.depth is not None:
        return _derive_from_depth(app, how, seen, camera, progress)

    def reporter(begin: float) -> Callable[[float, str], None]:
        return lambda share, what: progress.report(begin + 0.5 * share, 1.0, what)

    known = {} if seen.scene is None else {n: s for n, s in seen.scene.solids.items() if n in seen.names}
    others = [name for name in seen.names if name not in known]
    estimates = estimate_sizes(
        seen, camera, how.plane, only=others, progress=reporter(0.0), cancelled=progress.cancelled
    )
    solids = {**{name: found.solid for name, found in estimates.items()}, **known, **how.solids}
    tracks = world_tracks(
        seen,
        camera,
        solids,
        how.plane,
        seconds_per_frame=how.seconds_per_frame,
        progress=reporter(0.5),
        cancelled=progress.cancelled,
    )
    sizes = {name: found.to_dict() for name, found in estimates.items()}
    source: dict[str, Any] = {"kind": "derived", "objects": how.observation, "camera": how.camera, "sizes": sizes}
    motions: dict[str, Any] = {}
    if how.about is not None:
        tracks, motions = with_flights(tracks, seen, camera, how.solids, how.about, progress.cancelled)
        source["motions"] = motions
    tracks = with_given_places(tracks, seen)
    source["unplaced"] = unplaced(tracks, seen)
    tracks, source = _with_shapes(app, how, camera, tracks, source)
    objects = [_looks(item, solids.get(item.name)) for item in seen.objects if item.name in tracks.names]
    return to_document(tracks, objects, heights_assumed=not motions, source=source, plane=how.plane)


def _with_shapes(
    app: App, how: Derivation, camera: Camera, tracks: ObservedTracks, source: dict[str, Any]
) -> tuple[ObservedTracks, dict[str, Any]]:
    """Tracks with the measured shapes; of what was said to be a rope, cloth or fluid, with the shapes alone."""
    if how.shapes is None:
        return tracks, source
    record = ShapeRecord.of(app.store.observations.get(how.shapes))
    solid = [n for n in tracks.names if n not in record.declared or record.kinds[n] == "soft"]
    shapes = shapes_in_world(record.series, camera, how.plane)
    return tracks.select(solid).with_shapes(shapes, record.frames), {**source, "shapes": how.shapes}


def _derive_from_depth(
    app: App, how: Derivation, seen: ImageObservation, camera: Camera, progress: Progress
) -> dict[str, Any]:
    assert how.depth is not None
    kept = app.store.observations.get(how.depth)
    with app.files.opened(kept.document["path"]) as path:
        if path_hash(path) != kept.inputs["file"]:
            raise ValueError(f"the depth maps {path.name} changed: import them again")
        depth = import_depth(path, metres_per_unit=kept.inputs["metres_per_unit"])
    tracks, shapes = depth_tracks(
        seen,
        camera,
        depth,
        how.solids,
        seconds_per_frame=how.seconds_per_frame,
        progress=lambda share, what: progress.report(share, 1.0, what),
        cancelled=progress.cancelled,
    )
    source: dict[str, Any] = {"kind": "derived", "objects": how.observation, "camera": how.camera, "depth": how.depth}
    tracks = with_given_places(tracks, seen)
    tracks, source = _with_shapes(app, how, camera, tracks, source)
    objects = [_looks(item, shapes.get(item.name)) for item in seen.objects if item.name in tracks.names]
    return to_document(tracks, objects, heights_assumed=False, source=source)


def _looks(seen: SeenObject, shape: BodyShape | None) -> ObservedObject:
    return ObservedObject(seen.name, shape, _named(seen.colour.name), _named(seen.material.name))


def _named(cue: str) -> str | None:
    return None if cue == "unknown" else cue


def tracks_of_observation(app: App, case: Case, observation: str) -> TrackRecord | None:
    """The latest tracks derived from an observation of the video; None where none were yet."""
    for _, identifier in app.store.cases.observations(case.id, "tracks"):
        record = TrackRecord.of(app.store.observations.get(identifier))
        if record.source.get("objects") == observation:
            return record
    return None


def _no_tracks(app: App, case: Case, step: str) -> str:
    """Say that a case has no tracks, and what there is to do with a recording where it has one."""
    if not app.store.cases.observations(case.id, "recording"):
        return f"case {case.id!r} has no tracks yet. Next: {step}"
    return (
        f"case {case.id!r} has a recording and no tracks: there BuildWorld takes objects with name, shape and "
        "position, FindDiscrepancy and ProposeEffects fit recordings, FitWorld and the other tools need tracks. Next: "
        f"BuildWorld(case={case.id!r}, objects=[...]), or ImportObservation(case={case.id!r}, kind='tracks')"
    )


def track_record(app: App, case: Case, identifier: str | None) -> TrackRecord:
    """The track record asked for, else the latest of the case; raises ValueError naming the records there are."""
    record = read_record(app.store, case, identifier)
    if record is None:
        raise ValueError(_no_tracks(app, case, f"ImportObservation(case={case.id!r})"))
    return record


def modelled_tracks(app: App, case: Case, world: World) -> TrackRecord:
    """The track record that a world of the case models, else the case's latest."""
    return track_record(app, case, app.store.cases.modelled_observation(case.id, world.id))
