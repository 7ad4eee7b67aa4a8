"""Periods of the coordinates of a motion, measured or simulated, as an agent reads them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.probing.motion_quantities import period

Array = NDArray[np.float64]

HALF = 1.645  # standard errors of a 90% interval
LEFT_OVER = 0.01  # of the widest coordinate's range: what moves less is not said to go to and fro


def periods(times: Array, places: Array, sigma: float | None = None) -> dict[str, dict[str, Any]]:
    """Period [s] of each coordinate of places (T, 3) that goes round, with a 90% interval where sigma is given."""
    found: dict[str, dict[str, Any]] = {}
    widest = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
    for axis, letter in enumerate("xyz"):
        if np.ptp(places[:, axis]) < LEFT_OVER * widest:
            continue
        own = period(times, places[:, axis], sigma)
        if own is None:
            continue
        found[letter] = {"seconds": own.period, "cycles": own.cycles}
        if own.standard_error is not None:
            reach = HALF * own.standard_error
            found[letter] |= {"from": own.period - reach, "to": own.period + reach}
    return found


def period_in_words(derived: dict[str, Any]) -> str:
    """The periods found, as a clause; empty where none was asked for."""
    if "period" not in derived:
        return ""
    texts = [
        f"{axis} {row['seconds']:.4g} s" + (f" ({row['from']:.4g} to {row['to']:.4g})" if "from" in row else "")
        for axis, row in derived["period"].items()
    ]
    return f": period of {', '.join(texts)}" if texts else ": nothing goes to and fro often enough for a period"
