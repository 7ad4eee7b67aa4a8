"""Measured and simulated motion side by side, for pictures and tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.readout import CHANNELS
from polyworld.gap.fitting import Fitted

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Compared:
    """One object in one run: times (T,) [s] from the run's start; observed and simulated positions (T, 3) [m], NaN
    where not measured; residual (T, 3): simulated less observed, in standard deviations of the noise. turning: the same
    of rotations and spins, by kind, as far as they were measured."""

    run: str
    name: str
    times: Array
    observed: Array
    simulated: Array
    residual: Array
    turning: Mapping[str, Array] = field(default_factory=dict)

    @property
    def size(self) -> Array:
        """Root mean square over the measured components (T,), NaN where none was measured."""
        count = np.isfinite(self.residual).sum(axis=1)
        total = np.nansum(self.residual**2, axis=1)
        size: Array = np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan))
        return size


def compared(fitted: Fitted) -> tuple[Compared, ...]:
    """Compare every object of every run with what a fitted hypothesis makes of it."""
    found: list[Compared] = []
    for run, readout, one in zip(fitted.ground.recording.runs, fitted.ground.readouts, fitted.slopes, strict=True):
        grid = readout.grid(one.residuals)
        for column, name in enumerate(run.names):
            first = CHANNELS * column
            residual, turn, spin = (grid[:, first + 3 * k : first + 3 * k + 3] for k in range(3))
            observed = run.positions[:, column]
            simulated = observed + residual * readout.sigma[first : first + 3]
            turning = {k: v for k, v in (("rotation", turn), ("spin", spin)) if np.isfinite(v).any()}
            times = run.times - run.times[0] + run.lead
            found.append(Compared(run.name, name, times, observed, simulated, residual, turning))
    return tuple(found)
