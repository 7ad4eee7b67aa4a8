"""Estimate the acceleration of free flight and compare it with gravity: wrong units of length or time, swapped axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.expressions.effect import law_of
from polyworld.screening.finding import Finding, Severity
from polyworld.screening.settings import ScreenSettings
from polyworld.screening.statics import touching
from polyworld.screening.time_stamps import usual_rate
from polyworld.screening.tracks import Subject, Track
from polyworld.world import World

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

WINDOWS = (7, 15, 31, 63, 127, 255)  # samples that a parabola is fitted to; noise asks for long ones, bounces for short
EVEN = 1e-6  # of half a window: differences of time stamps that are rounding
ERRORS = 3.0  # standard errors within which accelerations are the same
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

    @property
    def size(self) -> float:
        """Length of the acceleration."""
        return float(np.linalg.norm(self.acceleration))

    @property
    def along(self) -> int:
        """The axis that it is most along."""
        return int(np.argmax(np.abs(self.acceleration)))


def common_fall(data: Subject) -> Fall | None:
    """Estimate the acceleration of free flight, None where stretches of flight have no constant one in common.

    Bodies of a spatial world with gravity that no joint, attachment or driving effect holds. Windows count where a
    parabola describes the motion, its acceleration is significant and the body is not on a static.
    """
    world, settings = data.world, data.settings
    if world.planar or world.observer is not None or not np.any(world.environment.gravity):
        return None
    every = [_windows(data, t) for t in data.tracks if _flies_freely(world, t.object)]
    found = [w for w in every if len(w[2])]
    if not found:
        return None
    middles = np.array([_weighted_median(a, w) for a, _, w in found])
    measured = np.isfinite(middles).any(axis=0)
    common = np.zeros(3)
    common[measured] = np.nanmedian(middles[:, measured], axis=0)
    size = float(np.linalg.norm(common))
    if not size > 0.0:
        return None

    def agree(accelerations: Array, errors: Array) -> Bools:
        off = np.linalg.norm(np.nan_to_num(accelerations) - common, axis=1)
        return np.asarray(off <= settings.constant * size + ERRORS * errors)

    errors = np.array([np.median(e) / np.sqrt(max(len(w) / 2.0, 1.0)) for _, e, w in found])
    accelerations, own_errors, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
    of_windows = float(weights @ agree(accelerations, own_errors) / weights.sum())
    share = min(float(agree(middles, errors).mean()), of_windows)
    if share < settings.agreeing:
        return None
    relative = float(np.median(errors) / np.sqrt(len(found)) / size)
    return Fall(common, relative, share, tuple(np.flatnonzero(measured).tolist()))


def _flies_freely(world: World, name: str) -> bool:
    held = {n for j in world.joints for n in (j.object, j.other)}
    acting = (e for e in world.effects if e.enabled and (e.objects is None or name in e.objects))
    rigid = name in {o.name for o in world.objects}
    return rigid and name not in held and not world.attachments and all(law_of(e).falling for e in acting)


def _windows(data: Subject, track: Track) -> tuple[Array, Array, Array]:
    """Accelerations (W, 3), standard errors (W,) of their length, and numbers of samples (W,) of windows of flight."""
    settings, noise = data.settings, track.noise[track.axes]
    rows = np.isfinite(track.places[:, track.axes]).all(axis=1)
    near = touching(data, data.world.object(track.object), track)[rows]
    times, places = track.times[rows], track.places[rows][:, track.axes]
    found = [(np.empty((0, 3)), np.empty(0), np.empty(0))]
    for size in (s for s in WINDOWS if s <= len(times)):
        index = np.arange(0, len(times) - size + 1, size // 2)[:, None] + np.arange(size)
        index = index[near[index].mean(axis=1) < 0.5]
        if not len(index):
            continue
        t, y = times[index], places[index]
        half = (t[:, -1:] - t[:, :1]) / 2.0
        scaled = (t - t[:, :1]) / half - 1.0
        if np.ptp(scaled, axis=0).max() < EVEN:
            scaled = scaled[:1]  # one design for all
        design = np.stack([np.ones_like(scaled), scaled, scaled**2], axis=-1)
        inverse = np.linalg.inv(np.swapaxes(design, 1, 2) @ design)
        y0, y = y, y - y.mean(axis=1, keepdims=True)
        fitted = inverse @ np.swapaxes(design, 1, 2) @ y  # (W, 3, axes)
        left, free = ((y - design @ fitted) ** 2).sum(axis=1), size - 3.0
        bend = np.linalg.norm(fitted[:, 2], axis=1)
        noisy = np.all(left <= noise**2 * (free + settings.significant * np.sqrt(2.0 * free)), axis=1)
        smooth = np.sqrt(left.sum(axis=1) / size) <= settings.bend * bend
        error = np.linalg.norm(noise) * np.sqrt(np.broadcast_to(inverse[:, 2, 2], bend.shape))
        good = (noisy | smooth) & (bend > settings.significant * error) & ~_supported(track, y0, fitted[:, 2], settings)
        scale = 2.0 / half[good, 0] ** 2
        acceleration = np.full((len(scale), 3), np.nan)
        acceleration[:, track.axes] = fitted[good, 2] * scale[:, None]
        found.append((acceleration, error[good] * scale, np.full(len(scale), float(size))))
    accelerations, errors, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return accelerations, errors, weights


def _supported(track: Track, places: Array, bend: Array, settings: ScreenSettings) -> Bools:
    """Whether windows (W, n, axes) stay at an end of the range along an axis without any acceleration there.

    So does what slides or rests on a floor or against a wall, whatever the units; bend (W, axes): of the parabolas.
    """
    span, small = track.range[track.axes], settings.negligible
    middle = (places.mean(axis=1) - np.nanmin(track.places[:, track.axes], axis=0)) / np.where(span > 0.0, span, 1.0)
    still = np.ptp(places, axis=1) <= small * span + settings.significant * track.noise[track.axes]
    straight = np.abs(bend) <= small * np.linalg.norm(bend, axis=1, keepdims=True)
    at_end = np.abs(middle - 0.5) > 0.5 - small
    held: Bools = np.any(still & at_end & straight & (span > small * span.max()), axis=1)
    return held


def _weighted_median(values: Array, weights: Array) -> Array:
    """Component by component (3,), NaN where not measured."""
    order = np.argsort(values, axis=0)
    total = np.cumsum(weights[order], axis=0)
    at = np.argmax(total >= 0.5 * total[-1], axis=0)
    middle: Array = np.take_along_axis(values, order, axis=0)[at, np.arange(values.shape[1])]
    return middle


def fall_findings(data: Subject) -> list[Finding]:
    """Return what the acceleration of free flight says about units of length and time, and about axes."""
    fall, settings = common_fall(data), data.settings
    if fall is None:
        return []
    gravity = np.asarray(data.world.environment.gravity, dtype=float)
    ratio = fall.size / float(np.linalg.norm(gravity))
    cosine = float(fall.acceleration @ gravity) / fall.size / float(np.linalg.norm(gravity))
    on_axis = abs(float(fall.acceleration[fall.along])) >= settings.oblique * fall.size
    wrong_way = on_axis and cosine < 1.0 - settings.oblique
    if cosine < 0.5 and not wrong_way:
        return []
    units: list[Finding] = []
    factor = 1.0
    if not 1.0 / settings.unlike < ratio < settings.unlike:
        units, factor = (_frames if data.counts_frames else _units)(data, fall, ratio)
    if not wrong_way:
        return units
    off = abs(float(np.log(ratio / factor)))
    # Any other acceleration in a direction of its own is friction, a slope or buoyancy.
    if off > settings.unit_tolerance + ERRORS * fall.error:
        return []
    sure = off <= settings.close_match + ERRORS * fall.error and fall.share >= settings.refusing
    return [*units, _axes(fall, gravity, "refuse" if sure else "caution")]


def _falls(ratio: float) -> str:
    return f"In free flight the acceleration is {f'{ratio:.0f}' if ratio >= 100.0 else f'{ratio:.3g}'} times gravity"


def _frames(data: Subject, fall: Fall, ratio: float) -> tuple[list[Finding], float]:
    """Return the frame rate that gravity gives times that count frames."""
    rate = float(ratio**-0.5)
    if not RATE_LIMITS[0] <= rate <= RATE_LIMITS[1]:
        return [], 1.0
    usual = usual_rate(rate, data.settings.unit_tolerance / 2.0)  # rates go with the root of accelerations
    near = f" ({usual:g} is usual)" if usual is not None and f"{rate:.3g}" != f"{usual:g}" else ""
    sentence = (
        f"{_falls(ratio)} and times are 0, 1, 2, ..., so that they seem to count frames, about {rate:.3g} a second"
        f"{near}: call their column frame and give --fps {usual or rate:.3g}, or state --units s if a second really "
        "passes between samples."
    )
    sure = fall.share >= data.settings.refusing
    return [Finding("frame_numbers", sentence, "refuse" if sure else "caution")], 1.0


def _units(data: Subject, fall: Fall, ratio: float) -> tuple[list[Finding], float]:
    """Return what the ratio of the acceleration to gravity says about units, and the factor of the units."""
    settings = data.settings
    slow = float(np.median([t.interval for t in data.tracks])) > settings.slow
    choices = [(name, "s", factor) for name, factor in LENGTHS.items() if not (slow and name == "km")]
    if slow:
        choices += [("m", "ms", 1e-6), *((name, "ms", 1e-6 * factor) for name, _, factor in choices)]
    unit, clock, factor = min(choices, key=lambda c: abs(np.log(ratio / c[2])))
    off = abs(float(np.log(ratio / factor)))
    # Drag and lift change an acceleration by tens of percent, so that units are not met exactly.
    if off > settings.unit_tolerance + ERRORS * fall.error:
        sentence = (
            f"{_falls(ratio)}, which is the factor of no common unit of length: if positions are in pixels give their "
            "scale with --pixels-per-metre, and check the gravity of the world."
        )
        return [] if ratio < 1.0 else [Finding("units", sentence)], 1.0
    close = off <= settings.close_match + ERRORS * fall.error
    far = not 1.0 / settings.no_effect < factor < settings.no_effect
    sure = unit != "km" and ((fall.share >= settings.refusing and (close or far)) or (close and far))
    wrong = {unit: f"positions seem to be in {NAMES[unit]}", clock: "times seem to be in milliseconds"}
    stated = [name for name in (unit, clock) if name not in ("m", "s")]
    sentence = (
        f"{_falls(ratio)}, so that {' and '.join(wrong[name] for name in stated)}: state --units {','.join(stated)}, "
        "or --units m,s if they are in metres and seconds."
    )
    return [Finding("units", sentence, "refuse" if sure else "caution")], factor


def _axes(fall: Fall, gravity: Array, severity: Severity) -> Finding:
    """Return what the data's vertical axis seems to be, where it is not the world's."""
    upward, main = -1 if fall.acceleration[fall.along] > 0.0 else 1, int(np.argmax(np.abs(gravity)))
    down = np.zeros(3)
    down[fall.along] = -upward * np.linalg.norm(gravity)
    cure = f"give the world the gravity ({', '.join(f'{v:g}' for v in down + 0.0)})"
    if gravity[2] < 0.0 and not np.any(gravity[:2]):
        cure = f"write {RELABELLED[fall.along, upward]} for the columns, so that z is up, or {cure}"
    unmeasured = "" if main in fall.measured else ", which was not measured"
    sentence = (
        f"In free flight bodies accelerate along {'+-'[upward > 0]}{'xyz'[fall.along]} and not along the world's "
        f"gravity, {'+-'[int(gravity[main] < 0.0)]}{'xyz'[main]}{unmeasured}, so that axes of the data seem to be "
        f"{'flipped' if down @ gravity < 0.0 else 'swapped'}: {cure}."
    )
    return Finding("axes", sentence, severity)
