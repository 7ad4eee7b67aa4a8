"""From masks to motion in the world: the pose of each solid whose outline best matches its mask."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from atw_mcp.perception.known_scene import same_plane
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.places import Places, with_places
from atw_mcp.perception.pose_fit import OutlineProblem, PoseFit, fit_poses
from atw_mcp.perception.silhouettes import SIZE_COUNT, TURNING, SolidKind, Stage, lift_of, trusted_outline
from atw_mcp.perception.video import Cancelled, PerceptionCancelled, Progress
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.shapes import Box, Cylinder, Sphere

Floats = NDArray[np.float64]
Solid = Sphere | Box | Cylinder

TURN_STARTS = 4
SIZE_FRAMES = 14
LEAST_POINTS = 10  # outline points below which a frame says too little
HEIGHT_ERROR = 0.02  # of a solid's height above its plane: rounded edges make solids look smaller than they stand
ON_ITS_SIDE = Rotation.from_euler("y", 90.0, degrees=True)  # its own axis, z, along x
UPRIGHT = 0.9999  # upward part of a normal from which on a plane is level
LYING_PRICE = 0.07  # px^2: errors of a quarter of a pixel all along an outline can favour lying, or standing
LEAST_ANGLE = np.deg2rad(100)  # of outline about the centre: less does not fix a pose
DEFAULT_PLANE = MotionPlane()


@dataclass(frozen=True)
class SolidEstimate:
    """The solid an object is taken for.

    size_sigma: standard deviation of each size [m]; residual: typical distance of the outline from the mask's
    [px]; alternatives: the same for every kind that was tried; confidence (0..1) that the kind is right.
    """

    solid: Solid
    size_sigma: tuple[float, ...]
    residual: float
    alternatives: dict[str, float]
    confidence: float
    frames: int

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "solid": self.solid.model_dump(mode="json"),
            "size_sigma": [round(s, 5) for s in self.size_sigma],
            "residual_px": round(self.residual, 3),
            "alternatives_px": {k: round(v, 3) for k, v in self.alternatives.items()},
            "confidence": round(self.confidence, 3),
            "frames": self.frames,
        }


@dataclass(frozen=True)
class _Placed:
    """The poses of one object: from which outline points, as which kind of solid, of which sizes."""

    evidence: _Evidence
    kind: SolidKind
    size: Floats
    fit: PoseFit

    @property
    def misfit(self) -> float:
        """Median cost of its frames, in favour of standing solids where both fit alike."""
        return float(np.median(self.priced))

    @property
    def priced(self) -> Floats:
        """Costs (F,) of its frames with the price of lying."""
        return np.asarray(self.fit.cost + (LYING_PRICE if self.kind == "lying" else 0.0))


@dataclass(frozen=True)
class _Evidence:
    """Outline points of one object: rows (F,) of the observation, points (F, P, 2), valid (F, P), share (F,)."""

    rows: NDArray[np.int64]
    points: Floats
    valid: NDArray[np.bool_]
    share: Floats

    def only(self, keep: NDArray[np.int64]) -> _Evidence:
        return _Evidence(self.rows[keep], self.points[keep], self.valid[keep], self.share[keep])


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
    _check_camera(observation, camera)
    for name, kind in (kinds or {}).items():
        observation.object(name)
        if kind not in ("sphere", "cylinder", "cube", "box"):
            raise ObservationError(f"unknown kind {kind!r} of {name!r}; kinds: sphere, cylinder, cube, box")
    stage = Stage.of(camera, plane)
    labels = [observation.label_image(f) for f in observation.frames]
    result = {}
    for number, observed in enumerate(observation.objects, start=1):
        if only is not None and observed.name not in only:
            continue
        _report(progress, cancelled, (number - 1) / len(observation.objects), f"size of {observed.name}")
        rows = _size_rows(observation, number)
        evidence = _evidence(observation, labels, number, rows, {})
        if len(evidence.rows) == 0:
            continue
        wanted = (kinds or {}).get(observed.name)
        tried: dict[SolidKind, PoseFit] = {}
        options: tuple[SolidKind, ...] = (wanted,) if wanted else ("sphere", "cylinder", "cube")
        if not wanted and observed.shape.name == "box":
            options = ("sphere", "cylinder", "cube", "box")
        for kind in options:
            fitted = _fit_size(stage, kind, evidence)
            if fitted is not None:
                tried[kind] = fitted
        if tried:
            result[observed.name] = _choose(tried, observed.shape.name, observed.shape.confidence, len(evidence.rows))
    return result


def world_tracks(
    observation: ImageObservation,
    camera: Camera,
    solids: Mapping[str, Solid] | None = None,
    plane: MotionPlane = DEFAULT_PLANE,
    *,
    seconds_per_frame: float,
    only: Sequence[str] | None = None,
    rests: Mapping[str, SolidKind] | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ObservedTracks:
    """Positions, and turns of boxes, of all objects in the world.

    solids: shape and size of objects by name; those not given are estimated. only: names of those to place, default
    all. rests: whether a cylinder of given size stands ("cylinder") or is "lying", default as its outline fits
    better. Frames are fitted one by one, so that collisions stay sharp: noise is left to whoever fits a model, with
    position_sigma to weigh it by. position_sigma [m] includes a floor of 0.3 px and 2% of the centre's height;
    confidence is the observation's, lowered where little of the outline is trustworthy or the fit is poor. A turn
    is continuous over time; a cube's is known up to quarter turns (symmetry 4), a ball's or upright cylinder's not
    at all (symmetry 0).
    """
    _check_camera(observation, camera)
    for name in solids or {}:
        observation.object(name)
    chosen: dict[str, Solid] = dict(solids or {})
    unknown = [n for n in observation.names if n not in chosen and only is None]
    if unknown:
        estimates = estimate_sizes(observation, camera, plane, cancelled=cancelled)
        chosen.update({n: estimates[n].solid for n in unknown if n in estimates})
    stage = Stage.of(camera, plane)
    labels = [observation.label_image(f) for f in observation.frames]
    placed = followed_places(observation, camera, chosen, plane)
    wanted = [name for name in (chosen if only is None else only) if name not in placed]
    numbers = [k for k, o in enumerate(observation.objects, start=1) if o.name in wanted]
    rough = _depths(observation, stage, chosen)
    fits: dict[int, _Placed] = {}
    for done, number in enumerate(numbers):
        name = observation.objects[number - 1].name
        _report(progress, cancelled, done / len(numbers), f"positions of {name}")
        behind = _behind(number, rough, plane)
        rows = np.flatnonzero(observation.objects[number - 1].confidence > 0)
        evidence = _evidence(observation, labels, number, rows, behind)
        if len(evidence.rows):
            given = name in (solids or {})
            ways = _ways(chosen[name], given=given)
            said = (rests or {}).get(name)
            ways = [way for way in ways if way[0] == said] or ways
            tried = [_place(observation, stage, labels, number, way, evidence, given=given) for way in ways]
            fits[number] = min(tried, key=lambda placed: placed.misfit)
    sure = {name: observation.object(name).confidence for name in placed}
    return with_places(_tracks(observation, stage, fits, seconds_per_frame), placed, sure)


def followed_places(
    observation: ImageObservation, camera: Camera, solids: Mapping[str, Solid], plane: MotionPlane
) -> dict[str, Places]:
    """Return the places of objects that were followed as these solids, with this camera, on this plane."""
    scene = observation.scene
    if scene is None or scene.camera != camera or not same_plane(scene.plane, plane):
        return {}
    places = {o.name: o.places for o in observation.objects}
    found = {}
    for name, own in scene.solids.items():
        one = places.get(name)
        if one is not None and name in solids and _same_solid(solids[name], own):
            found[name] = one
    return found


def _same_solid(one: Solid, other: Solid) -> bool:
    (kind, size), (other_kind, other_size) = kind_and_size(one), kind_and_size(other)
    return kind == other_kind and bool(np.allclose(size, other_size))


def costs_of_rest(
    observation: ImageObservation,
    camera: Camera,
    name: str,
    solid: Cylinder,
    plane: MotionPlane,
    rows: NDArray[np.int64],
) -> dict[SolidKind, Floats]:
    """Robust costs (F,) [px^2] of the outlines of a cylinder that stands, or lies, on a plane in some rows.

    That of lying bears its price.
    """
    labels, number = [observation.label_image(f) for f in observation.frames], observation.names.index(name) + 1
    stage, evidence = Stage.of(camera, plane), _evidence(observation, labels, number, rows, {})
    if len(evidence.rows) == 0:
        return {}
    ways = _ways(solid, given=True)
    placed = [_place(observation, stage, labels, number, way, evidence, given=True) for way in ways]
    return {one.kind: one.priced for one in placed}


def _place(
    observation: ImageObservation,
    stage: Stage,
    labels: list[NDArray[np.uint8]],
    number: int,
    way: tuple[SolidKind, Floats],
    evidence: _Evidence,
    *,
    given: bool,
) -> _Placed:
    kind, size = way
    seen = _outline_size(stage, kind, size, observation, labels, number) if given else size
    return _Placed(evidence, kind, size, _fit_known(stage, kind, seen, lift_of(size), evidence))


def _ways(solid: Solid, *, given: bool) -> list[tuple[SolidKind, Floats]]:
    """List how a solid may rest, with its sizes: as it stands; a cylinder of given size also on its side."""
    standing = kind_and_size(solid)
    if not isinstance(solid, Cylinder) or not given:
        return [standing]
    return [standing, ("lying", standing[1][::-1].copy())]


def kind_and_size(solid: Solid) -> tuple[SolidKind, Floats]:
    """Return a solid as the kind and sizes of `silhouettes`."""
    if isinstance(solid, Sphere):
        return "sphere", np.array([solid.radius])
    if isinstance(solid, Cylinder):
        return "cylinder", np.array([solid.radius, solid.half_height])
    half = np.array(solid.half_extents)
    return ("cube", half[:1]) if np.ptp(half) < 1e-9 else ("box", half)


def solid_of(kind: SolidKind, size: Sequence[float] | Floats) -> Solid:
    """Return the inverse of `kind_and_size`."""
    values = [float(s) for s in size]
    if kind == "sphere":
        return Sphere(radius=values[0])
    if kind == "cylinder":
        return Cylinder(radius=values[0], half_height=values[1])
    a, b, c = (values[0], values[0], values[0]) if kind == "cube" else (values[0], values[1], values[2])
    return Box(half_extents=(a, b, c))


# --- evidence ----------------------------------------------------------------------------------------


def _evidence(
    observation: ImageObservation,
    labels: list[NDArray[np.uint8]],
    number: int,
    rows: NDArray[np.int64],
    behind: dict[int, frozenset[int]],
) -> _Evidence:
    outlines = [trusted_outline(labels[t], number, behind.get(int(t), frozenset())) for t in rows]
    enough = [k for k, o in enumerate(outlines) if len(o.points) >= LEAST_POINTS]
    width = max((len(outlines[k].points) for k in enough), default=0)
    points, valid = np.zeros((len(enough), width, 2)), np.zeros((len(enough), width), dtype=bool)
    for i, k in enumerate(enough):
        found = observation.steadied(outlines[k].points, int(rows[k]))
        points[i, : len(found)], valid[i, : len(found)] = found, True
    return _Evidence(rows[enough], points, valid, np.array([outlines[k].share for k in enough]))


def _size_rows(observation: ImageObservation, number: int) -> NDArray[np.int64]:
    """Rows with the object in full view, as different from each other as can be; else its clearest rows."""
    observed = observation.objects[number - 1]
    rows = np.array([t for t, s in enumerate(observed.status) if s == "visible"], dtype=np.int64)
    if len(rows) < 3:
        rows = np.sort(np.argsort(-observed.confidence, kind="stable")[:SIZE_FRAMES])
        rows = rows[observed.confidence[rows] > 0]
    if len(rows) <= SIZE_FRAMES:
        return rows
    # Spread along the way travelled, so that a long rest does not outweigh a short flight.
    moved = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(observed.centroid[rows], axis=0).T))])
    along = moved + np.linspace(0, 1.0, len(rows))
    targets = np.linspace(along[0], along[-1], SIZE_FRAMES)
    picks = np.unique(np.abs(along[None, :] - targets[:, None]).argmin(axis=1))
    chosen: NDArray[np.int64] = rows[picks]
    return chosen


def _depths(observation: ImageObservation, stage: Stage, solids: Mapping[str, Solid]) -> Floats:
    """Distance (T, n) of each object from the camera, roughly, from the foot of its mask [m]; NaN unseen."""
    count = len(observation.frames)
    depths = np.full((count, len(observation.objects)), np.nan)
    for k, observed in enumerate(observation.objects):
        if observed.name not in solids:
            continue
        _, size = kind_and_size(solids[observed.name])
        box = observed.box
        middle = np.stack([box[:, 0] + box[:, 2] / 2, box[:, 1] + box[:, 3] / 2], axis=1)
        middle = np.stack([observation.steadied(point, row) for row, point in enumerate(middle)])
        lift = lift_of(size)
        poses = np.column_stack([stage.poses_of(middle, lift), np.zeros(count)])
        depths[:, k] = np.linalg.norm(stage.centres(poses, lift) - stage.camera.centre, axis=1)
        # A partly hidden mask's middle misleads: bridge between the frames in full view.
        trusted = np.array([s == "visible" for s in observed.status]) & np.isfinite(depths[:, k])
        if trusted.sum() >= 2:
            rows = np.arange(count)
            depths[:, k] = np.interp(rows, rows[trusted], depths[trusted, k])
    return depths


def _behind(number: int, depths: Floats, plane: MotionPlane) -> dict[int, frozenset[int]]:
    """For each row the objects that are clearly farther from the camera than this one."""
    if not plane.supports:
        return {}
    mine = depths[:, number - 1]
    with np.errstate(invalid="ignore"):
        farther = depths > 1.02 * mine[:, None]
    return {t: frozenset(int(k) + 1 for k in np.flatnonzero(row)) for t, row in enumerate(farther) if row.any()}


# --- fits --------------------------------------------------------------------------------------------


def _start_poses(stage: Stage, evidence: _Evidence, lift: float) -> Floats:
    x = np.where(evidence.valid, evidence.points[..., 0], np.nan)
    y = np.where(evidence.valid, evidence.points[..., 1], np.nan)
    middle = np.stack([np.nanmin(x, 1) + np.nanmax(x, 1), np.nanmin(y, 1) + np.nanmax(y, 1)], axis=1) / 2
    poses = np.zeros((len(middle), 3))
    poses[:, :2] = stage.poses_of(middle, lift)
    return poses


def _problem(stage: Stage, kind: SolidKind, evidence: _Evidence, lift: float | None = None) -> OutlineProblem:
    return OutlineProblem(stage, kind, evidence.points, evidence.valid, lift)


def _fit_size(stage: Stage, kind: SolidKind, evidence: _Evidence, lift: float | None = None) -> PoseFit | None:
    """Joint fit of size and poses; None where the object is not seen on the plane at all."""
    poses = _start_poses(stage, evidence, 0.0)
    usable = np.flatnonzero(np.isfinite(poses).all(axis=1))
    if len(usable) == 0:
        return None
    evidence, poses = evidence.only(usable), poses[usable]
    away = np.linalg.norm(stage.centres(poses, 0.0) - stage.camera.centre, axis=1)
    spread = np.array([np.ptp(p[v], axis=0).mean() / 2 for p, v in zip(evidence.points, evidence.valid, strict=True)])
    radius = float(np.median(spread * away / stage.camera.intrinsics[0][0])) * 0.85
    # Begin with the size that fits in place of the one guessed: 80% of the mean radius for boxes seen askew.
    size = np.full(SIZE_COUNT[kind], radius if kind in ("sphere", "cylinder") else 0.8 * radius)
    problem = _problem(stage, kind, evidence, lift)
    fitted: PoseFit | None = None
    for _ in range(2 if kind in TURNING else 1):
        start = _start_poses(stage, evidence, float(size[-1]) if lift is None else lift)
        if kind in TURNING:
            fits = _from_turns(problem, size, start, iterations=6)
            best = np.argmin(np.stack([f.cost for f in fits]), axis=0)
            start = np.stack([f.poses for f in fits])[best, np.arange(len(start))]
        fitted = fit_poses(problem, start, size, fit_size=True, iterations=20)
        size = fitted.size
    return fitted


def _outline_size(
    stage: Stage,
    kind: SolidKind,
    size: Floats,
    observation: ImageObservation,
    labels: list[NDArray[np.uint8]],
    number: int,
) -> Floats:
    """Return the size of which the outline looks, within 10% of the given one.

    Rounded edges and blur make outlines a little smaller or larger than the solid; a wrong outline would turn
    the box rather than shrink it. The height of the centre stays the given solid's.
    """
    evidence = _evidence(observation, labels, number, _size_rows(observation, number), {})
    fitted = _fit_size(stage, kind, evidence, lift_of(size)) if len(evidence.rows) else None
    return size if fitted is None else np.clip(fitted.size, 0.9 * size, 1.1 * size)


def _from_turns(problem: OutlineProblem, size: Floats, start: Floats, iterations: int) -> list[PoseFit]:
    """Fits from turns spread over the symmetry range of a box."""
    period = np.pi / 2 if problem.kind == "cube" else np.pi
    fits = []
    for turn in np.arange(TURN_STARTS) * period / TURN_STARTS:
        poses = start.copy()
        poses[:, 2] = turn
        fits.append(fit_poses(problem, poses, size, fit_size=False, iterations=iterations))
    return fits


def _fit_known(stage: Stage, kind: SolidKind, size: Floats, lift: float, evidence: _Evidence) -> PoseFit:
    """Poses of a solid whose outline has the given size and whose centre is `lift` above the plane."""
    problem = _problem(stage, kind, evidence, lift)
    start = np.nan_to_num(_start_poses(stage, evidence, lift))
    if kind not in TURNING:
        return fit_poses(problem, start, size, fit_size=False, iterations=15)
    period = np.pi / 2 if kind == "cube" else np.pi
    fits = _from_turns(problem, size, start, iterations=6)
    pick = _continuous_choice(fits, evidence.rows, period)
    chosen = np.stack([f.poses for f in fits])[pick, np.arange(len(start))]
    fit = fit_poses(problem, chosen, size, fit_size=False, iterations=10)
    fit.poses[:, 2] = np.unwrap(fit.poses[:, 2], period=period)
    return fit


def _continuous_choice(fits: list[PoseFit], rows: NDArray[np.int64], period: float) -> NDArray[np.int64]:
    """For each frame the fit to keep: cheapest path through costs and jumps of the turn (Viterbi)."""
    cost = np.stack([f.cost for f in fits], axis=1) * 30.0  # about the number of independent outline points
    turn = np.stack([f.poses[:, 2] for f in fits], axis=1)
    frames, options = cost.shape
    total, back = cost[0].copy(), np.zeros((frames, options), dtype=np.int64)
    for t in range(1, frames):
        jump = turn[t][None, :] - turn[t - 1][:, None]
        jump = np.abs(jump - period * np.round(jump / period)) / max(int(rows[t] - rows[t - 1]), 1)
        arrive = total[:, None] + np.minimum((jump / 0.15) ** 2, 20.0)
        back[t] = np.argmin(arrive, axis=0)
        total = arrive[back[t], np.arange(options)] + cost[t]
    pick = np.zeros(frames, dtype=np.int64)
    pick[-1] = int(np.argmin(total))
    for t in range(frames - 1, 0, -1):
        pick[t - 1] = back[t, pick[t]]
    return pick


def _choose(tried: dict[SolidKind, PoseFit], cue: str, cue_confidence: float, frames: int) -> SolidEstimate:
    residual = {k: float(np.median(f.rms)) for k, f in tried.items()}
    cost = {k: float(np.median(f.cost)) for k, f in tried.items()}
    # Each doubling of the misfit outweighs the look from afar, which has no camera to go by.
    score = {}
    for kind in tried:
        agrees = kind == cue or (kind == "cube" and cue == "box")
        score[kind] = np.log(max(cost[kind], 0.02)) + {"sphere": 0.0, "cube": 0.05, "cylinder": 0.12, "box": 0.2}[kind]
        score[kind] -= 0.4 * cue_confidence if agrees else 0.0
    order = sorted(score, key=lambda k: float(score[k]))
    best = order[0]
    gap = float(score[order[1]] - score[best]) if len(order) > 1 else 2.0
    fit = tried[best]
    return SolidEstimate(
        solid=solid_of(best, fit.size),
        size_sigma=tuple(float(s) for s in fit.size_sigma),
        residual=residual[best],
        alternatives={str(k): v for k, v in residual.items()},
        confidence=float(1 / (1 + np.exp(-3 * gap))),
        frames=frames,
    )


# --- result ------------------------------------------------------------------------------------------


def _tracks(
    observation: ImageObservation,
    stage: Stage,
    fits: dict[int, _Placed],
    seconds_per_frame: float,
) -> ObservedTracks:
    count, n = len(observation.frames), len(observation.objects)
    positions, sigma = np.full((count, n, 3), np.nan), np.full((count, n), np.nan)
    orientations, confidence = np.full((count, n, 4), np.nan), np.zeros((count, n))
    turn_confidence, symmetry = np.zeros((count, n)), [0] * n
    for number, placed in fits.items():
        observed = observation.objects[number - 1]
        evidence, kind, size, fit = placed.evidence, placed.kind, placed.size, placed.fit
        rows, column = evidence.rows, number - 1
        variance = np.einsum("fkk->fk", fit.covariance)
        spread = np.sqrt(np.maximum(variance[:, :2].mean(axis=1), 0.0))
        quality = np.exp(-((fit.rms / 2.0) ** 2)) * np.clip(evidence.share / 0.5, 0.1, 1.0)
        around = _angle_seen(stage, fit.poses, lift_of(size), evidence)
        # A short arc of the outline fixes the pose through its own errors of shape, all of one sign.
        spread *= np.maximum(np.pi / np.maximum(around, 0.1), 1.0) ** 2
        spread = np.hypot(spread, _from_height(stage, fit.poses, lift_of(size)))
        quality *= 1 / (1 + (spread / (0.5 * float(size.max()))) ** 2)
        good = np.isfinite(fit.poses).all(axis=1) & (spread < float(size.max())) & (fit.cost < 20.0)
        good &= around > LEAST_ANGLE
        rows, spread, quality = rows[good], spread[good], quality[good]
        positions[rows, column] = stage.centres(fit.poses[good], lift_of(size))
        sigma[rows, column] = spread
        confidence[rows, column] = np.round(observed.confidence[rows] * quality, 4)
        if kind == "cylinder" and abs(stage.axes[2, 2]) < UPRIGHT:
            # It stands askew: the tilt of its axis is known as well as its place.
            orientations[rows, column] = _quaternions(stage, fit.poses[good, 2], kind)
            turn_confidence[rows, column] = confidence[rows, column]
        if kind in TURNING:
            alike = 4 if kind == "cube" or abs(size[0] - size[1]) < 0.02 * size[0] else 2
            symmetry[column] = 0 if kind == "lying" else alike
            turn_sigma = np.sqrt(np.maximum(variance[good, 2], 0.0))
            orientations[rows, column] = _quaternions(stage, fit.poses[good, 2], kind)
            turn_confidence[rows, column] = np.round(confidence[rows, column] * np.exp(-((turn_sigma / 0.25) ** 2)), 4)
    known = np.isfinite(positions).all(axis=2)
    confidence[~known] = 0.0
    return ObservedTracks(
        names=observation.names,
        frames=np.asarray(observation.frames, dtype=np.int64),
        seconds_per_frame=float(seconds_per_frame),
        clock=observation.video.moments(observation.frames),
        positions=positions,
        position_sigma=sigma,
        orientations=orientations,
        confidence=confidence,
        orientation_confidence=turn_confidence,
        symmetry=tuple(symmetry),
    )


def _from_height(stage: Stage, poses: Floats, lift: float) -> Floats:
    """Compute the error along the plane (F,) [m] that HEIGHT_ERROR in the centre's height causes.

    A ray that comes in flat meets a plane that is a little higher much nearer.
    """
    if not stage.plane.supports:
        return np.zeros(len(poses))
    offset = stage.centres(poses, lift) - stage.camera.centre
    down = np.abs(offset @ stage.axes[2])
    along = np.sqrt(np.maximum((offset**2).sum(axis=1) - down**2, 0.0))
    amount: Floats = HEIGHT_ERROR * lift * along / np.maximum(down, 1e-9)
    return amount


def _angle_seen(stage: Stage, poses: Floats, lift: float, evidence: _Evidence) -> Floats:
    """Angle (F,) about the projected centre over which outline points are seen [rad]: all round but the widest gap."""
    centres = stage.camera.project(stage.centres(poses, lift))
    seen = np.zeros(len(poses))
    for i, centre in enumerate(centres):
        points = evidence.points[i][evidence.valid[i]] - centre
        if not np.isfinite(points).all():
            continue
        angles = np.sort(np.arctan2(points[:, 1], points[:, 0]))
        gaps = np.diff(np.concatenate([angles, angles[:1] + 2 * np.pi]))
        seen[i] = 2 * np.pi - gaps.max()
    return seen


def _quaternions(stage: Stage, turns: Floats, kind: SolidKind) -> Floats:
    """Quaternions (F, 4) w, x, y, z of solids turned about the plane's normal, as `silhouettes` places them."""
    half = turns[:, None] / 2
    turned = np.concatenate([np.cos(half), np.sin(half) * stage.axes[2]], axis=1)
    level = not (stage.plane.supports or abs(stage.axes[2, 2]) > 0.7) or np.allclose(stage.axes, np.eye(3))
    if level and kind != "lying":
        return turned
    rest = Rotation.identity() if level else Rotation.from_matrix(stage.axes.T)
    if kind == "lying":
        rest = rest * ON_ITS_SIDE
    about = Rotation.from_quat(turned[:, [1, 2, 3, 0]])
    combined: Floats = (about * rest).as_quat()[:, [3, 0, 1, 2]]
    return combined


def _check_camera(observation: ImageObservation, camera: Camera) -> None:
    size = (observation.video.width, observation.video.height)
    if (camera.width, camera.height) != size:
        raise ObservationError(
            f"the camera is for images of {camera.width} x {camera.height}, the video has {size[0]} x {size[1]}: "
            "calibrate with the video's own size"
        )


def _report(progress: Progress | None, cancelled: Cancelled | None, share: float, what: str) -> None:
    if cancelled is not None and cancelled():
        raise PerceptionCancelled("cancelled")
    if progress is not None:
        progress(share, what)
