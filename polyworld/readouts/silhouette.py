"""The image of a deformable object: which pixels it covers, by points spread over its surface and projected.

Sampled rather than drawn: a batch of worlds is projected in one operation. Points lie closer together than the pixels
they fill (in the first frame; strongly stretched parts may show holes, which coarse cells hardly notice).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.camera import Camera
from polyworld.meshing import DeformableMesh

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FINE = 4  # cells of the sampled image along one of the cells that are reported
MOST_PARTS = 24  # samples along an edge of a triangle or a segment
MOST_POINTS = 3_000_000  # projected at a time


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
    cell = np.array([camera.width / (columns * fine), camera.height / (rows * fine)])  # [px]
    focal, depth = _scale(camera, flat)
    samples = surface_samples(mesh, 0.7 * float(cell.min()) * depth / focal, points.shape[-2])
    most = float(samples.radius.max(initial=0.0)) * focal / depth
    disc = _disc(most, cell)
    covered = np.zeros((len(flat), rows * fine * columns * fine), dtype=bool)
    step = max(1, MOST_POINTS // max(len(samples.nodes) * len(disc), 1))
    for begin in range(0, len(flat), step):
        part = flat[begin : begin + step]
        places = samples.places(part)
        pixels = camera.project(places)
        away = np.maximum(camera.to_camera(places)[..., 2], 1e-9)
        spread = samples.radius * focal / away  # [px]
        for offset in disc:
            at = (pixels + offset * spread[..., None]) / cell
            known = np.isfinite(at).all(axis=-1)
            index = np.floor(np.where(known[..., None], at, -1.0)).astype(np.int64)
            inside = np.all((index >= 0) & (index < [columns * fine, rows * fine]), axis=-1)
            frame, _ = np.nonzero(inside)
            chosen = index[inside]
            covered[begin + frame, chosen[:, 1] * (columns * fine) + chosen[:, 0]] = True
    blocks = _half_at_border(covered.reshape(-1, rows * fine, columns * fine)).reshape(-1, rows, fine, columns, fine)
    share: Array = blocks.mean(axis=(2, 4))
    return share.reshape(*leading, rows, columns)


def silhouette(points: Array, mesh: DeformableMesh, camera: Camera) -> Bools:
    """The mask (height, width) of an object at places (k, 3): pixels that it covers at all."""
    covered: Bools = image_occupancy(points, mesh, camera, camera.width, camera.height, fine=1) > 0.0
    return covered


def intersection_over_union(a: Array, b: Array) -> Array:
    """Overlap (...) of two coverages (..., rows, columns), 0..1: sum of minima over sum of maxima (Ruzicka); NaN
    where both are empty."""
    union = np.maximum(a, b).sum(axis=(-2, -1), dtype=float)
    shared = np.minimum(a, b).sum(axis=(-2, -1), dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        overlap: Array = np.where(union > 0.0, shared / union, np.nan)
    return overlap


def _half_at_border(covered: Bools) -> Array:
    """Coverage (f, h, w) of cells that hold samples: a half where a neighbour holds none, since there the outline runs
    through the cell. Beyond the image it goes on."""
    padded = np.pad(covered, ((0, 0), (1, 1), (1, 1)), mode="edge")
    inner = covered & padded[:, 2:, 1:-1] & padded[:, :-2, 1:-1] & padded[:, 1:-1, 2:] & padded[:, 1:-1, :-2]
    return 0.5 * covered + 0.5 * inner


def _parts(longest: float, spacing: float) -> int:
    return int(np.clip(np.ceil(longest / max(spacing, 1e-12)), 1, MOST_PARTS))


def _barycentric(parts: int) -> Array:
    # Corners and all points between them, so that borders are sampled too.
    i, j = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1), indexing="ij")
    keep = i + j <= parts
    a, b = i[keep] / parts, j[keep] / parts
    return np.stack([a, b, 1.0 - a - b], axis=1)


def _disc(radius: float, cell: Array) -> Array:
    """Offsets (d, 2) in a unit disc, close enough to fill one of `radius` px on cells of `cell` px."""
    across = int(np.clip(np.ceil(2.0 * radius / float(cell.min())), 1, 9))
    if across == 1:
        return np.zeros((1, 2))
    line = np.linspace(-1.0, 1.0, across + 1)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    offsets: Array = grid[(grid**2).sum(axis=1) <= 1.0 + 1e-9]
    return offsets


def _scale(camera: Camera, points: Array) -> tuple[float, float]:
    """Focal length [px] and a typical depth of the points [m]."""
    depth = camera.to_camera(points[:: max(1, len(points) // 16)])[..., 2]
    typical = float(np.median(depth[np.isfinite(depth) & (depth > 0.0)])) if np.any(depth > 0.0) else 1.0
    return float(camera.intrinsics[0][0]), typical


def _median(values: Array) -> float:
    return float(np.median(values)) if len(values) else 0.0
