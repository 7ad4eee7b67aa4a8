"""Outlines: where observed ones may be trusted, and how far a point is from the outline of a solid.

A solid on a plane is described by its pose (x, y in the plane [m], turn about the plane's normal [rad]) and
its size (sphere: radius; cylinder, which stands: radius, half height; lying, a cylinder on its side whose axis is the
body's x: half height, radius; cube: half edge; box: three half edges [m]).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.geometry import plane_axes

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
SolidKind = Literal["sphere", "cylinder", "lying", "cube", "box"]

SIZE_COUNT: dict[SolidKind, int] = {"sphere": 1, "cylinder": 2, "lying": 2, "cube": 1, "box": 3}
TURNING: tuple[SolidKind, ...] = ("lying", "cube", "box")  # kinds whose outline shows their turn
MAX_POINTS = 96  # outline points kept for one object in one frame
CLEARANCE = 2.5  # px from other objects and from the image border within which an outline is not trusted

_CORNERS = np.array([(i, j, k) for i in (-1.0, 1.0) for j in (-1.0, 1.0) for k in (-1.0, 1.0)])
_EDGES = [(a, b) for a in range(8) for b in range(a) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 2.0]
_RING = np.arange(28) * (2 * np.pi / 28)
_FAN = np.arange(48) * (2 * np.pi / 48)


@dataclass(frozen=True)
class Outline:
    """Points (P, 2) x, y [px] on an object's outline in one frame that show its own edge; share is theirs of all."""

    points: Floats
    share: float


def trusted_outline(labels: NDArray[np.uint8], number: int, behind: frozenset[int]) -> Outline:
    """Return the object's outline against the background and against the objects known to be behind it.

    labels (H, W) holds object numbers, 0 for none. Left out: the image border, edges shared with objects not
    in `behind`, and points within 2.5 px of either.
    """
    mask = labels == number
    if not mask.any():
        return Outline(np.empty((0, 2)), 0.0)
    height, width = labels.shape
    rows, columns = np.nonzero(mask.any(axis=1))[0], np.nonzero(mask.any(axis=0))[0]
    top, bottom = max(rows[0] - 5, 0), min(rows[-1] + 6, height)
    left, right = max(columns[0] - 5, 0), min(columns[-1] + 6, width)
    local, others = mask[top:bottom, left:right], labels[top:bottom, left:right].copy()
    others[local] = 0
    for hidden in behind:
        others[others == hidden] = 0
    points = _cracks(local) + np.array([left, top])
    far = np.full(local.shape, 99.0)
    if others.any():
        far = cv2.distanceTransform((others == 0).astype(np.uint8), cv2.DIST_L2, 5)
    x = np.clip(np.round(points[:, 0]).astype(int) - left, 0, local.shape[1] - 1)
    y = np.clip(np.round(points[:, 1]).astype(int) - top, 0, local.shape[0] - 1)
    inside = (
        (points[:, 0] > CLEARANCE)
        & (points[:, 1] > CLEARANCE)
        & (points[:, 0] < width - 1 - CLEARANCE)
        & (points[:, 1] < height - 1 - CLEARANCE)
    )
    trusted = inside & (far[y, x] > CLEARANCE)
    kept = points[trusted]
    share = float(trusted.mean())
    if len(kept) > MAX_POINTS:
        kept = kept[np.linspace(0, len(kept) - 1, MAX_POINTS).round().astype(int)]
    return Outline(kept, share)


def _cracks(mask: Bools) -> Floats:
    """Midpoints (k, 2) between each inside pixel and its outside neighbours: an outline without bias."""
    padded = np.pad(mask, 1)
    found = []
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        neighbour = padded[1 + dy : padded.shape[0] - 1 + dy, 1 + dx : padded.shape[1] - 1 + dx]
        y, x = np.nonzero(mask & ~neighbour)
        found.append(np.stack([x + 0.5 * dx, y + 0.5 * dy], axis=1))
    points = np.concatenate(found)
    # In order round the middle, so that thinning them out stays even.
    centre = points.mean(axis=0)
    order = np.argsort(np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0]), kind="stable")
    return points[order]


@dataclass(frozen=True)
class Stage:
    """Stage on which solids stand or move: the camera and the plane, with the plane's axes (rows x, y, normal)."""

    camera: Camera
    plane: MotionPlane
    axes: Floats

    @classmethod
    def of(cls, camera: Camera, plane: MotionPlane) -> Stage:
        """Return the stage of a camera and a plane."""
        return cls(camera, plane, plane_axes(plane))

    def centres(self, poses: Floats, lift: float) -> Floats:
        """World positions (..., 3) of centres with poses (..., 3), `lift` above the plane if it supports them."""
        height = lift if self.plane.supports else 0.0
        flat = poses[..., :1] * self.axes[0] + poses[..., 1:2] * self.axes[1]
        moved: Floats = np.asarray(self.plane.point) + flat + height * self.axes[2]
        return moved

    def poses_of(self, pixels: Floats, lift: float) -> Floats:
        """Plane coordinates (..., 2) where the rays of pixels meet the plane of centres."""
        height = lift if self.plane.supports else 0.0
        origin = np.asarray(self.plane.point) + height * self.axes[2]
        hits = self.camera.onto_plane(pixels, origin, self.axes[2]) - np.asarray(self.plane.point)
        flat: Floats = hits @ self.axes[:2].T
        return flat


