"""From a video and what is known about it to a fitted world: observe, calibrate, match, build, fit, judge."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import Progress
from atw_mcp.calls.results import Answer
from atw_mcp.calls.steps import Step, StepFailed, Steps
from atw_mcp.fitting.errors import object_errors
from atw_mcp.fitting.video_report import MATCHING, VideoModel, failure_report, fit_report
from atw_mcp.observation.matching import Known, Matching, elevation_of, matched
from atw_mcp.observation.observing import derivation, latest_camera, latest_image_observation, modelled_tracks
from atw_mcp.perception.observation import ImageObservation, ObservedObject
from atw_mcp.perception.tracks import estimate_sizes
from atw_mcp.worlds.warnings import attachment_warnings
from evidence_store import Case, StoreError
from polyworld.world import MotionPlane, World
from polyworld.world.camera import Camera
from polyworld.world.geometry import equivalent_radius

SHARES = {"CalibrateCamera": 0.01, "ObserveObjects": 0.6, "BuildWorld": 0.62, "FitWorld": 0.98}
UNPLACED = 0.75  # of the frames that show a body, below which that its rays miss the floor is no matter of edges
ALIKE = 1.15  # ratio of sizes below which masks do not distinguish objects
MOVED = 0.5  # of its own size in the image, by which a track has moved


@dataclass(frozen=True)
class VideoRequest:
    """Known facts of a video, as arguments of the tools that use it.

    known: names, shapes and hints for the matching; bodies: what BuildWorld is given of each, by name. unlisted: what
    becomes of tracks that no known object explains. observe, calibrate: None where the case's own is used. looked_for:
    what ObserveObjects is asked to look for where tracks do not match what is known; None where that is not wanted.
    kept: which facts an earlier call gave, in words.
    """

    known: tuple[Known, ...]
    bodies: dict[str, dict[str, Any]]
    unlisted: Literal["leave_out", "model"]
    observe: dict[str, Any] | None
    calibrate: dict[str, Any] | None
    build: dict[str, Any]
    fit: dict[str, Any]
    looked_for: list[dict[str, Any]] | None = None
    plane: MotionPlane | None = None
    floor: float | None = None
    kept: str = ""


def model_video(app: App, case: Case, request: VideoRequest, progress: Progress) -> Answer:
    """Run the steps of World Modeling in order, each recorded as a call of its own tool, and judge the fitted world.

    A step that fails ends the work with status `failed`; the steps before it stay and are not repeated by a next call.
    """
    steps, model = Steps(app, progress, SHARES), VideoModel()
    try:
        names = _known_first(app, case, request, steps, model)
        if names is None:
            seen = _observe(app, case, request, steps)
            _calibrate(case, request, steps)
            names = _match(app, case, request, seen, steps, model, progress)
        building = _build_arguments(request, model, names)
        built = steps.call("BuildWorld", case=case.id, **building)
        names = [name for name in names if name in built.evidence.objects]
        fitted = steps.call("FitWorld", case=case.id, world=built.evidence.world, **_fit_arguments(request, names))
        _compare(app, case, fitted, model, progress)
        other = built.data.get("alternative_representation")
        if other is not None:
            fitted = _better(app, case, request, steps, model, fitted, {**building, "representation": other}, progress)
        world = app.world(case, fitted.evidence.world)
        model.doubts += [*_unplaced(app, case, world), *attachment_warnings(world)]
    except StepFailed as error:
        return failure_report(case, error, steps, model)
    return fit_report(app, case, fitted, steps, model, request.kept)


def _known_first(app: App, case: Case, request: VideoRequest, steps: Steps, model: VideoModel) -> list[str] | None:
    """Look for objects whose looks and sizes are given where nothing was observed yet; their names, or None.

    None where one of them is not found, or two are of one colour and shape, which materials may distinguish: then what
    is observed without a hint is matched to them.
    """
    looks = [(known.colour, repr(known.shape)) for known in request.known if known.pixel is None]
    camera = request.calibrate is not None or latest_camera(app, case) is not None
    if request.looked_for is None or request.observe is not None or not camera or len(set(looks)) < len(looks):
        return None
    if latest_image_observation(app, case) is not None:
        return None
    _calibrate(case, request, steps)
    found = _look_for(app, case, request, steps, model)
    if found is None or {item.name for item in request.known} - set(found.names):
        steps.call("ObserveObjects", case=case.id)
        return None
    model.matching = Matching((), (), (), found.names)
    return list(found.names)


def _calibrate(case: Case, request: VideoRequest, steps: Steps) -> None:
    if request.calibrate is not None and not any(step.tool == "CalibrateCamera" for step in steps.done):
        steps.call("CalibrateCamera", case=case.id, **request.calibrate)


def _observe(app: App, case: Case, request: VideoRequest, steps: Steps) -> ImageObservation:
    latest = latest_image_observation(app, case)
    narrow = request.unlisted == "model" and _was_looked_for(app, case)  # it has the listed objects alone
    if latest is None or request.observe is not None or narrow:
        steps.call("ObserveObjects", case=case.id, **(request.observe or {}))
        latest = latest_image_observation(app, case)
    if latest is None or not (latest[1].objects or request.looked_for):
        raise StepFailed("ObserveObjects", "no object was found in the video")
    return latest[1]


def _match(
    app: App,
    case: Case,
    request: VideoRequest,
    seen: ImageObservation,
    steps: Steps,
    model: VideoModel,
    progress: Progress,
) -> list[str]:
    """Match known objects to tracks and give the tracks their names; returns the names of the tracks to model.

    Where the match leaves doubts, the known objects are looked for by colour and size, and what that finds is modelled
    if it is not less than what was matched.
    """
    listed = {item.name for item in request.known}
    if not listed or (_was_looked_for(app, case) and set(seen.names) <= listed):
        return list(seen.names)
    model.matching = _matching(app, case, request, seen, progress)
    model.tracks = [_track_row(seen.object(name)) for name in model.matching.unlisted]
    if request.looked_for is not None and not model.matching.complete:
        found = _look_for(app, case, request, steps, model)
        if found is not None:
            unseen = tuple(item.name for item in request.known if item.name not in found.names)
            others = [seen.object(name) for name in model.matching.unlisted]
            model.tracks = [_track_row(track) for track in others if not _within(track, found)]
            model.matching = Matching((), unseen, (), found.names)
            return list(found.names)
    if not model.matching.matches:
        raise StepFailed(MATCHING, f"none of {', '.join(item.name for item in request.known)} fits a track")
    names = {match.track: match.known for match in model.matching.matches}
    renames = list(_renames(names, seen.names))
    if renames:
        steps.call("ObserveObjects", case=case.id, corrections=renames)
    if request.unlisted == "leave_out":
        return list(names.values())
    latest = latest_image_observation(app, case)
    return list(names.values()) if latest is None else list(latest[1].names)


def _matching(app: App, case: Case, request: VideoRequest, seen: ImageObservation, progress: Progress) -> Matching:
    """Assign the tracks of an observation to known objects; raises StepFailed where the camera does not allow it."""
    try:
        how = derivation(app, case, {}, request.plane, request.floor or 0.0)
        if how is None:
            raise StepFailed(MATCHING, "the case's latest tracks were imported: BuildWorld and FitWorld model those")
        camera = Camera.model_validate(app.store.observations.get(how.camera).document["camera"])
        estimates = estimate_sizes(
            seen,
            camera,
            how.plane,
            progress=lambda _, what: progress.note(progress.done, 1.0, what),
            cancelled=progress.cancelled,
        )
    except (ValueError, StoreError) as error:
        raise StepFailed(MATCHING, str(error)) from error
    return matched(request.known, seen.objects, estimates, elevation_of(camera))


def _was_looked_for(app: App, case: Case) -> bool:
    """Whether the latest observation, or the one that was corrected to it, looked for known objects."""
    latest = latest_image_observation(app, case)
    identifier = None if latest is None else latest[0]
    while identifier is not None:
        record = app.store.observations.get(identifier)
        if record.kind == "observe_known":
            return True
        base = record.inputs.get("observation")
        identifier = base if isinstance(base, str) else None
    return False


def _look_for(app: App, case: Case, request: VideoRequest, steps: Steps, model: VideoModel) -> ImageObservation | None:
    """Look for known objects; what is found if it is no less than was matched, else None and a doubt."""
    before = latest_image_observation(app, case)
    scene: dict[str, Any] = {} if request.floor is None else {"floor": request.floor}
    if request.plane is not None:
        scene["motion_plane"] = request.plane.model_dump(include={"point", "normal", "supports"})
    scene |= {"obstacles": request.build["obstacles"]} if request.build.get("obstacles") else {}
    least = 0 if model.matching is None else len(model.matching.matches)
    try:
        steps.call("ObserveObjects", case=case.id, known=request.looked_for, **scene)
    except StepFailed as error:
        model.doubts.append(f"objects could not be looked for by colour and size: {error.reason}")
        return None
    latest = latest_image_observation(app, case)
    found = () if latest is None else latest[1].names
    if latest is not None and len(found) >= max(least, 1):
        model.doubts += _look_alikes(request.known, found)
        return latest[1]
    model.doubts.append(f"looked for by colour and size, only {', '.join(found) or 'nothing'} was found")
    if before is not None:
        steps.call("ObserveObjects", case=case.id, observation=before[0])
    return None


def _look_alikes(known: tuple[Known, ...], found: tuple[str, ...]) -> Iterator[str]:
    """Yield doubts about objects of one colour and nearly one size, of which nobody said where they are."""
    free = [k for k in known if k.pixel is None and k.name in found]
    sizes = {k.name: equivalent_radius(k.shape) for k in free if k.shape is not None}
    for one, two in combinations([k for k in free if k.name in sizes], 2):
        small, large = sorted((sizes[one.name], sizes[two.name]))
        if one.colour == two.colour and large < ALIKE * small:
            yield (
                f"{one.name} and {two.name} have the same colour and size, so that either may be the other: give a "
                "pixel on one of them"
            )


def _renames(names: dict[str, str], tracks: tuple[str, ...]) -> Iterator[dict[str, str]]:
    """Yield corrections that rename tracks, by way of free names where one is taken by another track."""
    changed = {track: name for track, name in names.items() if track != name}
    taken = set(tracks) & set(changed.values())
    used = {*tracks, *changed.values()}
    aside: dict[str, str] = {}
    for track in tracks:
        if track in taken:
            free = next(f"{track}_{n}" for n in range(2, 1000) if f"{track}_{n}" not in used)
            used.add(free)
            aside[track] = free
            yield {"kind": "rename", "object": track, "name": free}
    for track, name in changed.items():
        yield {"kind": "rename", "object": aside.get(track, track), "name": name}


def _within(track: ObservedObject, found: ImageObservation) -> bool:
    """Whether the centroid of a track lies in the box of one of the objects found in most of its frames."""
    seen = np.isfinite(track.centroid).all(axis=1)
    for other in found.objects:
        left, top, width, height = other.box[seen].T
        u, v = track.centroid[seen].T
        if np.count_nonzero((left <= u) & (u <= left + width) & (top <= v) & (v <= top + height)) > 0.5 * len(u):
            return True
    return False


def _track_row(track: ObservedObject) -> dict[str, Any]:
    seen = np.isfinite(track.centroid).all(axis=1)
    extent = float(np.median(np.sqrt(track.area[seen]))) if seen.any() else 0.0
    moved = float(np.linalg.norm(np.ptp(track.centroid[seen], axis=0))) if seen.any() else 0.0
    about = track.summary()
    return {
        "track": track.name,
        "colour": about["colour"],
        "shape": about["shape"],
        "frames": int(seen.sum()),
        "moves": moved > MOVED * extent,
        "mean_confidence": about["mean_confidence"],
    }


def _build_arguments(request: VideoRequest, model: VideoModel, names: list[str]) -> dict[str, Any]:
    described = [name for name, body in request.bodies.items() if name in names or "position" in body]
    objects = []
    for name in described:
        fields = {key: value for key, value in request.bodies[name].items() if name not in names or key != "position"}
        objects.append({"name": name, **fields})
    chosen = {"only": names} if model.matching is not None else {}
    return {**({"objects": objects} if objects else {}), **chosen, **request.build}


def _fit_arguments(request: VideoRequest, names: list[str]) -> dict[str, Any]:
    """Arguments of FitWorld in which what is known of a body is not searched."""
    given = list(request.fit.get("parameters") or [])
    asked = {path for item in given if isinstance(item, dict) for path in item.get("paths", [])}
    for name in names:
        for key in ("mass", "friction", "restitution"):
            path = f"objects.{name}.{key}"
            if key in request.bodies.get(name, {}) and path not in asked:
                given.append({"paths": [path], "fixed": True})
    return {**request.fit, **({"parameters": given} if given else {})}


def _better(
    app: App,
    case: Case,
    request: VideoRequest,
    steps: Steps,
    model: VideoModel,
    fitted: Step,
    building: dict[str, Any],
    progress: Progress,
) -> Step:
    """Build and fit the world in its other, simpler representation; keep that unless it follows the video worse by more
    than a standard error, or if bodies roll in it, only where it follows better by as much: in a plane they lose their
    spin's part in collisions."""
    other = VideoModel()
    built = steps.call("BuildWorld", case=case.id, **building)
    names = list(fitted.evidence.objects)
    try:
        again = steps.call("FitWorld", case=case.id, world=built.evidence.world, **_fit_arguments(request, names))
    except StepFailed as error:
        model.doubts.append(f"a {building['representation']} world could not be fitted: {error.reason}")
        return fitted
    _compare(app, case, again, other, progress)
    share = 1.0 / np.sqrt(2.0 * max(sum(error.frames for error in model.errors), 1))  # of a root mean square
    ways = [(fitted, model), (again, other)]
    margin = 1.0 / (1.0 + share) if again.data["rolling"] == "rolls" else 1.0 + share
    if _misfit(other) <= margin * _misfit(model):
        ways.reverse()
    (kept, best), (left, least) = ways
    if least.diverged is None:
        model.other = (str(left.evidence.world), _misfit(least) / max(_misfit(best), 1e-9))
    model.errors, model.diverged = best.errors, best.diverged
    if kept.evidence.world is not None:  # which a commit takes by default
        app.store.cases.prefer_world(case.id, kept.evidence.world)
    return kept


