"""Widen what an ensemble predicts by what its model is off, beyond what its members differ in.

Members share one model. That this is not quite right (the friction of a corner, a contact met otherwise) shows after
the data end and grows with the distance travelled; collisions multiply it, so its distribution has heavy tails
(Kennedy & O'Hagan, J. R. Stat. Soc. B 63, 2001, on model discrepancy).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_settings import ModelSettings

Array = NDArray[np.float64]

QUANTILES = 19  # of the distribution of errors by which each member is widened


def with_model_error(values: Array, travelled: Array, settings: ModelSettings | None = None) -> Array:
    """Return a sample (N * 19, ...) of coordinates of which members (N, ...) say `values`.

    travelled (N, ...): distance since the last fitted frame [m]. Each member becomes the quantiles of a Cauchy
    distribution about it, whose half width is a share of that distance.
    """
    half = (settings or ModelSettings()).path * travelled
    errors = np.tan(np.pi * ((np.arange(QUANTILES) + 0.5) / QUANTILES - 0.5))
    errors = errors.reshape(-1, *np.ones(values.ndim, dtype=int))
    widened: Array = values + errors * half
    return widened.reshape(-1, *values.shape[1:])


def travelled(positions: Array) -> Array:
    """Return the length of the path [m] from the first of positions (..., T, 3) to each of them, (..., T)."""
    steps = np.linalg.norm(np.diff(positions, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*positions.shape[:-2], 1)), np.cumsum(np.nan_to_num(steps), axis=-1)], axis=-1)


def travelled_by_axis(positions: Array, normal: Array | None = None) -> Array:
    """Return the distances [m] with which errors of positions (..., T, 3) go by axis, (..., T, 3).

    That of the whole path, along z that of its rise and fall alone, since what lies on a floor stays on it; none across
    a motion plane with this normal (3,).
    """
    whole, upright = travelled(positions), travelled(positions * [0.0, 0.0, 1.0])
    found: Array = np.stack([whole, whole, upright], axis=-1)
    return found if normal is None else found * (1.0 - np.abs(normal))
