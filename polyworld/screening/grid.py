"""Detect positions that lie on a grid, as whole pixels do, and tracks that are constant to the last digit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.data.noise import noise_level
from polyworld.screening.finding import Finding, length, listed, runs_listed
from polyworld.screening.settings import DEFAULT, ScreenSettings
from polyworld.screening.tracks import Track, last_digit

Array = NDArray[np.float64]

DECIMALS = 9  # after the point, up to which data may be rounded
COARSE = 0.25  # last digit as a part of a step, beyond which half of all differences are multiples of both
REACH = (8, 64, 512, 4096)  # multiples of a step that refine it in turn
STRIDE = 8  # samples over which motion is read, so that single steps do not count


def grid_steps(tracks: Sequence[Track], settings: ScreenSettings) -> dict[tuple[str, int], float]:
    """Return the step [m] of the grid by object and axis, where rounding to it makes much of the noise.

    Differences from sample to sample are integer multiples of the step, whatever the origin of each run. Steps that are
    finer than the motion resolves, or well below the noise, as the last decimal of a good measurement, are left out.
    """
    found = {}
    for name in dict.fromkeys(t.object for t in tracks):
        own = [t for t in tracks if t.object == name]
        extent = max(float(t.range.max()) for t in own)
        for axis in range(3):
            columns = [t.places[np.isfinite(t.places[:, axis]), axis] for t in own]
            values = np.concatenate(columns)
            if len(values) <= settings.differences or not extent > 0.0:
                continue
            step = grid_step(values, np.concatenate([np.diff(c) for c in columns]), settings)
            if not step > settings.resolved * extent:
                continue
            levels = [noise_level(t.times, t.places[:, axis]) for t in own]
            noise = float(np.nanmedian(levels)) if np.isfinite(levels).any() else 0.0
            if step / np.sqrt(12.0) > settings.rounding_share * noise:
                found[name, axis] = step
    return found


def grid_step(values: Array, differences: Array, settings: ScreenSettings = DEFAULT) -> float:
    """Return the largest step of which all differences are multiples, 0 where there is none.

    values (n,): positions, from which the last decimal is read. A step that is not a round number, as of scaled pixels,
    is found as the least distance between differences that occur, refined on ever larger multiples.
    """
    digit = last_digit(values, DECIMALS)
    tolerance = 1.5 * digit if digit > 0.0 else 1e-9 * float(np.ptp(values))
    sizes = np.abs(differences)
    sizes = sizes[sizes > tolerance / 3.0]
    if len(sizes) < settings.differences:
        return 0.0
    different = np.unique(sizes)
    if different[0] <= tolerance:
        return digit
    group = np.concatenate([[0], np.cumsum(np.diff(different) > tolerance)])
    count = np.bincount(group)
    means = np.bincount(group, weights=different) / count
    widths = different[np.cumsum(count) - 1] - different[np.cumsum(count) - count]
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
    narrow = float(widths.max()) < tolerance and (whole or ratio < COARSE)
    return step if narrow and shown and on_grid >= settings.on_grid else digit


def grid_findings(tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution where an object moves by less than a step of its grid between samples: rounding errors then repeat."""
    found = []
    for name in dict.fromkeys(t.object for t in tracks):
        own = [t for t in tracks if t.object == name]
        slow: dict[int, float] = {}
        for axis in np.flatnonzero(own[0].quantum > 0.0):
            step = float(own[0].quantum[axis])
            moved = np.concatenate([_motion(t, int(axis), step) for t in own])
            carried = max(float(t.range[axis]) for t in own) >= settings.negligible * max(
                float(t.range.max()) for t in own
            )
            if carried and len(moved) >= settings.few_samples and float(np.median(moved)) < step:
                slow[int(axis)] = float(np.median(moved))
        if not slow:
            continue
        axes = list(slow)
        step = max(float(own[0].quantum[a]) for a in axes)
        least = min(slow.values())
        sentence = (
            f"Positions of {name} along {listed('xyz'[a] for a in axes)} lie on a grid of {length(step)}, as whole "
            f"pixels do, while it moves by only {length(least)} between samples, so that rounding (standard deviation "
            f"{length(step / np.sqrt(12.0))}) is not independent from sample to sample: track centres to a fraction of "
            "a pixel, or leave out samples until the object moves by a pixel between them."
        )
        found.append(Finding("quantised", "caution", sentence))
    return found


def _motion(track: Track, axis: int, step: float) -> Array:
    """Motion per sample [m] wherever there is any within some samples; what rests is no slow motion."""
    values = track.places[np.isfinite(track.places[:, axis]), axis]
    stride = max(1, min(STRIDE, len(values) // 4))
    moved: Array = np.abs(values[stride:] - values[:-stride])
    return np.asarray(moved[moved > 0.5 * step] / stride)


def at_rest() -> Finding:
    """Return the caution that nothing moves by more than the noise."""
    sentence = (
        "No object moves by more than the noise of its track in any run, so that there is no motion to explain: check "
        "the tracks, or add runs with motion."
    )
    return Finding("at_rest", "caution", sentence)


def constant_findings(tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution on tracks that are constant to the last digit although others scatter; refuse where all are constant.

    Where rounding is coarse or data have no noise, as computed ones, a constant track is that of an object at rest.
    """
    still = [t for t in tracks if len(t.times) >= settings.few_samples and not t.range.any()]
    if tracks and len(still) == len(tracks):
        sentence = (
            "All positions are the same to the last digit in all samples of each run, so that there is no motion to "
            "explain: check the tracks."
        )
        return [Finding("constant", "refuse", sentence)]
    others = [t for t in tracks if t.range.any()]
    noisy = any(np.any(t.noise > settings.resolved * t.range.max()) for t in others)
    if not noisy or any(np.any(t.quantum > 0.0) for t in others):
        return []
    found = []
    for name in dict.fromkeys(t.object for t in still):
        own = [t.run for t in still if t.object == name]
        where = "all runs" if len(own) == sum(t.object == name for t in tracks) else runs_listed(own)
        sentence = (
            f"The position of {name} is the same to the last digit in all samples of {where}, although other tracks "
            "scatter, so that the tracker may be stuck: leave the object out of the data there, or make it a static of "
            "the world if it never moves."
        )
        found.append(Finding("constant", "caution", sentence))
    return found
