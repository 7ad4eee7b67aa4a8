"""How noisy the measurements are: level, correlation in time, outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.discrepancy.design import Design
from polyworld.initial_states import track_noise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Standard deviation of every measured component of every run: sigma[r] (m_r,)."""

    sigma: tuple[Array, ...]

    def whiten(self, run: int, values: Array) -> Array:
        """Residuals or derivatives (..., m) in units in which the noise is white with unit variance."""
        scaled: Array = values / self.sigma[run]
        return scaled


def measured_noise(design: Design) -> Noise:
    """The noise as the data themselves tell it, before any model: from third differences of every series."""
    sigma = []
    for own in design.runs:
        level = np.empty(own.length)
        for s in own.series:
            column = own.run.names.index(s.name)
            if s.kind == "position":
                if own.run.sigma is not None:
                    level[s.where] = own.run.sigma
                    continue
                values = own.run.positions[s.rows, column, s.axis]
            else:
                values = np.zeros(0)
            level[s.where] = max(float(track_noise(values[:, None])[0]) if len(values) else 0.01, 1e-6)
        sigma.append(level)
    return Noise(tuple(sigma))
