"""Parameters of ropes and wheels that a rollout varies, and tables of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.world import World, geometry

Array = NDArray[np.float64]


ROPE_FIELDS = (
    "linear_density",
    "stretch_stiffness",
    "bending_stiffness",
    "twist_stiffness",
    "stretch_damping",
    "bending_damping",
)


WHEEL_FIELDS = {
    "wheel_friction": "friction",
    "bearing_friction": "bearing_friction",
    "bearing_damping": "bearing_damping",
    "wheel_inertia": "inertia",
}


def mass_of(world: World, name: str) -> float:
    """Return the mass of a body [kg]."""
    item = world.object(name)
    return item.mass if item.mass is not None else item.density * geometry.mass_properties(item.shape).volume


def chain_curvature(points: Array, length: float) -> Array:
    """Curvature (W, k - 2) at the inner nodes of chains of points (W, k, 3) [1/m]."""
    t = np.diff(points, axis=1)
    t = t / np.maximum(np.linalg.norm(t, axis=2, keepdims=True), 1e-300)
    sine = np.linalg.norm(np.cross(t[:, :-1], t[:, 1:]), axis=2)
    cosine = (t[:, :-1] * t[:, 1:]).sum(axis=2)
    curvature: Array = 2.0 * sine / (1.0 + np.maximum(cosine, -0.999)) / length
    return curvature


def offsets(counts: list[int]) -> list[int]:
    """Return where each of consecutive groups begins, by their sizes."""
    return [0, *np.cumsum(counts)[:-1].tolist()] if counts else []


def float_row(values: Sequence[float]) -> Any:
    """Copy numbers into a Warp array."""
    return buffers.array(np.asarray(values, dtype=np.float64), wp.float64)
