"""Motion in space from masks and depth: where depth is known, nothing has to be assumed about the floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.import_images import DepthMaps
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject, check_camera
from atw_mcp.perception.tracks import nowhere
from atw_mcp.perception.video import Cancelled, Progress, report
from polyworld.data.tracks import ObservedTracks
from polyworld.world.camera import Camera
from polyworld.world.geometry import hull, mass_properties
from polyworld.world.shapes import BodyShape, Box, Capsule, ConvexMesh, Cylinder, Sphere

Floats = NDArray[np.float64]

LEAST_PIXELS = 12  # with known depth, below which a frame says too little
OUTLIER = 4.0  # scaled median deviations beyond which a pixel's depth belongs to something else
PIXEL_SIGMA = 0.3  # [px] of a centroid of a mask
OFFSET_SIGMA = 0.25  # of the offset from visible surface to centre, for shapes that look different from each side


def depth_tracks(
    observation: ImageObservation,
    camera: Camera,
    depth: DepthMaps,
    shapes: Mapping[str, BodyShape] | None = None,
    *,
    seconds_per_frame: float,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[ObservedTracks, dict[str, BodyShape]]:
    """Positions of all objects, and the shapes they were measured with.

    The centre of an object lies behind the centroid of its visible surface, by half the mean chord of its shape:
    2 V / S for a convex body (Cauchy), exact for a ball. Shapes not given follow from the mean projected area,
    S / 4 for a convex body, and the kind the object looks like. Orientations are not measured. Frames in which an
    object is truncated, or occluded by less than half, count with lower confidence. Raises ObservationError
    where depth, camera and video do not belong together.
    """
    check_camera(camera, observation.video)
    size = (observation.video.width, observation.video.height)
    if depth.depth.shape[1:] != (size[1], size[0]):
        height, width = depth.depth.shape[1:]
        raise ObservationError(f"the depth maps are {width} x {height}, the video is {size[0]} x {size[1]}")
    rows = {frame: row for row, frame in enumerate(depth.frames)}
    if not set(rows) & set(observation.frames):
        raise ObservationError(f"depth is of frames {depth.frames[0]}..{depth.frames[-1]}, none of which was observed")
    chosen: dict[str, BodyShape] = dict(shapes or {})
    count, n = len(observation.frames), len(observation.objects)
    positions, sigma = np.full((count, n, 3), np.nan), np.full((count, n), np.nan)
    confidence = np.zeros((count, n))
    for column, observed in enumerate(observation.objects):
        report(progress, cancelled, column / n, f"positions of {observed.name}")
        surfaces = {
            t: _surface(observed, t, depth.depth[rows[frame]], camera)
            for t, frame in enumerate(observation.frames)
            if frame in rows
        }
        if observed.name not in chosen:
            areas = [s[2] for t, s in surfaces.items() if s is not None and observed.status[t] == "visible"]
            if not areas:
                continue
            chosen[observed.name] = shape_of_area(observed.shape.name, float(np.median(areas)))
        offset, offset_sigma = centre_offset(chosen[observed.name])
        for t, found in surfaces.items():
            if found is None:
                continue
            centroid, noise, _, share = found
            away = centroid - camera.centre
            positions[t, column] = centroid + offset * away / np.linalg.norm(away)
            lateral = PIXEL_SIGMA * float(np.linalg.norm(away)) / camera.intrinsics[0][0]
            sigma[t, column] = float(np.sqrt(noise**2 + lateral**2 + offset_sigma**2))
            whole = 1.0 if observed.status[t] == "visible" else 0.5
            confidence[t, column] = round(float(observed.confidence[t]) * share * whole, 4)
    known = np.isfinite(positions).all(axis=2)
    sure = np.where(known, confidence, 0.0)
    tracks = nowhere(observation, seconds_per_frame)
    tracks = replace(tracks, positions=positions, position_sigma=sigma, confidence=sure)
    return tracks, chosen


def centre_offset(shape: BodyShape) -> tuple[float, float]:
    """Distance from the centroid of the visible surface to the centre, and its standard deviation [m]."""
    offset = 2.0 * mass_properties(shape).volume / surface_area(shape)
    return offset, 0.02 * offset if isinstance(shape, Sphere) else OFFSET_SIGMA * offset


def surface_area(shape: BodyShape) -> float:
    """Surface of a solid [m^2]."""
    if isinstance(shape, Sphere):
        return 4.0 * np.pi * shape.radius**2
    if isinstance(shape, Box):
        a, b, c = shape.half_extents
        return 8.0 * (a * b + b * c + c * a)
    if isinstance(shape, Cylinder):
        return 2.0 * np.pi * shape.radius * (shape.radius + 2.0 * shape.half_height)
    if isinstance(shape, Capsule):
        return 4.0 * np.pi * shape.radius * (shape.radius + shape.half_height)
    assert isinstance(shape, ConvexMesh)
    return float(hull(shape).area)


def shape_of_area(kind: str, area: float) -> BodyShape:
    """Return the solid of a kind (cube, cylinder as high as wide, else a ball) with a mean projected area [m^2]."""
    if kind in ("cube", "box"):
        half = float(np.sqrt(area / 6.0))  # S / 4 = 6 a^2 for half edge a
        return Box(half_extents=(half, half, half))
    if kind == "cylinder":
        radius = float(np.sqrt(area / (1.5 * np.pi)))  # S / 4 = 6 pi r^2 / 4 for h = r
        return Cylinder(radius=radius, half_height=radius)
    return Sphere(radius=float(np.sqrt(area / np.pi)))


def _surface(
    observed: ObservedObject,
    row: int,
    depth: NDArray[np.float32],
    camera: Camera,
) -> tuple[Floats, float, float, float] | None:
    """Centroid of the visible surface (3,) [m], its noise [m], projected area [m^2], share of pixels with depth."""
    stored = observed.masks[row]
    if stored is None:
        return None
    mask = stored.decode()
    known = mask & np.isfinite(depth)
    if known.sum() < LEAST_PIXELS:
        return None
    v, u = np.nonzero(known)
    z = depth[v, u].astype(float)
    middle = float(np.median(z))
    spread = 1.4826 * float(np.median(np.abs(z - middle)))
    keep = np.abs(z - middle) <= OUTLIER * max(spread, 1e-6 * middle)
    rays = camera.rays(np.stack([u, v], axis=1)[keep].astype(float))
    along = z[keep] / (rays @ np.asarray(camera.rotation)[2])  # of a ray, to a distance along the camera's axis
    centroid = camera.centre + (along[:, None] * rays).mean(axis=0)
    noise = spread / np.sqrt(keep.sum())
    # A pixel at depth z covers (z / f)^2 across the line of sight.
    area = float(mask.sum()) * float(np.mean(z[keep])) ** 2 / (camera.intrinsics[0][0] * camera.intrinsics[1][1])
    return centroid, noise, area, float(known.sum() / mask.sum())
