"""The surface of a liquid around its particles: where points are as far from the weighted mean of the particles
near them as a drawn particle is large (Zhu and Bridson 2005), found by marching cubes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from polyworld.pictures.scene import DEVICE, Surface, smooth_surface
from polyworld.world.representations.fluid import FluidGrid

Array = NDArray[np.float64]

BALL = 0.85  # radius of a drawn particle, in spacings of the particles
SMOOTH = 0.6  # width of the weights, in spacings: a flat surface then lies where that of balls would
NODES = 2  # nodes of the marched grid along a spacing


def liquid_surface(points: Array, grid: FluidGrid) -> Surface:
    """Return the closed surface around particles (k, 3) [m], NaN for those not there; inside a closed grid's box."""
    from warp.geometry import IsoSurfaceMarchingCubes, sparse_marching_cubes_from_cells  # heavy: fluids alone need it

    points = points[np.all(np.isfinite(points), axis=1)]
    if not len(points):
        return smooth_surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32), liquid=True)
    step = grid.cell / 2.0 / NODES
    radius, width, margin = BALL * NODES, SMOOTH * NODES, 2 * NODES  # in steps; no surface reaches the margin's end
    lower = points.min(axis=0) - margin * step
    shape = np.ceil(np.ptp(points, axis=0) / step).astype(int) + 2 * margin + 1
    local = (points - lower) / step
    node = np.ravel_multi_index(tuple(np.rint(local).astype(int).T), tuple(shape))

    def spread(weights: Array | None) -> NDArray[np.float32]:
        total = np.bincount(node, weights, minlength=int(shape.prod())).astype(np.float32).reshape(shape)
        return np.asarray(gaussian_filter(total, width, mode="constant", truncate=2.5))

    weight = spread(None)
    single = np.exp(-0.5 * (1.5 * radius / width) ** 2) / (np.sqrt(2.0 * np.pi) * width) ** 3  # of one particle
    near = np.nonzero(weight > single)
    away = sum((spread(local[:, axis])[near] / weight[near] - near[axis]) ** 2 for axis in range(3))
    field = np.full(shape, -radius, dtype=np.float32)
    field[near] = radius - np.sqrt(away)

    corners = IsoSurfaceMarchingCubes.CUBE_CORNER_OFFSETS
    inside = [(field > 0.0)[tuple(slice(o, o + n - 1) for o, n in zip(c, shape, strict=True))] for c in corners]
    cells = np.argwhere(np.any(inside, axis=0) & ~np.all(inside, axis=0)).astype(np.int32)
    values = np.stack([field[tuple((cells + corner).T)] for corner in corners], axis=1)
    surface: Any = sparse_marching_cubes_from_cells(cells, values, device=DEVICE)
    vertices, indices = (array.numpy() for array in surface)
    places = lower + step * vertices.astype(float)
    if grid.closed:
        places = np.clip(places, grid.lower, grid.upper)
    return smooth_surface(places, indices.reshape(-1, 3)[:, ::-1], liquid=True)