def lift_of(size: Floats) -> float:
    """Height of a resting solid's centre above its plane [m]."""
    return float(size[-1])


def outline_distance(
    stage: Stage, kind: SolidKind, poses: Floats, size: Floats, points: Floats, lift: float | None = None
) -> Floats:
    """Signed distances (F, P) [px] of points (F, P, 2) from the outlines of a solid in poses (F, 3).

    Positive outside. NaN where the solid is not wholly in front of the camera. The centre is `lift` above the
    plane; by default as the size says.
    """
    lift = lift_of(size) if lift is None else lift
    if kind == "sphere":
        return _sphere_distance(stage, poses, size, points, lift)
    if kind in ("cylinder", "lying"):
        radius, half = (size[0], size[1]) if kind == "cylinder" else (size[1], size[0])
        one, two = radius * np.cos(_RING), radius * np.sin(_RING)
        ends = [np.full(len(_RING), side * half) for side in (-1.0, 1.0)]
        stands = kind == "cylinder"
        body = np.concatenate([np.stack((one, two, end) if stands else (end, one, two), axis=1) for end in ends])
        corners = _project(stage, poses, lift, body)
        axis = corners[:, len(_RING) :].mean(axis=1) - corners[:, : len(_RING)].mean(axis=1)
        across = np.stack([-axis[:, 1], axis[:, 0]], axis=1)
        across /= np.linalg.norm(across, axis=1, keepdims=True) + 1e-12
        fan = np.broadcast_to(np.stack([np.cos(_FAN), np.sin(_FAN)], axis=1), (len(poses), len(_FAN), 2))
        normals = np.concatenate([fan, across[:, None], -across[:, None]], axis=1)
    else:
        half = np.full(3, size[0]) if kind == "cube" else size
        corners = _project(stage, poses, lift, _CORNERS * half)
        along = corners[:, [a for a, _ in _EDGES]] - corners[:, [b for _, b in _EDGES]]
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        across /= np.linalg.norm(across, axis=-1, keepdims=True) + 1e-12
        normals = np.concatenate([across, -across], axis=1)
    support = np.max(normals @ np.swapaxes(corners, 1, 2), axis=2)
    distance: Floats = np.max(points @ np.swapaxes(normals, 1, 2) - support[:, None, :], axis=2)
    return distance


def _sphere_distance(stage: Stage, poses: Floats, size: Floats, points: Floats, lift: float) -> Floats:
    """Exact: the outline is where rays touch the ball, at asin(r / d) from the ray to its centre."""
    camera = stage.camera
    centres = camera.to_camera(stage.centres(poses, lift))
    away = np.linalg.norm(centres, axis=1)
    k = np.asarray(camera.intrinsics)
    rays = np.concatenate([points, np.ones_like(points[..., :1])], axis=-1) @ np.linalg.inv(k).T
    length = np.linalg.norm(rays, axis=-1)
    cosine = np.einsum("fpi,fi->fp", rays, centres) / (length * away[:, None])
    angle = np.arccos(np.clip(cosine, -1, 1))
    touch = np.arcsin(np.clip(size[0] / away, 0, 1))
    # One radian is focal length times |ray| to |ray|^2 pixels, across or along the radius; take the mean power.
    distance: Floats = (angle - touch[:, None]) * k[0, 0] * length**1.5
    distance[centres[:, 2] <= size[0]] = np.nan
    return distance


def _project(stage: Stage, poses: Floats, lift: float, body: Floats) -> Floats:
    """Pixels (F, k, 2) of a solid's own points (k, 3) in poses (F, 3)."""
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    if stage.plane.supports or abs(stage.axes[2, 2]) > 0.7:
        # Turned about the normal, with body z along it.
        x = cosine[:, None] * body[:, 0] - sine[:, None] * body[:, 1]
        y = sine[:, None] * body[:, 0] + cosine[:, None] * body[:, 1]
        z = np.broadcast_to(body[:, 2], x.shape)
    else:
        # In an upright plane bodies stand: body z is the plane's y, and body y points away along the normal.
        x = cosine[:, None] * body[:, 0] - sine[:, None] * body[:, 2]
        y = sine[:, None] * body[:, 0] + cosine[:, None] * body[:, 2]
        z = np.broadcast_to(-body[:, 1], x.shape)
    world = stage.centres(poses, lift)[:, None, :] + np.stack([x, y, z], axis=-1) @ stage.axes
    pixels: Floats = stage.camera.project(world)
    return pixels
