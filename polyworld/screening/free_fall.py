"""Estimate the acceleration of free flight and compare it with gravity: wrong units of length or time, swapped axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.expressions.effect import law_of
from polyworld.screening.clearance import touching
from polyworld.screening.finding import Finding, Severity
from polyworld.screening.settings import ScreenSettings
from polyworld.screening.time_stamps import counts_frames, usual_rate
from polyworld.screening.tracks import Track
from polyworld.world import World

Array = NDArray[np.float64]

WINDOWS = (7, 15, 31, 63, 127, 255)  # samples that a parabola is fitted to; noise asks for long ones, bounces for short
EVEN = 1e-6  # of half a window: differences of time stamps that are rounding


@dataclass(frozen=True)
class Fall:
    """The acceleration common to stretches of free flight.

    acceleration (3,) [m/s^2] in units of the data, 0 where not measured; error: relative standard error; share: of
    tracks and of windows (the less) that agree with it; measured: axes.
    """

    acceleration: Array
    error: float
    share: float
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
    return Fall(common, relative, share, measured)


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


LENGTHS = {"mm": 1000.0, "cm": 100.0, "in": 39.3701, "ft": 3.28084, "km": 1e-3}  # units in a metre
NAMES = {"m": "metres", "mm": "millimetres", "cm": "centimetres", "in": "inches", "ft": "feet", "km": "kilometres"}
RATE_LIMITS = (15.0, 2000.0)  # [1/s] frame rates that gravity may give times that count frames
# What to write for x, y, z where "up" is an axis of the data; right-handed axes stay so.
RELABELLED = {
    (0, 1): "x = y, y = z, z = x",
    (0, -1): "x = z, z = -x",
    (1, 1): "y = -z, z = y",
    (1, -1): "y = z, z = -y",
    (2, -1): "y = -y, z = -z",
}


def fall_findings(world: World, tracks: Sequence[Track], fall: Fall, settings: ScreenSettings) -> list[Finding]:
    """Return what the acceleration of free flight says about units of length and time, and about axes."""
    gravity = np.asarray(world.environment.gravity, dtype=float)
    size = float(np.linalg.norm(fall.acceleration))
    ratio = size / float(np.linalg.norm(gravity))
    cosine = float(fall.acceleration @ gravity) / size / float(np.linalg.norm(gravity))
    along = int(np.argmax(np.abs(fall.acceleration)))
    on_axis = abs(float(fall.acceleration[along])) >= settings.oblique * size
    wrong_way = on_axis and cosine < 1.0 - settings.oblique
    if cosine < 0.5 and not wrong_way:
        return []
    units, factor = _units(tracks, fall, ratio, settings)
    if not wrong_way:
        return units
    off = abs(float(np.log(ratio / factor)))
    # Any other acceleration in a direction of its own is friction, a slope or buoyancy.
    if off > settings.unit_tolerance + 3.0 * fall.error:
        return []
    return units + _axes(fall, gravity, along, off <= settings.close_match + 3.0 * fall.error, settings)


def _units(tracks: Sequence[Track], fall: Fall, ratio: float, settings: ScreenSettings) -> tuple[list[Finding], float]:
    """Return what the ratio of the acceleration to gravity says about units, or about times that count frames, and the
    factor of the units."""
    if 1.0 / settings.unlike < ratio < settings.unlike:
        return [], 1.0
    sure = fall.share >= settings.refusing
    times = f"{ratio:.0f}" if ratio >= 100.0 else f"{ratio:.3g}"
    falls = f"In free flight the acceleration is {times} times gravity"
    if counts_frames(tracks, settings):
        rate = float(ratio**-0.5)
        if not RATE_LIMITS[0] <= rate <= RATE_LIMITS[1]:
            return [], 1.0
        usual = usual_rate(rate, settings.unit_tolerance / 2.0)  # rates go with the root of accelerations
        near = f" ({usual:g} is usual)" if usual is not None and f"{rate:.3g}" != f"{usual:g}" else ""
        sentence = (
            f"{falls} and times are 0, 1, 2, ..., so that they seem to count frames, about {rate:.3g} a second{near}: "
            f"call their column frame and give --fps {usual or rate:.3g}, or state --units s if a second really passes "
            "between samples."
        )
        severity: Severity = "refuse" if sure else "caution"
        return [Finding("frame_numbers", severity, sentence)], 1.0
    slow = float(np.median([t.interval for t in tracks])) > settings.slow
    choices = [(name, "s", factor) for name, factor in LENGTHS.items() if not (slow and name == "km")]
    if slow:
        choices += [("m", "ms", 1e-6), *((name, "ms", 1e-6 * factor) for name, _, factor in choices)]
    unit, clock, factor = min(choices, key=lambda c: abs(np.log(ratio / c[2])))
    off = abs(float(np.log(ratio / factor)))
    # Drag and lift change an acceleration by tens of percent, so that units are not met exactly.
    if off > settings.unit_tolerance + 3.0 * fall.error:
        sentence = (
            f"{falls}, which is the factor of no common unit of length: if positions are in pixels give their "
            "scale with --pixels-per-metre, and check the gravity of the world."
        )
        return [] if ratio < 1.0 else [Finding("units", "caution", sentence)], 1.0
    close = off <= settings.close_match + 3.0 * fall.error
    far = not 1.0 / settings.no_effect < factor < settings.no_effect
    sure = unit != "km" and ((sure and (close or far)) or (close and far))
    wrong = {unit: f"positions seem to be in {NAMES[unit]}", clock: "times seem to be in milliseconds"}
    stated = [name for name in (unit, clock) if name not in ("m", "s")]
    sentence = (
        f"{falls}, so that {' and '.join(wrong[name] for name in stated)}: state --units {','.join(stated)}, or "
        "--units m,s if they are in metres and seconds."
    )
    return [Finding("units", "refuse" if sure else "caution", sentence)], factor


def _axes(fall: Fall, gravity: Array, along: int, close: bool, settings: ScreenSettings) -> list[Finding]:
    """Return what the data's vertical axis seems to be, where it is not the world's."""
    upward = -1 if fall.acceleration[along] > 0.0 else 1
    down = np.zeros(3)
    down[along] = -upward * np.linalg.norm(gravity)
    usual = gravity[2] < 0.0 and not np.any(gravity[:2])
    main = int(np.argmax(np.abs(gravity)))
    vector = ", ".join(f"{v:g}" for v in down + 0.0)
    cure = f"give the world the gravity ({vector})"
    if usual:
        cure = f"write {RELABELLED[along, upward]} for the columns, so that z is up, or {cure}"
    unmeasured = "" if main in fall.measured else ", which was not measured"
    sentence = (
        f"In free flight bodies accelerate along {'+-'[upward > 0]}{'xyz'[along]} and not along the world's gravity, "
        f"{'+-'[int(gravity[main] < 0.0)]}{'xyz'[main]}{unmeasured}, so that axes of the data seem to be "
        f"{'flipped' if down @ gravity < 0.0 else 'swapped'}: {cure}."
    )
    severity: Severity = "refuse" if close and fall.share >= settings.refusing else "caution"
    return [Finding("axes", severity, sentence)]
