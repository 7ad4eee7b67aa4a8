"""Correlation of noise in short series: restricted likelihood of AR(1) about local cubics, over all series jointly.

Short series leave third differences of one stride only, which say how loud noise is for a correlation, not which it
has. About a cubic over a dozen samples, noise of all runs together does. The restricted likelihood (Patterson &
Thompson 1971, Biometrika 58, 545) is that of what the cubics cannot take up, so that it is unbiased however few samples
a series has. Pieces that hold a bounce are left out.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREE = 3
PIECE = 12  # samples of a piece at least: eight degrees of freedom beside the cubic
ALIKE = 6.0  # times the lower quartile of the pieces' mean squares beyond which one holds more than noise: 1 in 2000
FEWEST = 30  # degrees of freedom without which nothing is concluded
GRID = np.linspace(0.0, 0.9, 46)


@dataclass(frozen=True)
class Piece:
    """Some samples of a series: level: what shares one standard deviation; steps (m,): times over the interval at
    which the correlation is wanted; values (m,)."""

    level: Hashable
    steps: Array
    values: Array


def pieces(level: Hashable, steps: Array, values: Array) -> list[Piece]:
    """Cut a series into equal pieces, of `PIECE` samples or a few more; none of a shorter one."""
    count = len(steps) // PIECE
    if not count:
        return []
    cuts = zip(np.array_split(steps, count), np.array_split(values, count), strict=True)
    return [Piece(level, s, v) for s, v in cuts]


def correlation(series: Sequence[Piece]) -> tuple[float, float] | None:
    """Return the correlation over one step and its standard error, or None where the series are too short for it."""
    shapes: dict[bytes, tuple[Array, Array, Array]] = {}
    energy, loose, volume = [], [], []
    for piece in series:
        steps = piece.steps - piece.steps[0]
        key = np.round(steps, 3).tobytes()
        if key not in shapes:
            shapes[key] = _shape(steps)
        root, log_volume, rest = shapes[key]
        energy.append(((root @ (rest.T @ piece.values)) ** 2).sum(axis=1))
        volume.append(log_volume)
        loose.append(rest.shape[1])
    if not series:
        return None
    freedom, power = np.array(loose, dtype=float), np.array(energy)
    cost = -2.0 * np.log1p(-(GRID**2))  # prior 1 - phi^2: noise has no unit root
    total = 0.0
    for level in dict.fromkeys(p.level for p in series):
        own = np.array([p.level == level for p in series])
        mean = power[own] / freedom[own, None]
        calm = mean <= ALIKE * np.maximum(np.quantile(mean, 0.25, axis=0), 1e-300)
        use = np.flatnonzero(own)[calm.all(axis=1)]
        count = float(freedom[use].sum())
        whole = power[use].sum(axis=0)
        if count and np.all(whole > 0.0):
            cost += count * np.log(whole) + np.array(volume)[use].sum(axis=0)
            total += count
    if total < FEWEST:
        return None
    best = int(np.clip(np.argmin(cost), 1, len(GRID) - 2))
    a, b, _ = np.polyfit(GRID[best - 1 : best + 2] - GRID[best], cost[best - 1 : best + 2], 2)
    place = GRID[best] - b / (2.0 * a) if a > 0.0 else GRID[int(np.argmin(cost))]
    error = 1.0 / np.sqrt(a) if a > 0.0 else 0.5
    return float(np.clip(place, 0.0, GRID[-1])), float(error)


def _shape(steps: Array) -> tuple[Array, Array, Array]:
    """Return whitening (P, q, q), log determinants (P,) of AR(1) noise, in the basis (m, q) of what cubics leave."""
    x = 2.0 * steps / steps[-1] - 1.0
    rest = np.linalg.qr(np.vander(x, DEGREE + 1), mode="complete")[0][:, DEGREE + 1 :]
    gaps = np.abs(steps[:, None] - steps)
    covariance = np.where(gaps > 0.0, GRID[:, None, None] ** gaps, 1.0)
    lower = np.linalg.cholesky(rest.T @ covariance @ rest)
    return np.linalg.inv(lower), 2.0 * np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1), rest
