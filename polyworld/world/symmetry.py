"""Differences between orientations of objects that look the same after some turns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.world import geometry

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def turn_about(simulated: Array, observed: Array, normal: Array, order: Ints) -> Array:
    """Angle (W, m) [rad] about `normal` from observed, (m, 4) or (W, m, 4), to simulated (W, m, 4), symmetry folded in.

    order (m,): rotations by 2 pi / order are indistinguishable; order >= 1.
    """
    # Twist of q_sim * conj(q_obs) about the normal (swing-twist decomposition); both parts are linear in
    # q_sim, so no full quaternion product is needed.
    w, x, y, z = np.moveaxis(observed, -1, 0)
    along = np.stack(
        [
            -(x * normal[0] + y * normal[1] + z * normal[2]),
            w * normal[0] + z * normal[1] - y * normal[2],
            -z * normal[0] + w * normal[1] + x * normal[2],
            y * normal[0] - x * normal[1] + w * normal[2],
        ],
        axis=-1,
    )
    cosine = np.einsum("...k,...k->...", simulated, observed)
    sine = np.einsum("...k,...k->...", simulated, along)
    period = 2.0 * np.pi / order
    angle = 2.0 * np.arctan2(sine, cosine)
    folded: Array = angle - period * np.round(angle / period)
    return folded


def rotation_between(later: Array, earlier: Array, order: int) -> Array:
    """Smallest rotation vectors (m, 3) [rad] that lead from `earlier` to `later` (m, 4), up to symmetry."""
    vectors: Array = smallest_rotation(later[None], earlier, np.full(len(later), order, dtype=np.int64))[0]
    return vectors


def smallest_rotation(simulated: Array, observed: Array, order: Ints) -> Array:
    """Smallest equivalent rotation vectors (W, m, 3) [rad] from observed (m, 4) to simulated (W, m, 4).

    order (m,): n turns about the body's z axis are equivalent; 0: every turn is, and only the tilt
    of that axis is compared.
    """
    result = np.empty((*simulated.shape[:2], 3))
    for n in np.unique(order):
        chosen = order == n
        own = simulated[:, chosen]
        if n == 0:
            result[:, chosen] = tilt_between(own, observed[chosen])
            continue
        turns = np.arange(n) * (2.0 * np.pi / n)
        equivalent = geometry.rotation_quaternion(np.stack([0 * turns, 0 * turns, turns], axis=-1))
        candidates = np.stack(
            [rotation_vector(own, geometry.quaternion_product(observed[chosen], turn)) for turn in equivalent]
        )
        size = np.linalg.norm(candidates, axis=-1)
        best = np.argmin(np.where(np.isnan(size), np.inf, size), axis=0)
        result[:, chosen] = np.take_along_axis(candidates, best[None, ..., None], axis=0)[0]
    return result


def rotation_vector(simulated: Array, observed: Array) -> Array:
    """Rotation vectors (..., 3) [rad], world axes, of at most half a turn, from observed to simulated (..., 4)."""
    a = np.ascontiguousarray(np.moveaxis(simulated, -1, 0))
    b = np.ascontiguousarray(np.moveaxis(observed, -1, 0))
    # q_sim * conj(q_obs), one component after the other: these are the largest arrays of a comparison.
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = a[1] * b[0] - a[0] * b[1] - a[2] * b[3] + a[3] * b[2]
    y = a[2] * b[0] - a[0] * b[2] + a[1] * b[3] - a[3] * b[1]
    z = a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1]
    sine = np.sqrt(x * x + y * y + z * z)
    angle = 2.0 * np.arctan2(sine, np.abs(w))
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    scale = np.where(w < 0.0, -scale, scale)
    vector: Array = np.stack([x * scale, y * scale, z * scale], axis=-1)
    return vector


def tilt_between(simulated: Array, observed: Array) -> Array:
    """Rotation vectors (..., 3) [rad] that carry the observed body z axis into the simulated one."""
    a = geometry.quaternion_matrix(observed)[..., :, 2]
    b = geometry.quaternion_matrix(simulated)[..., :, 2]
    axis = np.cross(np.broadcast_to(a, b.shape), b)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, np.sum(a * b, axis=-1, keepdims=True))
    tilt: Array = axis * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)
    return tilt
