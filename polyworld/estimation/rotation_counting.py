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
    far = np.flatnonzero(np.nanmax(np.linalg.norm(vectors, axis=-1), axis=1, initial=0.0) > NEAR * np.pi)
    if not len(far):
        return vectors
    result = vectors.copy()
    result[far] = _counted(vectors[far], rotation_vector(_steps(simulated[far]), _steps(observed)), np.pi)
    return result


def counted_angles(angles: Array, half: float) -> Array:
    """Return angles (k, m) [rad] in a plane, folded into (-half, half], counted on from the first instant."""
    if not np.nanmax(np.abs(angles) / half, initial=0.0) > NEAR:
        return angles
    steps = np.diff(angles, axis=1)
    steps -= 2.0 * half * np.round(steps / (2.0 * half))
    return _counted(angles[..., None], steps[..., None], half)[..., 0]


def _counted(turns: Array, steps: Array, half: float) -> Array:
    """Return turns (k, m, c) near the data, and far from them the sum of the mismatches (k, m - 1, c) of steps."""
    steps = np.where(np.linalg.norm(steps, axis=-1, keepdims=True) < LEAP * half, steps, 0.0)
    counted = np.concatenate([turns[:, :1], turns[:, :1] + np.cumsum(steps, axis=1)], axis=1)
    x = np.clip((np.linalg.norm(counted, axis=-1, keepdims=True) / half - NEAR) / (SUMMED - NEAR), 0.0, 1.0)
    result: Array = turns + x * x * (3.0 - 2.0 * x) * (counted - turns)
    return result


def _steps(orientations: Array) -> Array:
    """Return rotations (..., m - 1, 4) from each orientation (..., m, 4) to the next, about world axes."""
    conjugate = orientations[..., :-1, :] * np.array([1.0, -1.0, -1.0, -1.0])
    steps: Array = geometry.quaternion_product(orientations[..., 1:, :], conjugate)
    return steps
