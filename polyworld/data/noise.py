"""Measure the noise of series before any model, by what local polynomials leave.

A smooth motion is a parabola over a few samples; where polynomials of the next degree still leave much less, motion is
in it and the next degree is taken. Windows with the largest remains are trimmed, since impacts disturb a few. Rounding
has a step: no noise is less than its standard deviation. What a fit leaves beyond this noise is its remainder, and
never changes the noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.float64]

KEPT = 0.8  # share of windows that counts: up to a fifth may span an impact
FEWEST = 4  # windows that show a level
LOWEST, HIGHEST = 2, 6  # degrees of polynomials that follow a motion
FALLING = 0.3  # ratio of variances from degree to degree below which motion is left: noise keeps 1
WIDER = 1.5  # times the length of windows that is tried next,
WIDEST = 8  # windows that a series holds at least: an impact disturbs one in eight
FLAT = 1.2  # growth of the variance with the windows up to which it is noise


def noise_level(times: Array, values: Array) -> float:
    """Return the standard deviation of the noise of a series (T,); NaN where too few samples show it.

    Polynomials over the shortest windows follow the motion; windows then grow while they leave no more, since each
    sample shows the noise better in a longer one.
    """
    seen = np.isfinite(values)
    times, values = times[seen], values[seen]
    steps = np.diff(times)
    if len(steps) < LOWEST + FEWEST:
        return np.nan
    even = np.abs(steps - np.median(steps)) < 0.3 * np.median(steps)
    degree, level = LOWEST, _of_windows(values, even, LOWEST + 2, LOWEST)
    while np.isfinite(level) and degree < HIGHEST:
        own = _of_windows(values, even, degree + 3, degree + 1)
        if not own**2 <= FALLING * level**2:
            break
        degree, level = degree + 1, own
    length, most = degree + 2, FLAT * level**2
    while (wider := int(np.ceil(WIDER * length))) <= len(values) // WIDEST:
        own = _of_windows(values, even, wider, degree)
        if not own**2 <= most:
            break
        length, level = wider, own
    return max(level, _rounding(values)) if np.isfinite(level) else np.nan


def noise_levels(times: Array, values: Array) -> Array:
    """Return the same (c,) for several series (T, c)."""
    return np.array([noise_level(times, column) for column in values.T])


def _of_windows(values: Array, even: NDArray[np.bool_], length: int, degree: int) -> float:
    """Return what polynomials of a degree leave in windows of so many samples; impacts disturb a share of these."""
    if len(values) < length:
        return np.nan
    whole = np.lib.stride_tricks.sliding_window_view(even, length - 1).all(axis=1)
    if whole.sum() < FEWEST:
        return np.nan
    windows = np.lib.stride_tricks.sliding_window_view(values, length)[whole]
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), degree + 1))[0]
    windows = windows - windows[:, :1]
    square = np.sort(((windows - (windows @ basis) @ basis.T) ** 2).sum(axis=1))
    free = length - degree - 1
    kept = chi2.cdf(chi2.ppf(KEPT, free), free + 2) / KEPT  # mean of a chi-square variable below its quantile
    return float(np.sqrt(square[: max(3, int(KEPT * len(square)))].mean() / (free * kept)))


def _rounding(values: Array) -> float:
    """Return the standard deviation of rounding where values come again, else 0."""
    steps = np.unique(values)
    if not 1 < len(steps) <= 0.8 * len(values):
        return 0.0
    return float(np.diff(steps).min() / np.sqrt(12.0))
