"""What can be read of a cloth besides its points: strain and curvature of every triangle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.solver.cloth.geometry import ClothGeometry, hinge_angles

Array = NDArray[np.float64]


def cloth_quantities(g: ClothGeometry, x: Array, angle: Array) -> dict[str, Array]:
    """Quantities (W, T) of a cloth with nodes x (W, k, 3) and director angles (W, E).

    strain: largest principal strain, extension over length [1]. compression: smallest one [1]. curvature: largest
    principal curvature in size, with its sign (positive where the surface turns away from its normal) [1/m]; a sharp
    fold shows as one of some 1 / (edge length).
    """
    corner = x[:, g.corners]  # (W, T, 3, 3)
    d = np.stack([corner[:, :, 1] - corner[:, :, 0], corner[:, :, 2] - corner[:, :, 0]], axis=-1)
    f = d @ g.inverse_rest
    low, high = _principal(*_symmetric(np.swapaxes(f, -1, -2) @ f))
    cross = np.cross(d[..., 0], d[..., 1])
    normal = cross / np.maximum(np.linalg.norm(cross, axis=-1, keepdims=True), 1e-30)
    half = 0.5 * hinge_angles(x, normal, g.ends, g.slots)
    bend = np.stack([half + angle, half - angle], axis=-1).reshape(len(x), -1)[:, g.edges]
    k = np.einsum("tij,wtj->wti", g.curvature, bend)
    least, most = _principal(k[..., 0], k[..., 1], k[..., 2])
    return {
        "strain": np.sqrt(np.maximum(high, 0.0)) - 1.0,
        "compression": np.sqrt(np.maximum(low, 0.0)) - 1.0,
        "curvature": np.where(np.abs(most) >= np.abs(least), most, least),
    }


def _symmetric(m: Array) -> tuple[Array, Array, Array]:
    return m[..., 0, 0], m[..., 1, 1], m[..., 0, 1]


def _principal(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Smaller and larger eigenvalue of [[a, c], [c, b]]."""
    mean, spread = 0.5 * (a + b), np.hypot(0.5 * (a - b), c)
    return mean - spread, mean + spread
