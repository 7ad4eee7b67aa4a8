"""Check the time base: rounded and irregular time stamps, frame numbers, milliseconds, rows that repeat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.data.noise import noise_levels
from polyworld.screening.finding import Finding, length, runs_listed
from polyworld.screening.settings import DEFAULT, ScreenSettings
from polyworld.screening.tracks import Track, last_digit

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

RATES = (15.0, 24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 200.0, 240.0, 480.0, 960.0)  # [1/s] usual for cameras
STAMP_DIGITS = 7  # decimals of time stamps up to which they may be rounded


def counts_frames(tracks: Sequence[Track], settings: ScreenSettings) -> bool:
    """Whether all times are whole numbers that mostly grow by one."""
    long = [t for t in tracks if len(t.times) >= settings.few_samples]
    whole = all(np.all(np.abs(t.times - np.round(t.times)) < 1e-9) for t in tracks)
    return bool(long) and whole and all(abs(t.interval - 1.0) < 1e-9 for t in long)


def usual_rate(rate: float, near: float) -> float | None:
    """Return the usual frame rate nearest to a rate [1/s], None where the logarithm of their ratio exceeds `near`."""
    best = min(RATES, key=lambda r: abs(np.log(rate / r)))
    return best if abs(np.log(rate / best)) <= near else None


def time_findings(tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Return cautions on the time stamps of moving objects, each kind once."""
    if counts_frames(tracks, settings):
        sentence = (
            "Times are 0, 1, 2, ... and look like frame numbers, not seconds: call their column frame and give the "
            "frames per second with --fps, unless there really is a second between samples."
        )
        return [Finding("frame_numbers", "caution", sentence)]
    moving = [t for t in tracks if t.moves(settings.moved) and len(t.times) >= settings.few_samples]
    interval = float(np.median([t.interval for t in moving])) if moving else 0.0
    if interval > settings.slow and (rate := usual_rate(1000.0 / interval, settings.same_rate)) is not None:
        sentence = (
            f"There are {interval:.4g} s between samples, which would be {rate:.4g} frames per second if times were "
            "milliseconds: state --units ms, unless they are seconds."
        )
        return [Finding("milliseconds", "caution", sentence)]
    return _rounded(moving, settings) or _irregular(moving, settings)


