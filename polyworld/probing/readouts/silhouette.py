"""The image of a deformable object: how much of each cell of the image it covers, by points spread over its surface.

Sampled rather than drawn: a batch of worlds is projected in one operation, and coverage changes continuously with every
parameter, so that it has derivatives a fit can use. Samples are discs with soft edges, grown by one cell so that
neighbours close up, and their union is shrunk again. Samples lie closer together than cells in the first frame;
strongly stretched parts may show holes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.model import DeformableMesh
from polyworld.world.camera import Camera

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FINE = 3  # cells of the sampled image along one of the cells that are reported
GAP = 0.8  # of the distance between a fluid's particles, which are not in perfect order
# Weight with which edges of every slant are moved by one cell on average: the four neighbours alone move an edge at
# angle a by cos a, all eight by cos a + sin a.
SLANTING = 0.3
MOST_PARTS = 24  # samples along an edge of a triangle or a segment
MOST_POINTS = 1_000_000  # projected at a time
SPACING = 0.9  # of samples, in fine cells: the gaps between soft discs of radius 1 then close


@dataclass(frozen=True)
class SurfaceSamples:
    """Points of a surface as weighted means of nodes: nodes (s, n), weights (s, n); radius (s,) about each [m]."""

    nodes: NDArray[np.int64]
    weights: Array
    radius: Array

    def places(self, points: Array) -> Array:
        """Where the samples are (..., s, 3), from the places of the nodes (..., k, 3)."""
        result: Array = np.einsum("sn,...snd->...sd", self.weights, points[..., self.nodes, :])
        return result


def surface_samples(mesh: DeformableMesh, spacing: float, count: int) -> SurfaceSamples:
    """Samples no further than `spacing` [m] apart: along segments, over triangles, or at each of `count` particles."""
    radius = np.concatenate([mesh.radius, np.full(max(count - len(mesh.radius), 0), _median(mesh.radius))])
    if len(mesh.triangles):  # their surface is that of the triangles
        radius = np.zeros_like(radius)
    if len(mesh.triangles):
        triangles = mesh.triangles.astype(np.int64)
        corners = mesh.nodes[triangles]
        longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
        grid = _barycentric(_parts(longest, spacing))
        nodes, weights = np.repeat(triangles, len(grid), axis=0), np.tile(grid, (len(triangles), 1))
        # Neighbouring triangles share the samples on their edge.
        places = np.einsum("sn,snd->sd", weights, mesh.nodes[nodes])
        _, first = np.unique(np.round(places / (1e-6 * max(longest, 1e-12))), axis=0, return_index=True)
        nodes, weights = nodes[np.sort(first)], weights[np.sort(first)]
    elif len(mesh.segments):
        segments = mesh.segments.astype(np.int64)
        longest = float(np.linalg.norm(mesh.nodes[segments[:, 1]] - mesh.nodes[segments[:, 0]], axis=1).max())
        share = (np.arange(_parts(longest, spacing)) + 0.5) / _parts(longest, spacing)
        grid = np.stack([1.0 - share, share], axis=1)
        nodes, weights = np.repeat(segments, len(grid), axis=0), np.tile(grid, (len(segments), 1))
    else:
        nodes, weights = np.arange(count)[:, None], np.ones((count, 1))
    return SurfaceSamples(nodes, weights, radius[nodes].mean(axis=1))


def image_occupancy(
    points: Array, mesh: DeformableMesh, camera: Camera, columns: int, rows: int, *, fine: int = FINE
) -> Array:
    """Share (..., rows, columns) of each cell of a grid over the image that an object covers; points (..., k, 3)."""
    leading = points.shape[:-2]
    flat = points.reshape(-1, *points.shape[-2:])
    if _is_cloud(mesh):  # cells that are too fine would show the gaps between particles
        coarse = min(camera.width / columns, camera.height / rows)
        fine = int(np.clip(coarse / _gap(mesh, camera, flat), 1, fine))
    cell = np.array([camera.width / (columns * fine), camera.height / (rows * fine)])  # [px]
    focal, depth = _scale(camera, flat)
    samples = surface_samples(mesh, SPACING * float(cell.min()) * depth / focal, points.shape[-2])
    covered = np.empty((len(flat), rows * fine, columns * fine))
    step = max(1, MOST_POINTS // max(len(samples.nodes), 1))
    for begin in range(0, len(flat), step):
        places = samples.places(flat[begin : begin + step])
        away = np.maximum(camera.to_camera(places)[..., 2], 1e-9)
        at = (camera.project(places) + 0.5) / cell  # a pixel's middle has whole coordinates
        radius = samples.radius * focal / away / np.sqrt(cell.prod())
        covered[begin : begin + step] = _shrunk(_soft_discs(at, radius + 1.0, rows * fine, columns * fine))
    blocks = covered.reshape(-1, rows, fine, columns, fine)
    share: Array = blocks.mean(axis=(2, 4))
    return share.reshape(*leading, rows, columns)


def silhouette(points: Array, mesh: DeformableMesh, camera: Camera) -> Bools:
    """The mask (height, width) of an object at places (k, 3): pixels of which it covers half or more.

    Of a fluid in blocks as large as the gaps between its particles.
    """
    block = max(1, round(_gap(mesh, camera, points[None]))) if _is_cloud(mesh) else 1
    columns, rows = -(-camera.width // block), -(-camera.height // block)
    whole = camera.model_copy(update={"width": columns * block, "height": rows * block})
    covered: Bools = image_occupancy(points, mesh, whole, columns, rows, fine=1) >= 0.5
    return np.kron(covered, np.ones((block, block), dtype=bool))[: camera.height, : camera.width]


def _soft_discs(at: Array, radius: Array, height: int, width: int) -> Array:
    """Union (f, height, width) of discs about points at (f, s, 2), in cells, of radius (f, s).

    1 inside, 0 outside, linear between over one cell.
    """
    frames = len(at)
    image = np.zeros(frames * height * width)
    known = np.isfinite(at).all(axis=-1) & np.all(
        (at > -radius[..., None]) & (at < [width, height] + radius[..., None]), axis=-1
    )
    frame, _ = np.nonzero(known)
    centres, radii = at[known], radius[known]
    base = np.floor(centres).astype(np.int64)
    reach = int(np.ceil(radii.max(initial=0.0) + 0.5))
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            x, y = base[:, 0] + dx, base[:, 1] + dy
            distance = np.hypot(x + 0.5 - centres[:, 0], y + 0.5 - centres[:, 1])
            cover = np.minimum(radii + 0.5 - distance, 1.0)
            chosen = (cover > 0.0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
            index = (frame[chosen] * height + y[chosen]) * width + x[chosen]
            np.maximum.at(image, index, cover[chosen])
    return image.reshape(frames, height, width)


def _shrunk(image: Array) -> Array:
    """The image (f, h, w) with everything in it one cell smaller, as a continuous function of it.

    Between the least over the four nearest neighbours, which cuts slanting edges less, and that over all eight, which
    cuts them more. What leaves through the border goes on beyond it.
    """
    padded = np.pad(image, ((0, 0), (1, 1), (1, 1)), mode="edge")
    rows, columns = image.shape[1:]

    def moved(dy: int, dx: int) -> Array:
        return padded[:, 1 + dy : 1 + dy + rows, 1 + dx : 1 + dx + columns]

    cross = np.minimum(np.minimum(moved(1, 0), moved(-1, 0)), np.minimum(moved(0, 1), moved(0, -1)))
    cross = np.minimum(cross, image)
    corners = np.minimum(np.minimum(moved(1, 1), moved(-1, 1)), np.minimum(moved(1, -1), moved(-1, -1)))
    shrunk: Array = (1.0 - SLANTING) * cross + SLANTING * np.minimum(cross, corners)
    return shrunk


def _is_cloud(mesh: DeformableMesh) -> bool:
    """Whether an object is particles without elements between them."""
    return not len(mesh.triangles) and not len(mesh.segments)


def _gap(mesh: DeformableMesh, camera: Camera, points: Array) -> float:
    """Size of the gaps between a fluid's particles, which growing and shrinking by as much closes [px]."""
    focal, depth = _scale(camera, points)
    return max(GAP * 2.0 * _median(mesh.radius) * focal / depth, 1e-9)


def _parts(longest: float, spacing: float) -> int:
    return int(np.clip(np.ceil(longest / max(spacing, 1e-12)), 1, MOST_PARTS))


def _barycentric(parts: int) -> Array:
    # Corners and all points between them, so that borders are sampled too.
    i, j = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1), indexing="ij")
    keep = i + j <= parts
    a, b = i[keep] / parts, j[keep] / parts
    return np.stack([a, b, 1.0 - a - b], axis=1)


def _scale(camera: Camera, points: Array) -> tuple[float, float]:
    """Focal length [px] and a typical depth of the points [m]."""
    depth = camera.to_camera(points[:: max(1, len(points) // 16)])[..., 2]
    typical = float(np.median(depth[np.isfinite(depth) & (depth > 0.0)])) if np.any(depth > 0.0) else 1.0
    return float(camera.intrinsics[0][0]), typical


def _median(values: Array) -> float:
    return float(np.median(values)) if len(values) else 0.0
