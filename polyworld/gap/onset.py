"""When a run begins to differ from the fit: recursive residuals, that no later sample has touched.

A fit of the initial state spreads what is wrong late in a run over all of it. Recursive residuals (Brown, Durbin and
Evans 1975, J. R. Stat. Soc. B 37, 149) are the errors of forecasting each instant from those before it alone: white,
with unit variance, for as long as the model holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import RunDesign
from polyworld.estimation.profile import Fit
from polyworld.gap.settings import LocaliseSettings

Array = NDArray[np.float64]

PRIOR = 1e3  # ordinary changes of an initial state: next to nothing is known of it before the first sample


@dataclass(frozen=True)
class Onset:
    """From when on [s, since the run's start] an object's motion differs, in which run, and by how many standard
    deviations the first window that shows it is off."""

    run: str
    name: str
    time: float
    strength: float

    def to_json(self) -> dict[str, object]:
        """Return the onset as plain data."""
        return {"run": self.run, "object": self.name, "time": self.time, "strength": self.strength}


def onsets(run: RunDesign, fit: Fit, kept: NDArray[np.bool_], settings: LocaliseSettings | None = None) -> list[Onset]:
    """Find the onset of every object of a run that shows one; shared unknowns stay as fitted."""
    settings = settings or LocaliseSettings()
    forecast = recursive_residuals(run, fit.linear.r[run.index], fit.linear.b[run.index])
    found: dict[str, Onset] = {}
    for s in run.series:
        own = kept[s.where]
        times, w = run.times[s.rows[own]], forecast[s.where][own]
        first = _first_alarm(times, w, settings)
        if first is None:
            continue
        known = found.get(s.name)
        if known is None or first[0] < known.time:
            found[s.name] = Onset(run.run.name, s.name, *first)
    return list(found.values())


def recursive_residuals(run: RunDesign, residual: Array, slopes: Array) -> Array:
    """Forecast errors (m,) of whitened residuals (m,), each instant from all before it; slopes (m, N) by the state."""
    result = residual.copy()
    n = slopes.shape[1]
    if not n:
        return result
    row = np.empty(run.length, dtype=np.int64)
    for s in run.series:
        row[s.where] = s.rows
    order = np.argsort(row, kind="stable")
    cuts = np.flatnonzero(np.diff(row[order])) + 1
    covariance = np.diag((PRIOR * run.typical) ** 2)
    state = np.zeros(n)
    for entries in np.split(order, cuts):
        h = slopes[entries]
        gain = covariance @ h.T
        spread = h @ gain + np.eye(len(entries))
        lower = np.linalg.cholesky(spread)
        error = residual[entries] - h @ state
        result[entries] = np.linalg.solve(lower, error)
        k = np.linalg.solve(spread, gain.T).T
        state = state + k @ error
        shrink = np.eye(n) - k @ h
        covariance = shrink @ covariance @ shrink.T + k @ k.T  # Joseph's form stays positive
    return result


def _first_alarm(times: Array, errors: Array, settings: LocaliseSettings) -> tuple[float, float] | None:
    """Return where the earliest window begins whose mean is too far off, and how far."""
    total = np.concatenate([[0.0], np.cumsum(errors)])
    found: list[tuple[int, int, float]] = []  # end, begin, standard deviations
    for share in settings.windows:
        length = max(round(share * len(errors)), 3)
        mean = np.abs(total[length:] - total[:-length]) / np.sqrt(length)
        over = np.flatnonzero(mean > settings.alarm)
        if len(over):
            found.append((int(over[0]) + length, int(over[0]), float(mean[over[0]])))
    if not found:
        return None
    _, begin, strength = min(found, key=lambda f: f[0])
    return float(times[begin]), strength
