"""Check the time base: rounded and irregular time stamps, frame numbers, milliseconds, rows that repeat."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from polyworld.data.noise import noise_levels
from polyworld.screening.finding import Finding, length, runs_listed
from polyworld.screening.grid import last_digit
from polyworld.screening.settings import DEFAULT, ScreenSettings
from polyworld.screening.tracks import Subject

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

RATES = (15.0, 24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 200.0, 240.0, 480.0, 960.0)  # [1/s] usual for cameras
STAMP_DIGITS = 7  # decimals of time stamps up to which they may be rounded


def usual_rate(rate: float, near: float) -> float | None:
    """Return the usual frame rate nearest to a rate [1/s], None where the logarithm of their ratio exceeds `near`."""
    best = min(RATES, key=lambda r: abs(np.log(rate / r)))
    return best if abs(np.log(rate / best)) <= near else None


def time_findings(data: Subject) -> list[Finding]:
    """Return the first caution on the time stamps of moving objects: what is wrong with them has one cause."""
    every = (f for check in (_frame_numbers, _milliseconds, _rounded, _irregular) for f in check(data))
    return [f for f in (next(every, None),) if f is not None]


def _frame_numbers(data: Subject) -> Iterator[Finding]:
    if data.counts_frames:
        yield Finding(
            "frame_numbers",
            "Times are 0, 1, 2, ... and look like frame numbers, not seconds: call their column frame and give the "
            "frames per second with --fps, unless there really is a second between samples.",
        )


def _milliseconds(data: Subject) -> Iterator[Finding]:
    interval = float(np.median([t.interval for t in data.moving])) if data.moving else 0.0
    if interval > data.settings.slow and (rate := usual_rate(1000.0 / interval, data.settings.same_rate)) is not None:
        yield Finding(
            "milliseconds",
            f"There are {interval:.4g} s between samples, which would be {rate:.4g} frames per second if times were "
            "milliseconds: state --units ms, unless they are seconds.",
        )


def _rounded(data: Subject) -> Iterator[Finding]:
    """Caution where rounding of the stamps, times the speed, makes much of the noise."""
    concerned = []
    for track in data.moving:
        step, gaps = last_digit(track.times, STAMP_DIGITS, 1e-5), np.diff(track.times)
        near = gaps[gaps < 1.5 * track.interval + step]
        if not step > 0.0 or np.ptp(near) < 0.5 * step or np.any(np.abs(near - near.mean()) > 1.01 * step):
            continue
        places = track.places[:, track.axes]
        speed = np.sqrt(np.nanmean((np.diff(places, axis=0) / gaps[:, None]) ** 2, axis=0))
        error = float(speed.max()) * step / np.sqrt(12.0)
        if error > data.settings.rounding_share * float(track.noise[track.axes][np.argmax(speed)]):
            concerned.append((error, step, 1.0 / float(near.mean()), track.run))
    if concerned:
        error, digit, rate, _ = max(concerned)
        yield Finding(
            "rounded_times",
            f"Time stamps of {runs_listed(c[-1] for c in concerned)} are rounded to {digit:g} s, which at the speeds "
            f"measured shifts positions by {length(error)} and is a large part of the noise: write times with more "
            f"digits, or number the frames in a column frame and give --fps {rate:.4g}.",
        )


def _irregular(data: Subject) -> Iterator[Finding]:
    """Caution where many intervals are no multiple of the median one; whole frames that are missing do no harm."""
    ratios = [np.diff(t.times) / t.interval for t in data.moving]
    off = [float((np.abs(r - np.maximum(np.round(r), 1.0)) > data.settings.irregular).mean()) for r in ratios]
    concerned = [t.run for t, o in zip(data.moving, off, strict=True) if o > data.settings.irregular_share]
    if concerned:
        yield Finding(
            "irregular_times",
            f"Intervals between samples of {runs_listed(concerned)} vary irregularly ({100.0 * max(off):.0f}% differ "
            "from the median interval): if the camera ran at a constant rate, number the frames in a column frame and "
            "give the rate with --fps; if the times are right, nothing has to be done.",
        )


def repeated(data: Subject) -> Iterator[Finding]:
    """Caution where rows repeat while the object moves, as frames that are shown twice."""
    again = [(t.run, repeated_rows(t.times, t.places, t.quantum, data.settings)) for t in data.tracks]
    least, share = data.settings.repeated_least, data.settings.repeated_share
    again = [(run, rows) for run, rows in again if rows.sum() >= least and rows.mean() >= share]
    if again:
        yield Finding(
            "repeated_rows",
            f"In {runs_listed(run for run, _ in again)}, {sum(int(rows.sum()) for _, rows in again)} of "
            f"{sum(len(rows) for _, rows in again)} rows repeat the row before while the object moves, as where a clip "
            "shows frames twice: leave the repeated frames out, or read the clip at the rate at which it was filmed.",
        )


def repeated_rows(
    times: Array, values: Array, quantum: Array | float = 0.0, settings: ScreenSettings = DEFAULT
) -> Bools:
    """Return which rows (m,) of values (m, d) repeat the row before although the object moved.

    quantum (d,) or one number: step of the grid that values lie on, 0 where there is none. A row repeats the one before
    where all components are equal (NaN equals NaN) and, on some axis, the motion before and after goes the same way and
    is so fast that a quantum and the noise are passed within the interval. At a turning point, and where a slow motion
    stays within a pixel, equal rows are what a right measurement gives.
    """
    again = np.zeros(len(values), dtype=bool)
    equal = np.all((values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1])), axis=1)
    first = np.flatnonzero(np.concatenate([[True], ~equal]))  # of each group of equal rows
    if len(first) < 3 or not equal.any():
        return again
    velocity = np.diff(values[first], axis=0) / np.diff(times[first])[:, None]  # from group to group
    before, after = velocity[:-1], velocity[1:]
    speed = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    rounding = np.broadcast_to(np.asarray(quantum, dtype=float), values.shape[1:])
    lengths = np.diff(np.append(first, len(values)))
    pixel = 0.0 if np.any(rounding > 0.0) else _uneven_step(values[first], lengths, settings)
    # Without a grid, equal rows are no accident of the noise.
    noise = np.nan_to_num(noise_levels(times[first], values[first]))
    margin = np.where(rounding > 0.0, rounding + 3.0 * np.sqrt(np.maximum(noise**2 - rounding**2 / 12.0, 0.0)), 0.0)
    rows, group = np.flatnonzero(equal) + 1, np.repeat(np.arange(len(first)), lengths)
    rows = rows[(group[rows] > 0) & (group[rows] < len(first) - 1)]
    motion = speed[group[rows] - 1] * (times[rows] - times[rows - 1])[:, None]
    passed = np.any((motion > margin) & (motion > 0.0), axis=1)
    again[rows] = passed & (np.linalg.norm(motion, axis=1) > pixel)
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
