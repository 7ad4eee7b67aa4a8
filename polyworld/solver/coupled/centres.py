"""Motion of deformable objects as a whole: centre of mass, mean rotation, mean angular velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def centre_motion(
    points: Array, velocities: Array, mass: Array, rest: Array | None
) -> tuple[Array, Array, Array, Array]:
    """Position (..., 3), orientation (..., 4) w x y z, velocity and angular velocity (..., 3) of a cloud of points.

    points, velocities (..., k, 3), NaN where a point is not there; mass (..., k) or (k,); rest (k, 3): points at the
    start, against which the rotation is measured (Kabsch 1976), or None for a fluid: identity then. The angular
    velocity is that of the rigid body with the same angular momentum.
    """
    there = np.isfinite(points[..., 0])
    weight = np.where(there, mass, 0.0)
    total = np.maximum(weight.sum(axis=-1), 1e-300)[..., None]
    x = np.nan_to_num(points)
    v = np.nan_to_num(velocities)
    empty = ~there.any(axis=-1)
    centre = (weight[..., None] * x).sum(axis=-2) / total
    drift = (weight[..., None] * v).sum(axis=-2) / total
    arm = (x - centre[..., None, :]) * there[..., None]
    relative = v - drift[..., None, :]
    momentum = (weight[..., None] * np.cross(arm, relative)).sum(axis=-2)
    square = (weight * (arm**2).sum(axis=-1)).sum(axis=-1)
    inertia = square[..., None, None] * np.eye(3) - np.einsum("...k,...ki,...kj->...ij", weight, arm, arm)
    spin = np.einsum("...ij,...j->...i", np.linalg.pinv(inertia, rcond=1e-9, hermitian=True), momentum)
    turned = np.zeros((*centre.shape[:-1], 4))
    turned[..., 0] = 1.0
    if rest is not None:
        here = ~empty
        before = rest - ((weight[here][..., None] * rest).sum(axis=-2) / total[here])[..., None, :]
        turned[here] = _rotations(weight[here], before, arm[here])
    centre[empty] = np.nan
    drift[empty] = np.nan
    return centre, turned, drift, spin


def _rotations(weight: Array, before: Array, after: Array) -> Array:
    """Quaternions (n, 4) w x y z of the rotations that best take sets of arms (n, k, 3) into others."""
    u, s, vt = np.linalg.svd(np.swapaxes(weight[..., None] * after, 1, 2) @ before)
    mirror = np.ones((len(s), 3))
    mirror[:, 2] = np.sign(np.linalg.det(u @ vt))
    quaternions = Rotation.from_matrix((u * mirror[:, None]) @ vt).as_quat(canonical=True)
    for n in np.flatnonzero(s[:, 1] <= 1e-9 * s[:, 0]):
        quaternions[n] = _least_turn(vt[n, 0], u[n, :, 0]).as_quat(canonical=True)
    rolled: Array = np.roll(quaternions, 1, axis=1)
    return rolled


def _least_turn(a: Array, b: Array) -> Rotation:
    """The least rotation that takes a straight line along a to one along b, either way round."""
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < 0.0:
        axis, cosine = np.cross(a, -b), -cosine
    sine = float(np.linalg.norm(axis))
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)) if sine > 1e-12 else Rotation.identity()
