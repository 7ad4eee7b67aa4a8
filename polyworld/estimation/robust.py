"""Huber's loss and its weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def huber_loss(residuals: Array, threshold: float) -> Array:
    """Return Huber's loss, r^2 for small r."""
    size = np.abs(residuals)
    loss: Array = np.where(size <= threshold, size**2, 2.0 * threshold * size - threshold**2)
    return loss


def huber_weights(residuals: Array, threshold: float) -> Array:
    """Return the weights with which squares have the slope of Huber's loss."""
    weights: Array = np.minimum(1.0, threshold / np.maximum(np.abs(residuals), 1e-300))
    return weights
