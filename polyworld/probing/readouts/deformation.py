"""How much an object is deformed as a whole: extents along directions, principal stretches, folds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from polyworld.model import DeformableMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# Two points of a cloth lie on each other when they are nearer than this share of their distance on the flat sheet.
TOGETHER = 0.25
# ... and when that distance on the sheet is at least this share of its size.
APART = 0.15
FOLD_POINTS = 300  # points of a cloth that are compared with each other


def reach(points: Array, directions: Array) -> Array:
    """Support function (..., D) of point sets (..., k, d) along unit vectors (D, d); NaN points do not count."""
    along = points @ directions.T
    reached: Array = np.max(np.where(np.isfinite(along), along, -np.inf), axis=-2)
    return np.where(np.isfinite(reached), reached, np.nan)


def extent(points: Array, directions: Array) -> Array:
    """Widths (..., D) of point sets (..., k, d) along unit vectors (D, d)."""
    return reach(points, directions) + reach(points, -directions)


def mean_deformation(points: Array, rest: Array, weights: Array) -> Array:
    """The deformation gradient F (..., 3, 3) that best maps rest points (k, 3) on points (..., k, 3).

    Weighted least squares about the centres: F = (sum w x X') (sum w X X')^-1, in the directions that the rest
    points span; the identity's part in the others is left out (a flat sheet has two stretches).
    """
    share = weights / weights.sum()
    centred = rest - share @ rest
    moved = points - np.einsum("k,...kd->...d", share, points)[..., None, :]
    moments = np.einsum("k,ki,kj->ij", share, centred, centred)
    inverse = np.linalg.pinv(moments, rcond=1e-6, hermitian=True)
    gradient: Array = np.einsum("k,...ki,kj->...ij", share, moved, centred) @ inverse
    return gradient


def principal_stretches(points: Array, rest: Array, weights: Array) -> Array:
    """Principal stretches (..., 3) of the mean deformation, largest first; 1 where nothing is deformed.

    Directions that the rest points do not span have stretch 0.
    """
    gradient = mean_deformation(points, rest, weights)
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(gradient).all(axis=(-2, -1)))
    known: Array = np.where(finite[..., None, None], gradient, 0.0)
    values = np.linalg.svd(known, compute_uv=False).astype(np.float64)
    return np.where(finite[..., None], values, np.nan)


def evenly_chosen(points: Array, count: int) -> Ints:
    """Indices (count,) of points (k, d) spread evenly: each next one is farthest from those chosen (Gonzalez 1985)."""
    count = min(count, len(points))
    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1)))
    away = ((points - points[chosen[0]]) ** 2).sum(axis=1)
    for i in range(1, count):
        chosen[i] = int(np.argmax(away))
        away = np.minimum(away, ((points - points[chosen[i]]) ** 2).sum(axis=1))
    return chosen


def folded_share(points: Array, mesh: DeformableMesh) -> Array:
    """Share (...) of a cloth, at places (..., k, 3), that lies on another part of it: 0 spread out, towards 1 folded.

    A point counts when another one, apart by `APART` of the sheet's size on the sheet, is nearer to it than `TOGETHER`
    of their distance at the start.
    """
    chosen = evenly_chosen(mesh.nodes, FOLD_POINTS)
    flat = cdist(mesh.nodes[chosen], mesh.nodes[chosen])
    far = flat > APART * flat.max()
    limit = (TOGETHER * flat) ** 2
    leading = points.shape[:-2]
    flattened = points.reshape(-1, *points.shape[-2:])[:, chosen]
    share = np.empty(len(flattened))
    for i, places in enumerate(flattened):
        share[i] = float(np.any(far & (cdist(places, places, "sqeuclidean") < limit), axis=1).mean())
    return share.reshape(leading)
