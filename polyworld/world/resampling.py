"""Sampled motion at other instants: between its samples, and through impacts that fell between them.

Positions follow the cubic that has the samples' positions and velocities at both ends (Hermite); for smooth motion
its error is at most h^4/384 times the fourth derivative, h being the interval between samples, so ballistic flight
comes out exact. An interval in which the velocity jumps shows in its mean acceleration, which lies far from those
around it. There the motion is taken to be smooth but for one impulse; the displacement gives its time, and that
instant is exact where the acceleration is the same on both sides. What is left is an error of the order of
(change of acceleration) h^2 / 8, and, with two impacts in one interval, up to (jump of velocity) h / 4.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

# How far beyond the usual change of acceleration a jump of velocity lies.
_OUTLYING = 8.0
# A jump below this share of the greatest speed is rounding.
_ROUNDING = 1e-6


def resample(
    positions: Array, orientations: Array, velocities: Array, angular_velocities: Array, times: Array, wanted: Array
) -> tuple[Array, Array]:
    """Interpolate motions sampled at times (W, T) [s]: positions (W, T', n, 3) and orientations (W, T', n, 4) at the
    instants wanted (W, T').

    positions [m], velocities [m/s], angular_velocities [rad/s], world axes (W, T, n, 3); orientations (W, T, n, 4)
    w, x, y, z. Instants that are samples (to 1e-9 s) get the sample itself. Before the first and after the last
    sample the motion goes on straight and at constant angular velocity. Raises ValueError for a single sample.
    """
    if times.shape == wanted.shape and np.all(np.abs(times - wanted) <= 1e-9):
        return positions, orientations
    rows = np.arange(len(times))[:, None]
    count = times.shape[1]
    nearest = _nearest(times, wanted)
    if np.all(np.abs(times[rows, nearest] - wanted) <= 1e-9):
        return positions[rows, nearest], orientations[rows, nearest]
    if count < 2:
        raise ValueError(f"one sample at {times[0, 0]:.6g} s does not determine the motion at other instants")
    left = np.clip(_before(times, wanted), 0, count - 2)
    start, h = times[rows, left], np.diff(times, axis=1)[rows, left]
    at = np.clip(wanted - start, 0.0, h)[..., None, None]
    beyond = (wanted - start)[..., None, None] - at
    h = h[..., None, None]
    jump, when = _impulses(positions, velocities, times)
    jump, when = jump[rows, left], when[rows, left]
    x0, x1 = positions[rows, left], positions[rows, left + 1]
    v0, v1 = velocities[rows, left], velocities[rows, left + 1]
    place = _hermite(at, h, x1 - x0 - jump * (h - when), v0, v1 - jump) + jump * np.maximum(at - when, 0.0)
    place = x0 + place + beyond * np.where(beyond < 0.0, v0, v1)
    q0, q1 = orientations[rows, left], orientations[rows, left + 1]
    w0, w1 = angular_velocities[rows, left], angular_velocities[rows, left + 1]
    spin = np.where(np.any(jump != 0.0, axis=-1, keepdims=True), w1 - w0, 0.0)
    turn = _turning(q0, q1, w0, w1 - spin, spin, at, h, when) + beyond * np.where(beyond < 0.0, w0, w1)
    turned = _rotated(turn, q0)
    return place, np.asarray(turned)


def resample_spins(spins: Array, times: Array, wanted: Array) -> Array:
    """Angular velocities (W, T', n, 3) at the instants wanted (W, T'), linear between samples (W, T, n, 3) at times
    (W, T) [s] and constant beyond them."""
    if times.shape == wanted.shape and np.all(np.abs(times - wanted) <= 1e-9):
        return spins
    rows = np.arange(len(times))[:, None]
    left = np.clip(_before(times, wanted), 0, times.shape[1] - 2)
    part = (wanted - times[rows, left]) / np.diff(times, axis=1)[rows, left]
    part = np.clip(part, 0.0, 1.0)[..., None, None]
    between: Array = spins[rows, left] * (1.0 - part) + spins[rows, left + 1] * part
    return between


def _nearest(times: Array, wanted: Array) -> NDArray[np.int64]:
    before = np.clip(_before(times, wanted), 0, times.shape[1] - 1)
    after = np.minimum(before + 1, times.shape[1] - 1)
    rows = np.arange(len(times))[:, None]
    closer = np.abs(times[rows, after] - wanted) < np.abs(times[rows, before] - wanted)
    return np.where(closer, after, before)


def _before(times: Array, wanted: Array) -> NDArray[np.int64]:
    """Index of the last sample that is not later (W, T'); -1 where all are."""
    found = [np.searchsorted(t, w, side="right") - 1 for t, w in zip(times, wanted, strict=True)]
    return np.array(found, dtype=np.int64)


def _hermite(at: Array, h: Array, way: Array, v0: Array, v1: Array) -> Array:
    """Displacement at a time in 0..h with velocities v0, v1 at the ends and displacement `way` over all of it."""
    s = at / h
    value: Array = way * s**2 * (3.0 - 2.0 * s) + h * s * (1.0 - s) * (v0 * (1.0 - s) - v1 * s)
    return value


def _impulses(positions: Array, velocities: Array, times: Array) -> tuple[Array, Array]:
    """Jumps of velocity in the intervals (W, T - 1, n, 3), zero where there are none, and when (W, T - 1, n, 1)."""
    h = np.diff(times, axis=1)[..., None, None]
    mean = np.diff(velocities, axis=1) / h
    count = mean.shape[1]
    if count < 5:
        return np.zeros_like(mean), np.zeros((*mean.shape[:3], 1))
    around = np.arange(2, count - 2)[:, None] + np.array([-2, -1, 1, 2])
    usual = np.empty_like(mean)
    usual[:, 2:-2] = np.sort(mean[:, around], axis=2)[:, :, 1:3].mean(axis=2)
    # At the ends the neighbours do not lie on both sides, and smooth change does not cancel.
    usual[:, 0], usual[:, -1] = mean[:, 1], mean[:, -2]
    usual[:, 1], usual[:, -2] = np.median(mean[:, [0, 2, 3]], axis=1), np.median(mean[:, [-1, -3, -4]], axis=1)
    jump = h * (mean - usual)
    size = np.linalg.norm(jump, axis=-1, keepdims=True)
    common = np.broadcast_to(np.median(size[:, 2:-2], axis=1, keepdims=True), size.shape).copy()
    change = np.linalg.norm(h[:, 1:] * np.diff(mean, axis=1), axis=-1, keepdims=True)
    common[:, [0, 1, -2, -1]] = np.median(change, axis=1, keepdims=True)
    speed = np.linalg.norm(velocities, axis=-1).max(axis=1)[:, None, :, None]
    jump = np.where(size > _OUTLYING * common + _ROUNDING * speed, jump, 0.0)
    extra = np.diff(positions, axis=1) - velocities[:, :-1] * h - 0.5 * usual * h**2
    square = (jump**2).sum(axis=-1, keepdims=True)
    # An impulse at s moves the body by jump (h - s) until the interval ends.
    left = np.clip((extra * jump).sum(axis=-1, keepdims=True) / np.where(square > 0.0, square, 1.0), 0.0, h)
    return jump, h - left


def _turning(q0: Array, q1: Array, w0: Array, w1: Array, spin: Array, at: Array, h: Array, when: Array) -> Array:
    """Interpolate rotation vectors, world axes, from q0 to the orientation at a time in 0..h."""
    change = Rotation.from_quat(_flat(q1), scalar_first=True) * Rotation.from_quat(_flat(q0), scalar_first=True).inv()
    total = change.as_rotvec().reshape(w0.shape)
    # A turn by more than half a circle in one interval: the one nearest to what the angular velocities imply.
    angle = np.linalg.norm(total, axis=-1, keepdims=True)
    axis = total / np.where(angle > 0.0, angle, 1.0)
    known = 0.5 * h * (w0 + w1) + spin * (h - when)
    total = total + axis * 2.0 * np.pi * np.round(((known - total) * axis).sum(axis=-1, keepdims=True) / (2.0 * np.pi))
    across = np.cross(total, w1)
    end = w1 - 0.5 * across + np.cross(total, across) / 12.0  # rate of the rotation vector: Bortz 1971, to second order
    value: Array = _hermite(at, h, total - spin * (h - when), w0, end) + spin * np.maximum(at - when, 0.0)
    return value


def _rotated(turn: Array, orientations: Array) -> Array:
    """Orientations after a turn; NaN where it is no number, as of a motion that diverged."""
    with np.errstate(over="ignore"):
        known = np.isfinite((turn**2).sum(axis=-1, keepdims=True))
    first = Rotation.from_rotvec(np.where(known, turn, 0.0).reshape(-1, 3))
    product = (first * Rotation.from_quat(_flat(orientations), scalar_first=True)).as_quat(scalar_first=True)
    value: Array = product.reshape(orientations.shape)
    # The sign that the samples have: q and -q are one orientation.
    value = np.where((value * orientations).sum(axis=-1, keepdims=True) < 0.0, -value, value)
    return np.where(known, value, np.nan)


def _flat(quaternions: Array) -> Any:
    """(-1, 4), with the identity where nothing is known."""
    flat = quaternions.reshape(-1, 4)
    return np.where(np.all(np.isfinite(flat), axis=-1, keepdims=True), flat, [1.0, 0.0, 0.0, 0.0])
