"""Noise before any model: third differences of a series, at several strides, blind to smooth motion.

The third divided difference of a cubic is zero, so that of a smooth motion is near zero and noise is left. For noise
with autocorrelation rho(s) at s samples, weights 1, 3, 3, 1 give the variance sigma^2 (20 - 30 rho(s) + 12 rho(2s) -
2 rho(3s)). Bounces disturb the few differences that span them, which are clipped.

Of an oscillation with few samples a period, third differences are not small. Noise has the same variance in differences
of every order (scaled alike), a smooth motion less and less: where the next order falls clearly, it takes the place of
the one before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STRIDES = (1, 2, 3, 4, 6, 8)
SQUARES = 20.0  # of the weights 1, -3, 3, -1
CLIP = 3.0  # standard deviations beyond which a difference is not noise
HIGHEST = 9  # order of differences up to which a motion is followed
FALLING = 0.3  # ratio of variances, order to order, below which it is motion that falls: noise keeps 0.9 to 1
KEPT = 0.97334  # variance of a normal variable given that it is within CLIP
CLIPPED = 0.25  # share of clipped differences from which on a stride shows nothing
FEWEST = 8  # differences that a scale needs
UNSURE = {2: 0.4, 3: 0.2}  # least standard errors of correlations from so few strides
CORRELATIONS = np.concatenate([np.linspace(0.0, 0.9, 31), 1.0 - np.geomspace(0.09, 0.015, 12)])


@dataclass(frozen=True)
class Spread:
    """Variances (K,) of the differences of one series by stride, NaN where undetermined; count: of samples;
    interval: median [s] between samples; order: of the differences, the third unless these hold motion."""

    variances: Array
    count: int
    interval: float
    order: int = 3


def spread(times: Array, values: Array) -> Spread:
    """Return how third differences of a series (m,) at times (m,) scatter."""
    m = len(times)
    interval = float(np.median(np.diff(times))) if m > 1 else 1.0
    variances = np.full(len(STRIDES), np.nan)
    for k, s in enumerate(STRIDES):
        if m - 3 * s < FEWEST or 3 * s > max(m // 6, 3):
            break
        found = _differences(times, values, 3, s, interval)
        if len(found) >= FEWEST:
            variance, clipped = _clipped_variance(found)
            if k == 0 or clipped < CLIPPED:
                variances[k] = variance
    calm, order = _of_higher_order(times, values, float(variances[0]), interval)
    if order > 3:
        variances[:] = np.nan  # longer strides see even more of the motion
        variances[0] = calm
    return Spread(variances, m, interval, order)


def _of_higher_order(times: Array, values: Array, third: float, interval: float) -> tuple[float, int]:
    """Variance of differences of the order at which it no longer falls, and that order."""
    variance = third
    order = 3
    while order < HIGHEST and np.isfinite(variance):
        found = _differences(times, values, order + 1, 1, interval)
        if len(found) < FEWEST:
            break
        higher = _clipped_variance(found)[0]
        if not 0.0 < higher < FALLING * variance:
            break
        variance, order = higher, order + 1
    return variance, order


def _differences(times: Array, values: Array, order: int, stride: int, interval: float) -> Array:
    """Divided differences of an order, scaled as the third ones are, of every `stride`-th sample; none across gaps."""
    last = len(times) - order * stride
    t = np.stack([times[j * stride : last + j * stride] for j in range(order + 1)])
    y = np.stack([values[j * stride : last + j * stride] for j in range(order + 1)])
    whole = t[-1] - t[0] < 1.5 * order * stride * interval
    found: Array = (_divided(t) * y).sum(axis=0)[whole]
    return found


def least(first: Spread, second: Spread) -> Spread:
    """Return the smaller variance of two series with the same noise, each disturbed by a motion of its own."""
    return Spread(np.fmin(first.variances, second.variances), first.count, first.interval, second.order)


def expected(correlation: Array, strides: Array) -> Array:
    """Variance of differences of AR(1) noise of unit variance, for its correlation from sample to sample."""
    rho = correlation**strides
    result: Array = SQUARES - 30.0 * rho + 12.0 * rho**2 - 2.0 * rho**3
    return result


def correlation(spreads: list[Spread]) -> tuple[float, float]:
    """Correlation over the interval of the first series, and its standard error, where all share a correlation time.

    Each series has a level of its own, and a third derivative of its own, left by its motion: an addition that grows
    with the sixth power of the stride. The standard error follows simulated AR(1) noise.
    """
    useful = [s for s in spreads if np.count_nonzero(np.isfinite(s.variances)) >= 2 and np.nanmin(s.variances) > 0.0]
    count = sum(s.count for s in useful)
    if not useful or count < 20:
        return 0.0, 0.5
    interval = useful[0].interval
    cost = np.zeros(len(CORRELATIONS))
    for s in useful:
        seen = np.isfinite(s.variances)
        strides = np.array(STRIDES, dtype=float)[seen]
        seconds = s.interval / interval
        noise = expected(CORRELATIONS[:, None] ** seconds, strides)
        cost += _misfit(s.variances[seen], noise, strides, s.count)
    best = int(np.argmin(cost))
    phi = float(CORRELATIONS[best])
    usual = int(np.median([np.count_nonzero(np.isfinite(s.variances)) for s in useful]))
    return phi, min(max((1.0 + 4.0 * phi) / float(np.sqrt(count)), UNSURE.get(usual, 0.0)), 0.5)


def innovation(phi: float) -> float:
    """Variance of the innovations of AR(1) noise, for one of its shortest differences."""
    return (1.0 - phi**2) / float(expected(np.array(phi), np.array(1.0)))


def level(spread_: Spread, phi: float) -> float:
    """Return the standard deviation of the noise from its shortest differences; NaN where there are none."""
    if not np.isfinite(spread_.variances[0]):
        return float("nan")
    return float(np.sqrt(spread_.variances[0] / expected(np.array(phi), np.array(1.0))))


def _misfit(variances: Array, noise: Array, strides: Array, count: int) -> Array:
    """Squared relative misfit (P,) of level * noise (P, K) + motion * stride^6 to the variances (K,), both factors at
    least 0."""
    weight = np.sqrt(count / (3.0 * strides))  # differences at a stride overlap
    a = noise / variances * weight
    b = strides**6 / variances * weight
    aa, ab, bb, ay, by = (a * a).sum(axis=1), a @ b, b @ b, a @ weight, b @ weight
    motion = np.maximum((by * aa - ay * ab) / np.maximum(aa * bb - ab**2, 1e-12 * aa * bb), 0.0)
    scale = np.maximum((ay - motion * ab) / aa, 0.0)
    misfit: Array = ((weight - scale[:, None] * a - motion[:, None] * b) ** 2).sum(axis=1)
    return misfit


def _divided(t: Array) -> Array:
    """Return weights (k, n) of divided differences at times (k, n), of the size of 1, -3, 3, -1."""
    gaps = t[:, None] - t[None]
    gaps[np.arange(len(t)), np.arange(len(t))] = 1.0
    weights: Array = 1.0 / gaps.prod(axis=1)
    weights *= np.sqrt(SQUARES / (weights**2).sum(axis=0))
    return weights


def _clipped_variance(differences: Array) -> tuple[float, float]:
    """Variance without what is far out, and the share that was."""
    size = np.abs(differences)
    scale = float(np.median(size)) / 0.6745
    inside = size <= CLIP * scale
    for _ in range(6):
        if scale <= 0.0 or not inside.any():
            break
        new = float(np.sqrt((size[inside] ** 2).mean() / KEPT))
        inside_now = size <= CLIP * new
        if np.array_equal(inside_now, inside):
            scale = new
            break
        scale, inside = new, inside_now
    return scale**2, 1.0 - float(inside.mean())
