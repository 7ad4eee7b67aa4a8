"""Bodies that are known before a video is looked at, and how large they look in each part of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Array32
from polyworld.camera import Camera

Floats = NDArray[np.float64]

NEARER = 0.75  # of the distance from the camera to the nearest known place, at which a body may still be
FARTHER = 1.15  # of that to the farthest


@dataclass(frozen=True)
class KnownBody:
    """A rigid body of a scene. colour: a description that holds a colour's name; radius: of the disc with the area that
    it shows [m]; lift: height of its centre where it rests on the floor [m]; pixels: places on it (x, y) [px] by row.
    """

    name: str
    colour: str
    radius: float
    lift: float
    pixels: tuple[tuple[int, float, float], ...] = ()


@dataclass(frozen=True)
class Sizes:
    """Radius [px] that a body has in the image: on_floor (H, W) where it rests on the floor, largest at the nearest
    place."""

    on_floor: Array32
    largest: float


def sizes_of(body: KnownBody, camera: Camera, places: Floats, shape: tuple[int, int]) -> Sizes:
    """Return how large a body looks in images of `shape` (H, W), perhaps reduced from the camera's.

    places (k, 3): known points of the scene [m], between the nearest and farthest of which bodies are.
    """
    height, width = shape
    reduced = camera.width / width
    v, u = np.mgrid[0:height, 0:width]
    pixels = np.stack([(u + 0.5) * reduced - 0.5, (v + 0.5) * reduced - 0.5], axis=-1).astype(float)
    hits = camera.onto_plane(pixels, np.array([0.0, 0.0, body.lift]), np.array([0.0, 0.0, 1.0]))
    depths = camera.to_camera(places)[:, 2]
    near, far = NEARER * float(depths.min()), FARTHER * float(depths.max())
    depth = camera.to_camera(hits)[..., 2]
    depth = np.clip(np.where(np.isfinite(depth) & (depth > 0.0), depth, far), near, far)
    focal = float(np.asarray(camera.intrinsics)[0, 0]) / reduced
    return Sizes((focal * body.radius / depth).astype(np.float32), focal * body.radius / near)
