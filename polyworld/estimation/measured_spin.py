"""Estimate the angular velocity with which a body starts from a measured course of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Run
from polyworld.estimation.initial_support import noise_of

Array = NDArray[np.float64]

FEWEST = 8  # samples that say what a line leaves, and what noise does
ERRORS = 3.0  # standard errors of a sum of squares, beyond which what a line leaves is not noise


def initial_spin(run: Run, column: int) -> Array:
    """Return the first angular velocity (3,) [rad/s] of an object, world axes; NaN for components never measured.

    It is read off the straight line that describes as many of the first samples as it can within their noise: noise
    averages out, and where the spin decays or an impact changes it, the line ends.
    """
    spin = np.full(3, np.nan)
    for axis, course in enumerate(run.angular_velocities[:, column].T):
        seen = np.isfinite(course)
        if seen.any():
            spin[axis] = _first(run.times[seen] - run.times[seen][0], course[seen])
    return spin


def _first(times: Array, values: Array) -> float:
    first, count = float(values[0]), FEWEST
    while count <= len(values):
        line = np.polyfit(times[:count], values[:count], 1)
        rest = values[:count] - np.polyval(line, times[:count])
        free = count - 2
        if float(rest @ rest) > noise_of(values) ** 2 * (free + ERRORS * np.sqrt(2.0 * free)):
            break
        first = float(line[1])
        if count == len(values):
            break
        count = min(2 * count, len(values))
    return first
