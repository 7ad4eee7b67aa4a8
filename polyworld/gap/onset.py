"""When a run begins to differ from the fit: recursive residuals, that no later sample has touched.

A fit of the initial state spreads what is wrong late in a run over all of it. Recursive residuals (Brown, Durbin and
Evans 1975, J. R. Stat. Soc. B 37, 149) are the errors of forecasting each instant from those before it alone: white,
with unit variance, for as long as the model holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.readout import CHANNELS
from polyworld.gap.fitting import Fitted

Array = NDArray[np.float64]

PRIOR = 1e3  # ordinary changes of an initial state: next to nothing is known of it before the first sample
ALARM = 5.0  # standard deviations by which the mean of a window is off once in a million windows of noise
WINDOWS = (1 / 48, 1 / 24, 1 / 12, 1 / 6)  # their lengths, as shares of a series
SHORTEST = 3  # samples of a window


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


def onsets(fitted: Fitted) -> tuple[Onset, ...]:
    """Return the onset of every object that shows one in a run, earliest first; shared unknowns stay as fitted."""
    found: dict[tuple[str, str], Onset] = {}
    for r, (run, readout) in enumerate(zip(fitted.ground.recording.runs, fitted.ground.readouts, strict=True)):
        one, rows, columns = fitted.slopes[r], readout.rows(), readout.columns()
        errors = recursive_residuals(one.residuals, one.states, rows, fitted.problem.runs[r][0].states.typical)
        times = run.times - run.times[0] + run.lead
        for column in np.unique(columns).tolist():
            own = columns == column
            first = _first_alarm(times[rows[own]], errors[own])
            name = run.names[column // CHANNELS]
            known = found.get((run.name, name))
            if first is not None and (known is None or first[0] < known.time):
                found[run.name, name] = Onset(run.name, name, *first)
    return tuple(sorted(found.values(), key=lambda o: (o.time, o.run, o.name)))


def recursive_residuals(residuals: Array, slopes: Array, rows: NDArray[np.int64], typical: Array) -> Array:
    """Return forecast errors (m,) of residuals (m,) in units of noise, each instant from all before it.

    slopes (m, N): by the initial state, whose ordinary changes are typical (N,). rows (m,): the instant of each.
    """
    found = residuals.copy()
    n = slopes.shape[1]
    if not n:
        return found
    covariance, state = np.diag((PRIOR * typical) ** 2), np.zeros(n)
    for entries in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows)) + 1):
        h = slopes[entries]
        gain = covariance @ h.T
        spread = h @ gain + np.eye(len(entries))
        error = residuals[entries] - h @ state
        found[entries] = np.linalg.solve(np.linalg.cholesky(spread), error)
        k = np.linalg.solve(spread, gain.T).T
        state = state + k @ error
        shrink = np.eye(n) - k @ h
        covariance = shrink @ covariance @ shrink.T + k @ k.T  # Joseph's form stays positive
    return found


def _first_alarm(times: Array, errors: Array) -> tuple[float, float] | None:
    """Return where the earliest window begins whose mean is too far off, and how far."""
    total = np.concatenate([[0.0], np.cumsum(errors)])
    found: list[tuple[int, int, float]] = []  # end, begin, standard deviations
    for share in WINDOWS:
        length = max(round(share * len(errors)), SHORTEST)
        mean = np.abs(total[length:] - total[:-length]) / np.sqrt(length)
        over = np.flatnonzero(mean > ALARM)
        if len(over):
            found.append((int(over[0]) + length, int(over[0]), float(mean[over[0]])))
    if not found:
        return None
    _, begin, strength = min(found, key=lambda f: f[0])
    return float(times[begin]), strength
