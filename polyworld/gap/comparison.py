"""Measured and simulated motion side by side, for pictures and tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import Design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import Noise
from polyworld.estimation.profile import Fit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Compared:
    """One object in one run: times (T,) [s]; observed and simulated positions (T, 3) [m], NaN where not measured;
    residual (T, 3): simulated less observed, in standard deviations of the noise. turning: the same of rotations and
    spins, by kind, as far as they were measured."""

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


def compared(forward: Forward, noise: Noise, fitted: Fit) -> tuple[Compared, ...]:
    """Compare every object of every run with what a fitted hypothesis makes of it."""
    plan: Design = forward.design
    settings = [Settings(r.index, fitted.values[None], fitted.states[r.index][None]) for r in plan.runs]
    found: list[Compared] = []
    for own, raw in zip(plan.runs, forward.residuals(settings), strict=True):
        scaled = raw[0] / noise.sigma[own.index]
        for column, name in enumerate(own.run.names):
            shape = (len(own.run.times), 3)
            simulated, residual = np.full(shape, np.nan), np.full(shape, np.nan)
            turning: dict[str, Array] = {}
            observed = own.run.positions[:, column]
            for s in own.series:
                if s.name != name:
                    continue
                if s.kind != "position":
                    turning.setdefault(s.kind, np.full(shape, np.nan))[s.rows, s.axis] = scaled[s.where]
                else:
                    simulated[s.rows, s.axis] = observed[s.rows, s.axis] + raw[0, s.where]
                    residual[s.rows, s.axis] = scaled[s.where]
            found.append(Compared(own.run.name, name, own.times, observed, simulated, residual, turning))
    return tuple(found)
