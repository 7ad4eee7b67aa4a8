"""Single measurements that are far from all their neighbours.

What a model gets wrong leaves residuals with steps and kinks: the bounce that comes a sample too late. Around those the
neighbours do not lie on one line, and nothing there is called an outlier; elsewhere they do, and an outlier is off it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

HALF = 5  # neighbours in each of two groups, whose medians give the line
FAR = 5.0  # standard deviations from the line beyond which a sample is out
STRAIGHT = 2.0  # standard deviations within which the neighbours scatter about the line, or it is none
MEDIAN = 0.287  # variance of the median of five samples, in units of theirs
MOST = 0.15  # share of a series from which on its outliers are no exceptions, and stay


def outliers(times: Array, values: Array, floor: float) -> Bools:
    """Return which samples of a series (m,) at times (m,) are out. floor: least standard deviation that is believed.

    The line at a sample goes through the medians of the five neighbours before and the five after it (at the ends of
    the series: of the nearest ten, in two groups), so that two outliers among either five do not move it.
    """
    m = len(values)
    if m < 3 * HALF:
        return np.zeros(m, dtype=bool)
    first = np.clip(np.arange(m) - HALF, 0, m - 2 * HALF - 1)
    around = first[:, None] + np.arange(2 * HALF)
    around += around >= np.arange(m)[:, None]  # the sample itself is not its neighbour
    t, y = times[around] - times[:, None], values[around]
    t1, t2 = t[:, HALF // 2], t[:, HALF + HALF // 2]
    y1, y2 = np.median(y[:, :HALF], axis=1), np.median(y[:, HALF:], axis=1)
    slope = (y2 - y1) / (t2 - t1)
    centre = y1 - slope * t1
    part = -t1 / (t2 - t1)
    size = np.sqrt(1.0 + MEDIAN * (part**2 + (1.0 - part) ** 2))
    deviation = np.abs(values - centre) / size
    scatter = np.median(np.abs(y - centre[:, None] - slope[:, None] * t), axis=1) / 0.6745
    unit = max(float(np.median(deviation)) / 0.6745, floor)
    out: Bools = (deviation > FAR * unit) & (scatter < STRAIGHT * unit)
    return out if out.mean() <= MOST else np.zeros(m, dtype=bool)


def repeats(rows: Array, share: float = 0.1) -> Bools:
    """Return which rows (m, d) equal the row before in every component, where that is an exception.

    A noisy measurement does not return to the last bit: the row was shown again. Where more than a share of the rows
    do, the data are coarse or the object rests, and none is reported.
    """
    again = np.zeros(len(rows), dtype=bool)
    if len(rows) > 1:
        again[1:] = np.all(rows[1:] == rows[:-1], axis=1)
    return again if again.mean() <= share else np.zeros(len(rows), dtype=bool)
