"""Turns of a simulated body against a measured one, counted on beyond half a turn.

A rotation vector is at most half a turn long. A body that rolls a little too far is many turns ahead by the end, and a
residual that wraps round makes a fit turn the wrong way. Far from the data the mismatch of the steps from instant to
instant is summed up instead: that sum grows steadily, and near the data the rotation vector itself is used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.world import geometry
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

NEAR = 0.5  # of half a turn: below it the rotation vector is taken, as it is
SUMMED = 0.8  # of half a turn: beyond it the sum
LEAP = 0.3  # of half a turn between two instants: a measured orientation that leaps is not counted


def counted_vectors(vectors: Array, simulated: Array, observed: Array) -> Array:
    """Return rotation vectors (k, m, 3) [rad] from observed (m, 4) to simulated (k, m, 4) orientations, counted on from
    the first instant. vectors (k, m, 3): the smallest ones.
    """
    half = np.pi
    far = np.flatnonzero(np.nanmax(np.linalg.norm(vectors, axis=-1), axis=1, initial=0.0) > NEAR * half)
    if not len(far):
        return vectors
    steps = _steps(simulated[far])
    mismatch = rotation_vector(steps, _steps(observed))
    size = np.linalg.norm(mismatch, axis=-1, keepdims=True)
    mismatch = np.where(size < LEAP * half, mismatch, 0.0)
    counted = vectors[far].copy()
    counted[:, 1:] = counted[:, :1] + np.cumsum(mismatch, axis=1)
    share = _share(np.linalg.norm(counted, axis=-1, keepdims=True), half)
    result = vectors.copy()
    result[far] += share * (counted - vectors[far])
    return result


def counted_angles(angles: Array, half: float) -> Array:
    """Return angles (k, m) [rad] in a plane, folded into (-half, half], counted on from the first instant."""
    if not np.nanmax(np.abs(angles) / half, initial=0.0) > NEAR:
        return angles
    mismatch = np.diff(angles, axis=1)
    mismatch -= 2.0 * half * np.round(mismatch / (2.0 * half))
    mismatch = np.where(np.abs(mismatch) < LEAP * half, mismatch, 0.0)
    counted = angles.copy()
    counted[:, 1:] = counted[:, :1] + np.cumsum(mismatch, axis=1)
    result: Array = angles + _share(np.abs(counted), half) * (counted - angles)
    return result


def _steps(orientations: Array) -> Array:
    """Return rotations (..., m - 1, 4) from each orientation (..., m, 4) to the next, about world axes."""
    conjugate = orientations[..., :-1, :] * np.array([1.0, -1.0, -1.0, -1.0])
    steps: Array = geometry.quaternion_product(orientations[..., 1:, :], conjugate)
    return steps


def _share(size: Array, half: float) -> Array:
    """Return 0 near the data, 1 far from them, smooth between."""
    x = np.clip((size / half - NEAR) / (SUMMED - NEAR), 0.0, 1.0)
    share: Array = x * x * (3.0 - 2.0 * x)
    return share
