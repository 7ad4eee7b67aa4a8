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
        flat = weight.reshape(-1, weight.shape[-1])
        arms = arm.reshape(-1, *arm.shape[-2:])
        quaternions = turned.reshape(-1, 4)
        for k in range(len(arms)):
            if flat[k].sum() > 0:
                middle = (flat[k][:, None] * rest).sum(axis=0) / flat[k].sum()
                quaternions[k] = _rotation(flat[k], rest - middle, arms[k])
        turned = quaternions.reshape(turned.shape)
    centre[empty] = np.nan
    drift[empty] = np.nan
    return centre, turned, drift, spin


def _rotation(weight: Array, before: Array, after: Array) -> Array:
    """Quaternion w x y z of the rotation that best takes one set of arms (k, 3) into another."""
    u, s, vt = np.linalg.svd((weight[:, None] * after).T @ before)
    if s[1] <= 1e-9 * s[0]:  # a straight line: the least rotation from one direction to the other
        a, b = vt[0], u[:, 0]
        axis, cosine = np.cross(a, b), float(a @ b)
        if cosine < 0.0:
            axis, cosine = np.cross(a, -b), -cosine
        sine = float(np.linalg.norm(axis))
        rotation = Rotation.from_rotvec(axis / sine * np.arctan2(sine, cosine)) if sine > 1e-12 else Rotation.identity()
    else:
        d = np.sign(np.linalg.det(u @ vt))
        rotation = Rotation.from_matrix(u @ np.diag([1.0, 1.0, d]) @ vt)
    x, y, z, w = rotation.as_quat(canonical=True)
    return np.array([w, x, y, z])
