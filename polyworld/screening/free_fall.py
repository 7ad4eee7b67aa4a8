"""Estimate the acceleration that stretches of free flight have in common, in whatever units and axes the data are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.expressions.effect import law_of
from polyworld.screening.clearance import touching
from polyworld.screening.settings import ScreenSettings
from polyworld.screening.tracks import Track
from polyworld.world import World

Array = NDArray[np.float64]

WINDOWS = (7, 15, 31, 63, 127, 255)  # samples that a parabola is fitted to; noise asks for long ones, bounces for short
EVEN = 1e-6  # of half a window: differences of time stamps that are rounding


@dataclass(frozen=True)
class Fall:
    """The acceleration common to stretches of free flight.

    acceleration (3,) [m/s^2] in units of the data, 0 where not measured; error: relative standard error; share: of
    tracks and of windows (the less) that agree with it; runs: that agree; measured: axes.
    """

    acceleration: Array
    error: float
    share: float
    runs: tuple[str, ...]
    measured: tuple[int, ...]


def common_fall(world: World, tracks: Sequence[Track], settings: ScreenSettings) -> Fall | None:
    """Estimate the acceleration of free flight, None where stretches of flight have no constant one in common.

    Bodies of a spatial world with gravity that no joint, attachment or driving effect holds. Windows count where a
    parabola describes the motion, its acceleration is significant and the body is not on a static.
    """
    gravity = np.asarray(world.environment.gravity, dtype=float)
    if world.planar or world.observer is not None or not np.any(gravity):
        return None
    found: list[tuple[Track, Array, Array, Array]] = []
    for track in tracks:
        if _flies_freely(world, track.object):
            near = touching(world, world.object(track.object), track, settings)
            acceleration, error, weight = _windows(track, near, settings)
            if len(weight):
                found.append((track, acceleration, error, weight))
    if not found:
        return None
    middles = np.array([_weighted_median(a, w) for _, a, _, w in found])
    measured = tuple(int(a) for a in np.flatnonzero(np.isfinite(middles).any(axis=0)))
    common = np.zeros(3)
    common[list(measured)] = np.nanmedian(middles[:, measured], axis=0)
    size = float(np.linalg.norm(common))
    if not size > 0.0:
        return None
    errors = np.array([np.median(e) / np.sqrt(max(len(w) / 2.0, 1.0)) for _, _, e, w in found])
    off = np.linalg.norm(np.nan_to_num(middles) - common, axis=1)
    agree = off <= settings.constant * size + 3.0 * errors
    weights = np.concatenate([w for *_, w in found])
    near_common = np.concatenate(
        [
            np.linalg.norm(np.nan_to_num(a) - common, axis=1) <= settings.constant * size + 3.0 * e
            for _, a, e, _ in found
        ]
    )
    share = min(float(agree.mean()), float(weights @ near_common / weights.sum()))
    if share < settings.agreeing:
        return None
    relative = float(np.median(errors) / np.sqrt(len(found)) / size)
    runs = tuple(dict.fromkeys(t.run for (t, *_), same in zip(found, agree, strict=True) if same))
    return Fall(common, relative, share, runs, measured)


def _flies_freely(world: World, name: str) -> bool:
    if name not in {o.name for o in world.objects}:
        return False
    held = {n for j in world.joints for n in (j.object, j.other)}
    driven = any(
        e.enabled and not law_of(e).falling and (e.objects is None or name in e.objects) for e in world.effects
    )
    return name not in held and not world.attachments and not driven


def _windows(track: Track, near: NDArray[np.bool_], settings: ScreenSettings) -> tuple[Array, Array, Array]:
    """Accelerations (W, 3), standard errors (W,) of their length, and numbers of samples (W,) of windows of flight."""
    axes = list(track.axes)
    rows = np.isfinite(track.places[:, axes]).all(axis=1)
    times, places, near = track.times[rows], track.places[rows][:, axes], near[rows]
    noise = track.noise[axes]
    found: list[tuple[Array, Array, Array]] = []
    for size in (s for s in WINDOWS if s <= len(times)):
        index = np.arange(0, len(times) - size + 1, size // 2)[:, None] + np.arange(size)
        index = index[near[index].mean(axis=1) < 0.5]
        if not len(index):
            continue
        t, y = times[index], places[index]
        middle, half = (t[:, :1] + t[:, -1:]) / 2.0, (t[:, -1:] - t[:, :1]) / 2.0
        scaled = (t - middle) / half
        if np.ptp(scaled, axis=0).max() < EVEN:
            scaled = scaled[:1]  # one design for all
        design = np.stack([np.ones_like(scaled), scaled, scaled**2], axis=-1)
        inverse = np.linalg.inv(np.swapaxes(design, 1, 2) @ design)
        y0, y = y, y - y.mean(axis=1, keepdims=True)
        fitted = inverse @ np.swapaxes(design, 1, 2) @ y  # (W, 3, axes)
        left = ((y - design @ fitted) ** 2).sum(axis=1)
        bend = np.linalg.norm(fitted[:, 2], axis=1)
        freedom = size - 3.0
        noisy = np.all(left <= noise**2 * (freedom + settings.significant * np.sqrt(2.0 * freedom)), axis=1)
        smooth = np.sqrt(left.sum(axis=1) / size) <= settings.bend * bend
        error = np.linalg.norm(noise) * np.sqrt(np.broadcast_to(inverse[:, 2, 2], bend.shape))
        good = (noisy | smooth) & (bend > settings.significant * error) & ~_supported(track, y0, fitted[:, 2], settings)
        scale = 2.0 / half[good, 0] ** 2
        acceleration = np.full((np.count_nonzero(good), 3), np.nan)
        acceleration[:, axes] = fitted[good, 2] * scale[:, None]
        found.append((acceleration, error[good] * scale, np.full(len(acceleration), float(size))))
    if not found:
        return np.empty((0, 3)), np.empty(0), np.empty(0)
    a, e, w = zip(*found, strict=True)
    return np.concatenate(a), np.concatenate(e), np.concatenate(w)


def _supported(track: Track, places: Array, bend: Array, settings: ScreenSettings) -> NDArray[np.bool_]:
    """Whether windows (W, n, axes) stay at an end of the range along an axis without any acceleration there.

    So does what slides or rests on a floor or against a wall, whatever the units; bend (W, axes): of the parabolas.
    """
    axes = list(track.axes)
    span, small = track.range[axes], settings.negligible
    low = np.nanmin(track.places[:, axes], axis=0)
    middle = (places.mean(axis=1) - low) / np.where(span > 0.0, span, 1.0)
    still = np.ptp(places, axis=1) <= small * span + settings.significant * track.noise[axes]
    end = np.abs(middle - 0.5) > 0.5 - small
    straight = np.abs(bend) <= small * np.linalg.norm(bend, axis=1, keepdims=True)
    held: NDArray[np.bool_] = np.any(still & end & straight & (span > small * span.max()), axis=1)
    return held


def _weighted_median(values: Array, weights: Array) -> Array:
    """Component by component (3,), NaN where not measured."""
    order = np.argsort(values, axis=0)
    total = np.cumsum(weights[order], axis=0)
    at = np.argmax(total >= 0.5 * total[-1], axis=0)
    middle: Array = np.take_along_axis(values, order, axis=0)[at, np.arange(values.shape[1])]
    return middle
