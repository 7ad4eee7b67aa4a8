"""Readouts of a cloth besides its points: strain, curvature and elastic energy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.solver.cloth.geometry import ClothGeometry, hinge_angles

Array = NDArray[np.float64]


def cloth_quantities(g: ClothGeometry, material: Any, x: Array, angle: Array, rate: Array) -> dict[str, Array]:
    """Quantities of a cloth with nodes x (W, k, 3), director angles and rates (W, E), parameters (W,) of `Material`.

    strain (W, T): largest principal strain of each triangle, extension over length [1]. curvature (W, T): the principal
    curvature that is larger in size, with its sign: negative where the surface turns towards its normal [1/m]; a sharp
    fold shows as some 1 / (edge length). elastic_energy (W, 1): of stretch, shear and bending, the directors'
    motion included [J]: what the kinetic energy of the nodes misses.
    """
    corner = x[:, g.corners]  # (W, T, 3, 3)
    d = np.stack([corner[:, :, 1] - corner[:, :, 0], corner[:, :, 2] - corner[:, :, 0]], axis=-1)
    f = d @ g.inverse_rest
    c = np.swapaxes(f, -1, -2) @ f
    # U = (C + sqrt(det C)) / sqrt(tr C + 2 sqrt(det C)), the square root of a 2 x 2 matrix.
    area = np.sqrt(np.maximum(c[..., 0, 0] * c[..., 1, 1] - c[..., 0, 1] ** 2, 0.0))
    trace = np.sqrt(np.maximum(c[..., 0, 0] + c[..., 1, 1] + 2.0 * area, 1e-30))
    e = np.stack([(c[..., 0, 0] + area) / trace - 1.0, (c[..., 1, 1] + area) / trace - 1.0, c[..., 0, 1] / trace], -1)
    cross = np.cross(d[..., 0], d[..., 1])
    normal = cross / np.maximum(np.linalg.norm(cross, axis=-1, keepdims=True), 1e-30)
    half = 0.5 * hinge_angles(x, normal, g.ends, g.slots)
    bend = np.stack([half + angle, half - angle], axis=-1).reshape(len(x), -1)[:, g.edges]
    k = np.einsum("tij,wtj->wti", g.curvature, bend)
    least, most = _principal(k)
    return {
        "strain": _principal(e)[1],
        "curvature": np.where(np.abs(most) >= np.abs(least), most, least),
        "elastic_energy": (_energy(g, material, e, k - g.rest_curvature) + _turning(g, material, rate))[:, None],
    }


def _energy(g: ClothGeometry, material: Any, e: Array, k: Array) -> Array:
    """Elastic energy (W,) for strains and bends (W, T, 3)."""
    q, cross, shear = (material[name][:, None] for name in ("stretch", "cross", "shear"))
    plate, nu = (material[name][:, None] for name in ("plate", "poisson"))
    membrane = 0.5 * q * (e[..., 0] ** 2 + e[..., 1] ** 2) + cross * e[..., 0] * e[..., 1] + shear * e[..., 2] ** 2
    gauss = k[..., 0] * k[..., 1] - k[..., 2] ** 2
    bending = plate * (0.5 * (k[..., 0] + k[..., 1]) ** 2 - (1.0 - nu) * gauss)
    return np.asarray(((membrane + bending) * g.area).sum(axis=1))


def _turning(g: ClothGeometry, material: Any, rate: Array) -> Array:
    """Kinetic energy (W,) of the directors."""
    speed = material["director"]
    inverse = np.divide(0.5, speed, out=np.zeros_like(speed), where=speed > 0)
    return np.asarray(inverse * (rate**2 / g.softness).sum(axis=1))


def _principal(m: Array) -> tuple[Array, Array]:
    """Smaller and larger eigenvalue of [[m_0, m_2], [m_2, m_1]]."""
    mean, spread = 0.5 * (m[..., 0] + m[..., 1]), np.hypot(0.5 * (m[..., 0] - m[..., 1]), m[..., 2])
    return mean - spread, mean + spread
