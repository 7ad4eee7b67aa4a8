"""Detect positions that lie on a grid, as whole pixels do, and tracks that are constant to the last digit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polyworld.screening.finding import Finding, length, listed, runs_listed
from polyworld.screening.settings import DEFAULT, ScreenSettings

if TYPE_CHECKING:
    from polyworld.screening.tracks import Subject, Track

Array = NDArray[np.float64]

LAST_DIGIT = 1e-6  # of a last digit: what reading and scaling a number in double precision may be off by
DECIMALS = 9  # after the point, up to which data may be rounded
COARSE = 0.25  # last digit as a part of a step, beyond which half of all differences are multiples of both
REACH = (8, 64, 512, 4096)  # multiples of a step that refine it in turn
STRIDE = 8  # samples over which motion is read, so that single steps do not count


def last_digit(values: Array, decimals: int, error: float = LAST_DIGIT) -> float:
    """Return the power of ten of which all values are multiples, 0 where it has more than so many decimals.

    error: of a last digit, by reading and scaling numbers in double precision.
    """
    for count in range(decimals + 1):
        scaled = values * 10.0**count
        if np.all(np.abs(scaled - np.round(scaled)) < error * np.maximum(1.0, 1e-9 * np.abs(scaled))):
            return float(10.0**-count)
    return 0.0


def grid_step(values: Array, differences: Array, settings: ScreenSettings = DEFAULT) -> float:
    """Return the largest step of which all differences are multiples, 0 where there is none.

    values (n,): positions, from which the last decimal is read. A step that is not a round number, as of scaled pixels,
    is found as the least distance between differences that occur, refined on ever larger multiples.
    """
    digit = last_digit(values, DECIMALS)
    tolerance = 1.5 * digit if digit > 0.0 else 1e-9 * float(np.ptp(values)) if len(values) else 0.0
    sizes = np.abs(differences)
    sizes = sizes[sizes > tolerance / 3.0]
    if len(sizes) < settings.differences:
        return 0.0
    different = np.unique(sizes)
    if different[0] <= tolerance:
        return digit
    apart = np.diff(different) > tolerance
    first, last = np.flatnonzero(np.append(True, apart)), np.flatnonzero(np.append(apart, True))
    means = np.add.reduceat(different, first) / (last - first + 1)
    widest = float((different[last] - different[first]).max())
    step = float(np.diff(means, prepend=0.0).min())
    for largest in REACH:
        multiple = np.round(means / step)
        use = (multiple > 0) & (multiple <= largest)
        if use.any():
            step = float((multiple[use] @ means[use]) / (multiple[use] @ multiple[use]))
    ratio = digit / step
    whole = digit > 0.0 and abs(step / digit - round(step / digit)) < 0.02
    allowed = settings.negligible + (0.0 if whole else 0.75 * ratio)
    on_grid = np.mean(np.abs(sizes / step - np.round(sizes / step)) <= allowed)
    moved = np.abs(differences) > tolerance
    multiples = len(np.unique(np.round(means / step)))
    shown = multiples >= settings.multiples or np.sum(moved[1:] != moved[:-1]) >= settings.changes
    # Rounding splits a multiple in two last digits at most; more is motion.
    narrow = widest < tolerance and (whole or ratio < COARSE)
    return step if narrow and shown and on_grid >= settings.on_grid else digit


def quantised(data: Subject) -> Iterator[Finding]:
    """Caution where an object moves by less than a step of its grid between samples: rounding errors then repeat."""
    settings = data.settings
    for name in dict.fromkeys(t.object for t in data.tracks):
        own = [t for t in data.tracks if t.object == name]
        ranges = np.max([t.range for t in own], axis=0)
        slow: dict[str, float] = {}
        for axis in np.flatnonzero((own[0].quantum > 0.0) & (ranges >= settings.negligible * ranges.max())).tolist():
            moved = np.concatenate([_motion(t, axis) for t in own])
            if len(moved) >= settings.few_samples and float(np.median(moved)) < own[0].quantum[axis]:
                slow["xyz"[axis]] = float(np.median(moved))
        if slow:
            step = float(max(own[0].quantum["xyz".index(a)] for a in slow))
            yield Finding(
                "quantised",
                f"Positions of {name} along {listed(slow)} lie on a grid of {length(step)}, as whole pixels do, while "
                f"it moves by only {length(min(slow.values()))} between samples, so that rounding (standard deviation "
                f"{length(step / np.sqrt(12.0))}) is not independent from sample to sample: track centres to a "
                "fraction of a pixel, or leave out samples until the object moves by a pixel between them.",
            )


def _motion(track: Track, axis: int) -> Array:
    """Motion per sample [m] wherever there is any within some samples; what rests is no slow motion."""
    values = track.places[np.isfinite(track.places[:, axis]), axis]
    stride = max(1, min(STRIDE, len(values) // 4))
    moved = np.abs(values[stride:] - values[:-stride])
    return np.asarray(moved[moved > 0.5 * track.quantum[axis]] / stride)


def constant(data: Subject) -> Iterator[Finding]:
    """Caution on tracks that are constant to the last digit although others scatter; refuse where all are constant.

    Where rounding is coarse or data have no noise, as computed ones, a constant track is that of an object at rest.
    """
    still = [t for t in data.tracks if len(t.times) >= data.settings.few_samples and not t.range.any()]
    if len(still) == len(data.tracks):
        yield Finding(
            "constant",
            "All positions are the same to the last digit in all samples of each run, so that there is no motion to "
            "explain: check the tracks.",
            "refuse",
        )
        return
    others = [t for t in data.tracks if t.range.any()]
    noisy = any(np.any(t.noise > data.settings.resolved * t.range.max()) for t in others)
    if not noisy or any(np.any(t.quantum > 0.0) for t in others):
        return
    for name in dict.fromkeys(t.object for t in still):
        own = [t.run for t in still if t.object == name]
        where = "all runs" if len(own) == sum(t.object == name for t in data.tracks) else runs_listed(own)
        yield Finding(
            "constant",
            f"The position of {name} is the same to the last digit in all samples of {where}, although other tracks "
            "scatter, so that the tracker may be stuck: leave the object out of the data there, or make it a static of "
            "the world if it never moves.",
        )
