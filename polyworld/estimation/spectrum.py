"""Level and correlation of noise from the spectrum of whitened residuals.

Whittle's likelihood (1953) over cosine modes: noise whitened with a correlation that is not quite its own keeps a
spectrum of a known shape, from which the correlation is put right. A mode counts for at most CAP times its expected
power, so that model error, which fills the lowest modes, pulls little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

Array = NDArray[np.float64]

CAP = 9.0
TRUNCATED = 0.981  # mean of min(x, CAP) for x of the chi-squared distribution with one degree of freedom
GRID = np.concatenate([np.linspace(0.0, 0.88, 23), 1.0 - np.geomspace(0.1, 0.01, 16)])


@dataclass(frozen=True)
class Modes:
    """Cosine modes of a whitened series: power (m,), the share (m,) of it that the fit left, the correlation used for
    whitening from sample to sample, and seconds between samples over those of the first series."""

    power: Array
    left: Array
    used: float
    seconds: float


@dataclass(frozen=True)
class Correction:
    """Correction by a spectrum: correlation from sample to sample of the first series, its standard error, and scale:
    the variance of the innovations over that supposed."""

    correlation: float
    error: float
    scale: float


def modes(whitened: Array, used: float, seconds: float = 1.0, left: Array | None = None) -> Modes:
    """Return the modes of a whitened series (m,)."""
    power = dct(whitened, norm="ortho") ** 2
    return Modes(power, np.ones(len(power)) if left is None else left, used, seconds)


def gain(frequency: Array, used: float | Array, true: float | Array) -> Array:
    """Power of AR(1) noise of correlation `true`, whitened with `used`, at angular frequencies per sample."""
    cosine = np.cos(frequency)
    result: Array = (1.0 - 2.0 * used * cosine + used**2) / (1.0 - 2.0 * true * cosine + true**2)
    return result


def fitted(series: Sequence[Modes], prior: float, prior_error: float, low: int, furthest: float = np.inf) -> Correction:
    """Return the correlation that the modes from `low` on suggest together with a prior (normal, in the correlation).

    furthest: how far from the prior it may be at most. What a wrong model leaves can be so loud that no prior outweighs
    it.
    """
    cost = ((GRID - prior) / max(prior_error, 1e-3)) ** 2
    cost[np.abs(GRID - prior) > max(furthest, np.abs(GRID - prior).min())] = np.inf
    scales = np.ones(len(GRID))
    if not series:
        return Correction(prior, prior_error, 1.0)
    parts = []
    for s in series:
        k = np.arange(len(s.power))
        use = (k >= low) & (s.left > 0.5)
        if not use.any():
            continue
        true = (GRID**s.seconds)[:, None]
        w = np.pi * k[use] / len(k)
        shape = gain(w, s.used, true) * s.left[use]
        slope = 2.0 * (np.cos(w) - true) / (1.0 - 2.0 * true * np.cos(w) + true**2) * s.seconds
        parts.append((s.power[use], shape, slope))
    if not parts:
        return Correction(prior, prior_error, 1.0)
    power = np.concatenate([p[0] for p in parts])
    shape = np.concatenate([p[1] for p in parts], axis=1)
    slope = np.concatenate([p[2] for p in parts], axis=1)
    ratio = power / shape
    for _ in range(4):  # the scale, with the cap
        scales = np.minimum(ratio / scales[:, None], CAP).mean(axis=1) * scales / TRUNCATED
    cost += np.log(shape * scales[:, None]).sum(axis=1) + (np.minimum(ratio / scales[:, None], CAP) / TRUNCATED).sum(
        axis=1
    )
    information = 0.5 * ((slope - slope.mean(axis=1, keepdims=True)) ** 2).sum(axis=1) + 1.0 / prior_error**2
    best, value = _minimum(cost)
    at = int(np.argmin(np.abs(GRID - value)))
    return Correction(value, float(1.0 / np.sqrt(information[at])), float(scales[best]))


def _minimum(cost: Array) -> tuple[int, float]:
    """Index of the least cost on the grid, and its place by the parabola through it and its neighbours."""
    best = int(np.argmin(cost))
    if best in (0, len(cost) - 1) or not np.all(np.isfinite(cost[best - 1 : best + 2])):
        return best, float(GRID[best])
    x, y = GRID[best - 1 : best + 2], cost[best - 1 : best + 2]
    a, b, _ = np.polyfit(x - x[1], y, 2)
    place = float(x[1] - b / (2.0 * a)) if a > 0.0 else float(x[1])
    return best, float(np.clip(place, x[0], x[2]))
