"""Orientations of bodies from points followed on them: the rotation that takes each point to where it is seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from atw_mcp.models.points import PredictedPoints
from polyworld.data.tracks import ObservedTracks, continuous
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.geometry import plane_axes
from polyworld.world.shapes import BodyShape, Sphere

Floats = NDArray[np.float64]
LEAST_POINTS = 3  # that must be seen again to turn a body by them
OUTLIER = 3.0  # scaled median deviations beyond which a point is taken to have slipped
TRUSTED = 0.1  # [rad] rms of the points' residual at which a rotation counts a third
ANGLE_FLOOR = 1e-3  # [rad] below which residuals are no reason to leave a point out


def rotations(
    points: PredictedPoints,
    tracks: ObservedTracks,
    camera: Camera,
    shapes: Mapping[str, BodyShape | None],
    plane: MotionPlane,
) -> ObservedTracks:
    """Return the tracks with the orientations that points on the bodies show.

    On a ball of known place and size the ray of a pixel meets the surface at a known point, and the rotation is the
    least-squares one between such directions and those of the body (Kabsch 1976; Wahba's problem). Any other body is
    taken to turn about the normal of the motion plane, its points to lie in the parallel plane through its centre.
    A body's first orientation is the one its track has there, else none (w = 1). Rows of points are rows of tracks.
    """
    orientations, confidence = tracks.orientations.copy(), tracks.orientation_confidence.copy()
    symmetry = list(tracks.symmetry)
    for name in dict.fromkeys(q.object for q in points.queries):
        if name not in tracks.names:
            continue
        column = tracks.index(name)
        own = [k for k, q in enumerate(points.queries) if q.object == name]
        pixels = np.where(points.visible[:, own, None], points.pixels[:, own], np.nan)
        centres = np.where(tracks.confidence[:, column, None] > 0, tracks.positions[:, column], np.nan)
        shape = shapes.get(name)
        if isinstance(shape, Sphere):
            turned, error = _turned(_on_ball(pixels, centres, shape.radius, camera), None)
        else:
            turned, error = _turned(_on_plane(pixels, centres, plane, camera), np.asarray(plane_axes(plane)[2]))
        known = np.isfinite(turned).all(axis=1)
        if not known.any():
            continue
        begin = int(np.flatnonzero(known)[0])
        first = tracks.orientations[begin, column]
        base = Rotation.from_quat(first[[1, 2, 3, 0]]) if np.isfinite(first).all() else Rotation.identity()
        found = (Rotation.from_quat(turned[known]) * base).as_quat()[:, [3, 0, 1, 2]]
        orientations[:, column], confidence[:, column] = np.nan, 0.0
        orientations[known, column] = continuous(found)
        weight = np.exp(-((error[known] / TRUSTED) ** 2))
        confidence[known, column] = np.round(tracks.confidence[known, column] * weight, 4)
        symmetry[column] = 1
    return replace(tracks, orientations=orientations, orientation_confidence=confidence, symmetry=tuple(symmetry))


def _on_ball(pixels: Floats, centres: Floats, radius: float, camera: Camera) -> Floats:
    """Unit directions (T, n, 3) from a ball's centre to where rays of pixels meet it first; NaN where they miss."""
    rays = camera.rays(pixels)
    away = (centres - camera.centre)[:, None]
    along = (rays * away).sum(axis=2)
    inside = along**2 - (away**2).sum(axis=2) + radius**2
    with np.errstate(invalid="ignore"):
        depth = along - np.sqrt(np.where(inside >= 0, inside, np.nan))
    directions: Floats = (rays * depth[..., None] - away) / radius
    return directions


def _on_plane(pixels: Floats, centres: Floats, plane: MotionPlane, camera: Camera) -> Floats:
    """Unit directions (T, n, 3) from the centre, within the plane through it that is parallel to the motion plane."""
    normal = np.asarray(plane_axes(plane)[2], dtype=float)
    directions = np.full((*pixels.shape[:2], 3), np.nan)
    for t, centre in enumerate(centres):
        if np.isfinite(centre).all():
            offset = camera.onto_plane(pixels[t], centre, normal) - centre
            length = np.linalg.norm(offset, axis=1, keepdims=True)
            with np.errstate(invalid="ignore", divide="ignore"):
                directions[t] = np.where(length > 0, offset / length, np.nan)
    return directions


def _turned(directions: Floats, axis: Floats | None) -> tuple[Floats, Floats]:
    """Rotations (T, 4) x, y, z, w since the first frame with enough points, and residual (T,) [rad].

    axis: the only axis of rotation, None where any will do. A point that appears later is tied to the body by the
    rotation of the frame it appears in.
    """
    count, n = directions.shape[:2]
    body = np.full((n, 3), np.nan)
    result, error = np.full((count, 4), np.nan), np.full(count, np.nan)
    started = False
    for t in range(count):
        seen = np.isfinite(directions[t]).all(axis=1)
        if not started:
            if seen.sum() < LEAST_POINTS:
                continue
            started, rotation, residual = True, Rotation.identity(), 0.0
        else:
            tied = np.flatnonzero(seen & np.isfinite(body).all(axis=1))
            if len(tied) < LEAST_POINTS:
                continue
            rotation, residual = _fitted(directions[t, tied], body[tied], axis)
        result[t], error[t] = rotation.as_quat(), residual
        fresh = seen & ~np.isfinite(body).all(axis=1)
        body[fresh] = rotation.inv().apply(directions[t, fresh])
    return result, error


def _fitted(seen: Floats, body: Floats, axis: Floats | None) -> tuple[Rotation, float]:
    keep = np.ones(len(seen), dtype=bool)
    for _ in range(3):
        rotation = _least_squares(seen[keep], body[keep], axis)
        angle = np.arccos(np.clip((rotation.apply(body) * seen).sum(axis=1), -1.0, 1.0))
        limit = np.median(angle) + OUTLIER * max(
            1.4826 * float(np.median(np.abs(angle - np.median(angle)))), ANGLE_FLOOR
        )
        if (angle <= limit).sum() < LEAST_POINTS:
            break
        keep = angle <= limit
    return rotation, float(np.sqrt(np.mean(angle[keep] ** 2)))


def _least_squares(seen: Floats, body: Floats, axis: Floats | None) -> Rotation:
    if axis is None:
        found, _ = Rotation.align_vectors(seen, body)
        return found
    cosine, sine = (seen * body).sum(), (np.cross(body, seen) @ axis).sum()
    return Rotation.from_rotvec(axis * np.arctan2(sine, cosine))