def _rounded(tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution where rounding of the stamps, times the speed, makes much of the noise."""
    worst, digit, regular, concerned = 0.0, 0.0, 0.0, []
    for track in tracks:
        step = last_digit(track.times, STAMP_DIGITS, 1e-5)
        gaps = np.diff(track.times)
        near = gaps[gaps < 1.5 * track.interval + step]
        mean = float(near.mean())
        if not step > 0.0 or np.ptp(near) < 0.5 * step or np.any(np.abs(near - mean) > 1.01 * step):
            continue
        axes = list(track.axes)
        speed = np.sqrt(np.nanmean((np.diff(track.places[:, axes], axis=0) / gaps[:, None]) ** 2, axis=0))
        error = float(np.max(speed)) * step / np.sqrt(12.0)
        if error > settings.rounding_share * float(track.noise[axes][np.argmax(speed)]):
            concerned.append(track.run)
            if error > worst:
                worst, digit, regular = float(error), step, mean
    if not concerned:
        return []
    sentence = (
        f"Time stamps of {runs_listed(concerned)} are rounded to {digit:g} s, which at the speeds measured shifts "
        f"positions by {length(worst)} and is a large part of the noise: write times with more digits, or number "
        f"the frames in a column frame and give --fps {1.0 / regular:.4g}."
    )
    return [Finding("rounded_times", "caution", sentence)]


def _irregular(tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution where many intervals are no multiple of the median one; whole frames that are missing do no harm."""
    concerned, share = [], 0.0
    for track in tracks:
        ratio = np.diff(track.times) / track.interval
        off = np.abs(ratio - np.maximum(np.round(ratio), 1.0)) > settings.irregular
        if off.mean() > settings.irregular_share:
            concerned.append(track.run)
            share = max(share, float(off.mean()))
    if not concerned:
        return []
    sentence = (
        f"Intervals between samples of {runs_listed(concerned)} vary irregularly ({100.0 * share:.0f}% differ from the "
        "median interval): if the camera ran at a constant rate, number the frames in a column frame and give the rate "
        "with --fps; if the times are right, nothing has to be done."
    )
    return [Finding("irregular_times", "caution", sentence)]


def repeated_rows(
    times: Array, values: Array, quantum: Array | float = 0.0, settings: ScreenSettings = DEFAULT
) -> Bools:
    """Return which rows (m,) of values (m, d) repeat the row before although the object moved.

    quantum (d,) or one number: step of the grid that values lie on, 0 where there is none. A row repeats the one before
    where all components are equal (NaN equals NaN) and, on some axis, the motion before and after goes the same way and
    is so fast that a quantum and the noise are passed within the interval. At a turning point, and where a slow motion
    stays within a pixel, equal rows are what a right measurement gives.
    """
    m = len(values)
    again = np.zeros(m, dtype=bool)
    if m < 3:
        return again
    equal = np.all((values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1])), axis=1)
    first = np.flatnonzero(np.concatenate([[True], ~equal]))  # of each group of equal rows
    if len(first) < 3 or not equal.any():
        return again
    velocity = np.diff(values[first], axis=0) / np.diff(times[first])[:, None]  # from group to group
    before, after = velocity[:-1], velocity[1:]
    speed = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    rounding = np.broadcast_to(np.asarray(quantum, dtype=float), values.shape[1:])
    pixel = 0.0 if np.any(rounding > 0.0) else _uneven_step(values[first], np.diff(np.append(first, m)), settings)
    # Without a grid, equal rows are no accident of the noise.
    noise = np.nan_to_num(noise_levels(times[first], values[first]))
    margin = np.where(rounding > 0.0, rounding + 3.0 * np.sqrt(np.maximum(noise**2 - rounding**2 / 12.0, 0.0)), 0.0)
    group = np.cumsum(np.concatenate([[True], ~equal])) - 1
    for row in np.flatnonzero(equal) + 1:
        k = group[row]
        if 0 < k < len(first) - 1:
            motion = speed[k - 1] * (times[row] - times[row - 1])
            again[row] = bool(np.any((motion > margin) & (motion > 0.0))) and float(np.linalg.norm(motion)) > pixel
    return again


def _uneven_step(values: Array, lengths: NDArray[np.int64], settings: ScreenSettings) -> float:
    """The step of a motion from pixel to pixel that is no grid because pixels were mapped to a plane; 0 for others.

    values (k, d) and lengths (k,) of groups of equal rows. Steps from pixel to pixel are alike and last the longer the
    slower the motion; frames shown again last one or two intervals each, and their steps follow the speed.
    """
    steps = np.linalg.norm(np.nan_to_num(np.diff(values, axis=0)), axis=1)
    low, high = np.quantile(steps, [settings.negligible, 1.0 - settings.negligible])
    often = np.unique(lengths, return_counts=True)[1] >= (1.0 - settings.on_grid) * len(lengths)
    alike, uneven = high < settings.pixel_steps * low, np.count_nonzero(often) > settings.conversions
    return float(np.median(steps)) if alike and uneven else 0.0


def repeat_findings(tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution where rows repeat while the object moves, as frames that are shown twice."""
    concerned, count, rows = [], 0, 0
    for track in tracks:
        again = repeated_rows(track.times, track.places, track.quantum, settings)
        if again.sum() >= settings.repeated_least and again.mean() >= settings.repeated_share:
            concerned.append(track.run)
            count, rows = count + int(again.sum()), rows + len(again)
    if not concerned:
        return []
    sentence = (
        f"In {runs_listed(concerned)}, {count} of {rows} rows repeat the row before while the object moves, as where a "
        "clip shows frames twice: leave the repeated frames out, or read the clip at the rate at which it was filmed."
    )
    return [Finding("repeated_rows", "caution", sentence)]
