"""The surface of a liquid around its particles: where points are as far from the weighted mean of the particles
near them as a drawn particle is large (Zhu and Bridson 2005), found by marching cubes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from polyworld.core import buffers
from polyworld.pictures.scene import Surface, smooth_surface
from polyworld.world.representations.fluid import FluidGrid

Array = NDArray[np.float64]

BALL = 0.85  # radius of a drawn particle, in spacings of the particles
SMOOTH = 0.6  # width of the weights, in spacings: a flat surface then lies where that of balls would
_CUT = 2.5  # widths beyond which weights are zero
NODES = 2  # nodes of the marched grid along a spacing
BLOCK = 48  # cells along an edge of the blocks that the grid is marched in: memory follows the fluid, not its box


def liquid_surface(points: Array, grid: FluidGrid) -> Surface:
    """Return the closed surface around particles (k, 3) [m], NaN for those not there; inside a closed grid's box."""
    from warp.geometry import sparse_marching_cubes_from_cells  # heavy, and only worlds with fluids need it

    points = points[np.all(np.isfinite(points), axis=1)]
    if not len(points):
        return smooth_surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32), liquid=True)
    step, reach = grid.cell / 2.0 / NODES, int(np.ceil(_CUT * SMOOTH * NODES))
    margin = reach + 1  # the surface lies within the reach of the weights
    lower = points.min(axis=0) - margin * step
    local = (points - lower) / step
    nodes = np.rint(local).astype(int)
    size = nodes.max(axis=0) + margin  # in cells
    cells, values = [], []
    for block in np.ndindex(*-(-size // BLOCK)):
        first = BLOCK * np.array(block)
        last = np.minimum(first + BLOCK, size)
        begin, end = np.maximum(first - reach, 0), np.minimum(last + reach, size)
        near = np.all((nodes >= begin) & (nodes <= end), axis=1)
        if near.any():
            field = _field(local[near] - begin, nodes[near] - begin, end - begin + 1)
            own = tuple(slice(a, b + 1) for a, b in zip(first - begin, last - begin, strict=True))
            crossed, corner_values = _crossed_cells(field[own])
            cells.append(crossed + first)
            values.append(corner_values)
    with buffers.running():
        surface: Any = sparse_marching_cubes_from_cells(
            np.concatenate(cells).astype(np.int32), np.concatenate(values), device=buffers.device()
        )
    vertices, indices = (buffers.read(array) for array in surface)
    places = lower + step * vertices.astype(float)
    if grid.closed:
        places = np.clip(places, grid.lower, grid.upper)
    return smooth_surface(places, indices.reshape(-1, 3)[:, ::-1], liquid=True)


def _field(local: Array, nodes: NDArray[np.int64], shape: NDArray[np.int64]) -> NDArray[np.float32]:
    """Depth below the surface around particles (k, 3) at every node of a grid, all lengths in its steps."""
    radius, width = BALL * NODES, SMOOTH * NODES
    flat = np.ravel_multi_index(tuple(nodes.T), tuple(shape))

    def spread(weights: Array | None) -> NDArray[np.float32]:
        total = np.bincount(flat, weights, minlength=int(shape.prod())).astype(np.float32).reshape(shape)
        return np.asarray(gaussian_filter(total, width, mode="constant", truncate=_CUT))

    weight = spread(None)
    single = np.exp(-0.5 * (1.5 * radius / width) ** 2) / (np.sqrt(2.0 * np.pi) * width) ** 3  # of one particle
    near = np.nonzero(weight > single)
    away = sum((spread(local[:, axis])[near] / weight[near] - near[axis]) ** 2 for axis in range(3))
    field = np.full(shape, -radius, dtype=np.float32)
    field[near] = radius - np.sqrt(away)
    return field


def _crossed_cells(field: NDArray[np.float32]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Cells (n, 3) of a grid that the surface crosses and the field (n, 8) at their corners."""
    from warp.geometry import IsoSurfaceMarchingCubes

    corners = IsoSurfaceMarchingCubes.CUBE_CORNER_OFFSETS
    inside = field > 0.0
    at = [inside[tuple(slice(o, o + n - 1) for o, n in zip(c, field.shape, strict=True))] for c in corners]
    cells = np.argwhere(np.any(at, axis=0) & ~np.all(at, axis=0))
    return cells, np.stack([field[tuple((cells + corner).T)] for corner in corners], axis=1)