def _misfit(model: VideoModel) -> float:
    """Root mean square error over objects, in units of their radii."""
    if model.diverged is not None:
        return float("inf")
    return float(np.sqrt(np.mean([(error.metres / error.radius) ** 2 for error in model.errors])))


def _compare(app: App, case: Case, fitted: Step, model: VideoModel, progress: Progress) -> None:
    world = app.world(case, fitted.evidence.world)
    first, last = fitted.data["fitted_frames"]
    try:
        model.errors = object_errors(app, world, modelled_tracks(app, case, world), (first, last), progress)
    except ValueError as error:
        model.diverged = str(error)


def _unplaced(app: App, case: Case, world: World) -> list[str]:
    """Doubts about objects that are seen in frames where their rays miss the plane they are taken to be on."""
    latest = latest_image_observation(app, case)
    tracks = modelled_tracks(app, case, world).tracks
    found = []
    for name in tracks.names:
        if latest is None or name not in latest[1].names:
            continue
        seen = int(np.isfinite(latest[1].object(name).centroid).all(axis=1).sum())
        placed = int(np.count_nonzero(tracks.confidence[:, tracks.index(name)] > 0.0))
        if placed < UNPLACED * seen:
            found.append(
                f"{name} has a place in {placed} of the {seen} frames that show it: it seems to leave the floor on "
                "which places are taken; give its shape and size, by which flights are recognised, or a motion_plane"
            )
    return found
