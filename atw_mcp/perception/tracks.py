"""From masks to motion in the world: the pose of each solid whose silhouette matches its mask, by the eye's own fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye import Solid
from atw_mcp.perception.eye.silhouette import Fit
from atw_mcp.perception.known_scene import Sized, same_plane, solid_body
from atw_mcp.perception.lying import lies_better
from atw_mcp.perception.mask_scene import MaskScene
from atw_mcp.perception.observation import ImageObservation, ObservationError, check_camera
from atw_mcp.perception.places import Places, places_of, with_places
from atw_mcp.perception.sizes import SolidEstimate, SolidKind, estimate_size
from atw_mcp.perception.video import Cancelled, Progress, report
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.shapes import Cylinder

Floats = NDArray[np.float64]

SHOWN = 0.28  # share of a silhouette's normals whose edges are seen, below which they do not fix a pose: 100 degrees
AGAIN = 1.5  # times the misfit of the frame before, from which on a box is tried at all angles
DEFAULT_PLANE = MotionPlane()


def estimate_sizes(
    observation: ImageObservation,
    camera: Camera,
    plane: MotionPlane = DEFAULT_PLANE,
    *,
    kinds: Mapping[str, SolidKind] | None = None,
    only: Sequence[str] | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> dict[str, SolidEstimate]:
    """Return the solid each object is: kind (unless given in `kinds`) and dimensions, from its outline in many frames.

    Objects stand on `plane`, or move with their centres in it when it does not support them. only: names of those to
    estimate, default all. An object with too few frames for an estimate is left out of the result. A cube is a box
    whose edges are equal.
    """
    check_camera(camera, observation.video)
    for name, kind in (kinds or {}).items():
        observation.object(name)
        if kind not in ("sphere", "cylinder", "cube", "box"):
            raise ObservationError(f"unknown kind {kind!r} of {name!r}; kinds: sphere, cylinder, cube, box")
    result = {}
    for number, observed in enumerate(observation.objects):
        name = observed.name
        if only is not None and name not in only:
            continue
        report(progress, cancelled, number / len(observation.objects), f"size of {name}")
        options: tuple[SolidKind, ...] = ("sphere", "cylinder", "cube")
        if observed.shape.name == "box":
            options = ("sphere", "cylinder", "cube", "box")
        if kinds is not None and name in kinds:
            options = (kinds[name],)
        found = estimate_size(observation, name, camera, plane, options)
        if found is not None:
            result[name] = found
    return result


def world_tracks(
    observation: ImageObservation,
    camera: Camera,
    solids: Mapping[str, Sized] | None = None,
    plane: MotionPlane = DEFAULT_PLANE,
    *,
    seconds_per_frame: float,
    only: Sequence[str] | None = None,
    lying: Mapping[str, bool] | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ObservedTracks:
    """Positions, and turns of boxes, of all objects in the world.

    solids: shape and size of objects by name; those not given are estimated. only: names of those to place, default
    all. lying: whether a cylinder of given size lies on its side, default as its outline fits better. Frames are fitted
    one by one, so that collisions stay sharp: noise is left to whoever fits a model, with position_sigma [m] to weigh
    it by. confidence is the observation's, lowered where little of the outline is seen or the fit is poor. A turn is
    continuous over time; a cube's is known up to quarter turns (symmetry 4), a ball's or upright cylinder's not at all
    (symmetry 0).
    """
    check_camera(camera, observation.video)
    for name in solids or {}:
        observation.object(name)
    chosen = dict(solids or {})
    if only is None:
        missing = [n for n in observation.names if n not in chosen]
        estimates = estimate_sizes(observation, camera, plane, only=missing, cancelled=cancelled)
        chosen |= {n: found.solid for n, found in estimates.items()}
    placed = followed_places(observation, camera, chosen, plane)
    sure = {name: observation.object(name).confidence for name in placed}
    bodies = {name: solid_body(name, solid, camera, plane) for name, solid in chosen.items()}
    depths = {name: _depths(observation, body) for name, body in bodies.items()} if plane.supports else {}
    wanted = [name for name in (chosen if only is None else only) if name not in placed]
    for done, name in enumerate(wanted):
        report(progress, cancelled, done / len(wanted), f"positions of {name}")
        ways = [bodies[name]]
        if name in (solids or {}) and isinstance(chosen[name], Cylinder) and not bodies[name].upright:
            said = (lying or {}).get(name)
            ways = [replace(bodies[name], lies=lies) for lies in (False, True) if said in (None, lies)]
        rows = np.flatnonzero(observation.object(name).confidence > 0)
        (body, fits), *others = [(body, _followed(MaskScene(observation, [body], depths), rows)) for body in ways]
        for on_side, its in others:
            if lies_better(misfits(fits), misfits(its)):
                body, fits = on_side, its
        placed[name], sure[name] = _placed(observation, body, fits)
    return with_places(nowhere(observation, seconds_per_frame), placed, sure)


def followed_places(
    observation: ImageObservation, camera: Camera, solids: Mapping[str, Sized], plane: MotionPlane
) -> dict[str, Places]:
    """Return the places of objects that were followed as these solids, with this camera, on this plane."""
    scene = observation.scene
    if scene is None or scene.camera != camera or not same_plane(scene.plane, plane):
        return {}
    found = {}
    for name, own in scene.solids.items():
        places = next((o.places for o in observation.objects if o.name == name), None)
        if places is not None and name in solids and solids[name] == own:
            found[name] = places
    return found


def misfits_at_rest(
    observation: ImageObservation,
    camera: Camera,
    name: str,
    solid: Cylinder,
    plane: MotionPlane,
    rows: NDArray[np.intp],
) -> dict[bool, Floats]:
    """Squared misfits (F,) [px^2] of the outlines of a cylinder that stands, or lies (True), in some rows."""
    standing = solid_body(name, solid, camera, plane)
    bodies = [replace(standing, lies=lies) for lies in (False, True)]
    return {body.lies: misfits(_followed(MaskScene(observation, [body]), rows)) for body in bodies}


def misfits(fits: Mapping[int, Fit]) -> Floats:
    """Squared misfits (F,) [px^2] of a solid's fits."""
    return np.array([fit.misfit**2 for fit in fits.values()])


