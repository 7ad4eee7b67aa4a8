"""A camera over a floor, from metric depth and the focal length alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.calibration import Calibration, CalibrationError, calibrate_given
from atw_mcp.perception.import_images import DepthMaps
from atw_mcp.perception.masks import Mask

Floats = NDArray[np.float64]
SAMPLES = 400  # planes tried; with a floor over 30% of the image all of them miss it with probability 2e-5
CLOSE = 0.02  # of the median depth: distance within which a point belongs to a plane
LEAST_SHARE = 0.25  # of the image that a floor must take
STRIDE = 4  # [px] of the grid of points looked at


def intrinsics_of(focal: float, size: tuple[int, int]) -> Floats:
    """K of square pixels with the principal point in the middle of an image of (width, height) [px]."""
    width, height = size
    return np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])


def camera_over_floor(depth: DepthMaps, focal: float, objects: Mask | None = None) -> Calibration:
    """Return the camera over the largest plane that is seen, which becomes z = 0.

    The origin is where the image's centre sees that plane, y points away from the camera, z to its side of the plane.
    The depth of a pixel is its median over the frames, since the camera stands still. objects (H, W): pixels to leave
    out. The plane is that of most points within 2% of the median depth (RANSAC, Fischler and Bolles 1981), refined by
    least squares. Raises CalibrationError where no plane takes a quarter of the image, or the centre looks past it.
    """
    height, width = depth.depth.shape[1:]
    grid = np.nanmedian(depth.depth[:, ::STRIDE, ::STRIDE], axis=0).astype(float)
    v, u = np.mgrid[0:height:STRIDE, 0:width:STRIDE]
    usable = np.isfinite(grid)
    if objects is not None:
        usable &= ~objects[::STRIDE, ::STRIDE]
    matrix = intrinsics_of(focal, (width, height))
    rays = np.stack([u, v, np.ones_like(u)], axis=-1).astype(float) @ np.linalg.inv(matrix).T
    points = (rays * grid[..., None])[usable]
    if len(points) < 100:
        raise CalibrationError("the depth maps have too few known pixels for a floor")
    normal, offset, inside = _plane(points, CLOSE * float(np.median(points[:, 2])))
    share = float(inside.sum() / usable.sum())
    if share < LEAST_SHARE:
        raise CalibrationError(
            f"no plane takes a quarter of the image (the largest: {100 * share:.0f}%): give CalibrateCamera points"
        )
    forward = np.array([0.0, 0.0, 1.0])
    if normal @ forward > -0.05:
        raise CalibrationError("the image's centre looks along or past the largest plane: give CalibrateCamera points")
    away = forward - (forward @ normal) * normal
    if np.linalg.norm(away) < 0.05:  # looked at from straight above: up in the image is then away
        away = np.array([0.0, -1.0, 0.0]) + normal[1] * normal
    away /= np.linalg.norm(away)
    rotation = np.stack([np.cross(away, normal), away, normal], axis=1)
    origin = rays[height // STRIDE // 2, width // STRIDE // 2]
    middle = origin * (offset / (origin @ normal))
    made = calibrate_given(matrix, rotation, middle, (width, height))
    rms = float(np.sqrt(np.mean((points[inside] @ normal - offset) ** 2)))
    tilt = float(np.degrees(np.arcsin(np.clip(-normal[2], -1.0, 1.0))))
    warnings = (
        f"the largest plane ({100 * share:.0f}% of the image, {rms:.2g} m rms, looked down upon at {tilt:.0f} degrees) "
        "is taken for the floor; a wall would be taken for it too",
        "the scale is the model's own: an object or distance of known size should confirm it",
    )
    return Calibration(made.camera, (), None, "floor seen in predicted depth", warnings)


def _plane(points: Floats, close: float) -> tuple[Floats, float, NDArray[np.bool_]]:
    """Unit normal towards the camera, offset along it, and which points lie in the plane."""
    rng = np.random.default_rng(0)
    picks = points[rng.integers(0, len(points), (SAMPLES, 3))]
    normals = np.cross(picks[:, 1] - picks[:, 0], picks[:, 2] - picks[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0] / lengths[lengths > 0, None]
    offsets = (normals * picks[lengths > 0, 0]).sum(axis=1)
    counts = [int((np.abs(points @ n - d) < close).sum()) for n, d in zip(normals, offsets, strict=True)]
    best = int(np.argmax(counts))
    normal, offset = normals[best], float(offsets[best])
    for _ in range(3):
        inside = np.abs(points @ normal - offset) < close
        centre = points[inside].mean(axis=0)
        normal = np.linalg.svd(points[inside] - centre, full_matrices=False)[2][-1]
        offset = float(centre @ normal)
    if offset > 0:  # the camera, at 0, must lie on the side the normal points to
        normal, offset = -normal, -offset
    return normal, offset, np.abs(points @ normal - offset) < close
