"""Bodies that are known before a video is looked at, how large they look in each part of the image, and what may hide
them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from atw_mcp.perception.background import Array32, Mask
from atw_mcp.perception.known.settings import SETTINGS
from polyworld.world.camera import Camera

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class KnownBody:
    """A rigid body of a scene. colour: a description that holds a colour's name; radius: of the disc with the area that
    it shows [m]; lift: height of its centre where it rests on the floor [m]; pixel: a place (x, y) on it [px] in
    `frame` of the video, or in the first that shows it where that is None.
    """

    name: str
    colour: str
    radius: float
    lift: float
    pixel: tuple[float, float] | None = None
    frame: int | None = None


@dataclass(frozen=True)
class Sizes:
    """Radius [px] that a body has in the image: on_floor (H, W) where it rests on the floor, largest at the nearest
    place. floor (H, W): whether the floor is there, within reach; radius: the body's own [m]; focal: length [px], by
    which both give the distance [m]; farthest: of distances [m]."""

    on_floor: Array32
    largest: float
    floor: Mask
    radius: float
    focal: float
    farthest: float


def sizes_of(body: KnownBody, camera: Camera, places: Floats, shape: tuple[int, int], floor: float = 0.0) -> Sizes:
    """Return how large a body looks in images of `shape` (H, W), perhaps reduced from the camera's.

    places (k, 3): known points of the scene [m], between the nearest and farthest of which bodies are. floor: its z
    [m].
    """
    pixels, reduced = _pixels(camera, shape)
    hits = camera.onto_plane(pixels, np.array([0.0, 0.0, floor + body.lift]), np.array([0.0, 0.0, 1.0]))
    depths = camera.to_camera(places)[:, 2]
    near, far = SETTINGS.nearer_than * float(depths.min()), SETTINGS.farther_than * float(depths.max())
    depth = camera.to_camera(hits)[..., 2]
    there = np.isfinite(depth) & (depth > 0.0) & (depth <= far)
    depth = np.clip(np.where(there, depth, far), near, far)
    focal = float(np.asarray(camera.intrinsics)[0, 0]) / reduced
    size = focal * body.radius
    return Sizes((size / depth).astype(np.float32), size / near, there, body.radius, focal, far)


def fixture_depths(fixtures: Sequence[Floats], camera: Camera, shape: tuple[int, int]) -> Array32:
    """Return the distance along the camera's axis (H, W) [m] of the nearest convex solid, infinite where there is none.

    fixtures: corners (n, 3) of each [m]. A ray enters a convex solid at the last of the planes that it crosses inwards,
    and misses it where it crosses one outwards before (Cyrus & Beck 1978, Computers & Graphics 3:23).
    """
    nearest = np.full(shape, np.inf)
    pixels, _ = _pixels(camera, shape)
    rays = camera.rays(pixels)
    rays = rays / (camera.to_camera(camera.centre + rays)[..., 2:])
    for corners in fixtures:
        planes = ConvexHull(corners).equations
        enter, leave = np.zeros(shape), np.full(shape, np.inf)
        for plane in planes:
            towards = rays @ plane[:3]
            with np.errstate(divide="ignore", invalid="ignore"):
                crossed = -(float(plane[:3] @ camera.centre) + plane[3]) / towards
            enter = np.where(towards < 0.0, np.maximum(enter, crossed), enter)
            leave = np.where(towards > 0.0, np.minimum(leave, crossed), leave)
        nearest = np.where((enter < leave) & (enter > 0.0), np.minimum(nearest, enter), nearest)
    return np.asarray(nearest, dtype=np.float32)


def _pixels(camera: Camera, shape: tuple[int, int]) -> tuple[Floats, float]:
    """Pixels (H, W, 2) of the camera at those of an image of `shape`, and by how much that is reduced."""
    height, width = shape
    reduced = camera.width / width
    v, u = np.mgrid[0:height, 0:width]
    return np.stack([(u + 0.5) * reduced - 0.5, (v + 0.5) * reduced - 0.5], axis=-1).astype(float), reduced
