"""When margins and offsets change their sign between samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


Interval = tuple[float, float]


def where_positive(times: Array, margin: Array, covered: Interval) -> tuple[Interval, ...]:
    """Return where a margin (T,) is positive within what is covered, on straight lines between samples."""
    inner = (times > covered[0]) & (times < covered[1])
    grid = np.unique(np.concatenate([[covered[0]], times[inner], [covered[1]]]))
    m = np.interp(grid, times, margin)
    holds: list[Interval] = []
    since: float | None = float(grid[0]) if m[0] > 0 else None
    for k in range(1, len(grid)):
        if (m[k] > 0) == (m[k - 1] > 0):
            continue
        crossing = float(grid[k - 1] + m[k - 1] / (m[k - 1] - m[k]) * (grid[k] - grid[k - 1]))
        if since is None:
            since = crossing
        else:
            holds.append((since, crossing))
            since = None
    if since is not None:
        holds.append((since, float(grid[-1])))
    return tuple(holds)


def first_crossing(times: Array, offset: Array, covered: Interval) -> float | None:
    """Return when an offset (T,) first passes through zero within what is covered; None where it does not."""
    inner = times[(times > covered[0]) & (times < covered[1])]
    grid = np.unique(np.concatenate([[covered[0]], inner, [covered[1]]]))
    value = np.interp(grid, times, offset)
    for k in range(1, len(grid)):
        if value[k - 1] == 0.0:
            return float(grid[k - 1])
        if value[k - 1] * value[k] < 0:
            return float(grid[k - 1] + value[k - 1] / (value[k - 1] - value[k]) * (grid[k] - grid[k - 1]))
    return None


def clipped(spans: list[Interval], covered: Interval) -> tuple[Interval, ...]:
    return tuple(
        sorted((max(a, covered[0]), min(b, covered[1])) for a, b in spans if a <= covered[1] and b >= covered[0])
    )