def _followed(scene: MaskScene, rows: NDArray[np.intp]) -> dict[int, Fit]:
    """Fits of the scene's one body in some rows: at the angle of the row before, unless that fits much worse."""
    found: dict[int, Fit] = {}
    last: Fit | None = None
    turns = len(scene.bodies[0].angles()) > 1
    for row in rows.tolist():
        fit = None
        if last is not None and turns:
            start = scene.placed(0, row)
            fit = None if start is None else scene.fit(0, row, np.array([*start[:2], last.pose[2], start[3]]))
        if fit is None or last is None or fit.misfit > AGAIN * last.misfit:
            other = scene.fit(0, row)
            fit = other if fit is None or (other is not None and other.misfit < fit.misfit / AGAIN) else fit
        if fit is not None:
            found[row] = last = fit
    return found


def _placed(observation: ImageObservation, body: Solid, fits: Mapping[int, Fit]) -> tuple[Places, Floats]:
    """Places of a solid by its fits, and how sure they are (T,)."""
    count = len(observation.frames)
    poses, covariances, quality = np.full((count, 4), np.nan), np.zeros((count, 4, 4)), np.zeros(count)
    for row, fit in fits.items():
        if fit.decided > SHOWN:
            poses[row], covariances[row] = fit.pose, fit.covariance
            quality[row] = np.exp(-np.expm1(fit.misfit**2) / 4.0) * min(2.0 * fit.decided, 1.0)
    places = places_of(body, poses, covariances)
    size = max(body.half)
    far = ~(places.sigma < size)
    places.positions[far], places.sigma[far] = np.nan, np.nan
    quality = np.where(far, 0.0, quality / (1 + (places.sigma / (0.5 * size)) ** 2))
    return places, observation.object(body.name).confidence * quality


def _depths(observation: ImageObservation, body: Solid) -> Floats:
    """Distance (T,) of an object from the camera, roughly, from where its mask is [m]; NaN unseen."""
    scene, observed = MaskScene(observation, [body]), observation.object(body.name)
    depths = np.full(len(observation.frames), np.nan)
    for row in np.flatnonzero(observed.area > 0).tolist():
        pose = scene.placed(0, row)
        depths[row] = np.nan if pose is None else body.depth(pose)
    # A partly hidden mask's middle misleads: bridge between the frames in full view.
    trusted = np.flatnonzero((np.array(observed.status) == "visible") & np.isfinite(depths))
    return depths if len(trusted) < 2 else np.interp(np.arange(len(depths)), trusted, depths[trusted])


def nowhere(observation: ImageObservation, seconds_per_frame: float) -> ObservedTracks:
    """Tracks of all objects without a place."""
    shape = len(observation.frames), len(observation.objects)
    return ObservedTracks(
        names=observation.names,
        frames=np.asarray(observation.frames, dtype=np.int64),
        seconds_per_frame=float(seconds_per_frame),
        clock=observation.video.moments(observation.frames),
        positions=np.full((*shape, 3), np.nan),
        position_sigma=np.full(shape, np.nan),
        orientations=np.full((*shape, 4), np.nan),
        confidence=np.zeros(shape),
        orientation_confidence=np.zeros(shape),
        symmetry=(0,) * shape[1],
    )
