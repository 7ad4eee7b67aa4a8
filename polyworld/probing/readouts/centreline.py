"""Centrelines of ropes: points evenly spaced along a polyline, and the point of it nearest to another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def lengths_along(points: Array) -> Array:
    """Length (..., k) along polylines (..., k, d) from their first point."""
    steps = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*steps.shape[:-1], 1)), np.cumsum(steps, axis=-1)], axis=-1)


def resampled(points: Array, count: int) -> Array:
    """`count` points (..., count, d) of polylines (..., k, d), evenly spaced by length, both ends among them."""
    along = lengths_along(points)
    total = along[..., -1:]
    result = np.empty((*points.shape[:-2], count, points.shape[-1]))
    last = points.shape[-2] - 2
    for i, share in enumerate(np.linspace(0.0, 1.0, count)):
        target = share * total
        # The segment that holds the target; counting keeps every polyline of a batch in one operation.
        segment = np.clip((along < target).sum(axis=-1, keepdims=True) - 1, 0, last)
        begin = np.take_along_axis(along, segment, axis=-1)
        length = np.take_along_axis(along, segment + 1, axis=-1) - begin
        part = np.where(length > 0.0, (target - begin) / np.where(length > 0.0, length, 1.0), 0.0)
        a = np.take_along_axis(points, segment[..., None], axis=-2)[..., 0, :]
        b = np.take_along_axis(points, segment[..., None] + 1, axis=-2)[..., 0, :]
        result[..., i, :] = a + np.clip(part, 0.0, 1.0) * (b - a)
    return result


def nearest_on_polyline(points: Array, targets: Array) -> Array:
    """Points (..., m, d) of polylines (..., k, d) nearest to targets (..., m, d); leading axes broadcast."""
    begin, step = points[..., :-1, :], np.diff(points, axis=-2)
    squared = np.maximum((step**2).sum(axis=-1), 1e-300)
    shape = np.broadcast_shapes(points.shape[:-2], targets.shape[:-2])
    result = np.empty((*shape, *targets.shape[-2:]))
    for i in range(targets.shape[-2]):
        target = targets[..., i, :]
        part = np.clip(((target[..., None, :] - begin) * step).sum(axis=-1) / squared, 0.0, 1.0)
        feet = begin + part[..., None] * step
        distance = ((feet - target[..., None, :]) ** 2).sum(axis=-1)
        # A target that was not observed is NaN: any point will do, its confidence is 0.
        nearest = np.argmin(np.where(np.isfinite(distance), distance, np.inf), axis=-1)
        feet, nearest = np.broadcast_to(feet, (*shape, *feet.shape[-2:])), np.broadcast_to(nearest, shape)
        result[..., i, :] = np.take_along_axis(feet, nearest[..., None, None], axis=-2)[..., 0, :]
    return result


def turning(points: Array) -> Array:
    """Total angle (...) by which polylines (..., k, d) turn [rad]: 0 for a straight rope."""
    steps = np.diff(points, axis=-2)
    norm = np.linalg.norm(steps, axis=-1)
    cosine = (steps[..., 1:, :] * steps[..., :-1, :]).sum(axis=-1) / np.maximum(norm[..., 1:] * norm[..., :-1], 1e-300)
    total: Array = np.arccos(np.clip(cosine, -1.0, 1.0)).sum(axis=-1)
    return total
