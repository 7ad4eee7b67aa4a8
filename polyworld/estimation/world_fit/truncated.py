"""Draws from Gaussians restricted to a box, whose precision may be singular: flat between the bounds where it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtri_exp

Array = NDArray[np.float64]

SWEEPS = 12
NARROWEST = 1e-12  # precision in units of the bounds' width: what is flatter counts as flat


class TruncatedGaussian:
    """The density exp(-(g'd + d'A d / 2)), d = x - centre (P,), of x within bounds (P,); A may be singular."""

    def __init__(self, centre: Array, gradient: Array, curvature: Array, lower: Array, upper: Array) -> None:
        self._lower, self._width = lower, upper - lower
        self._a, self._g = curvature * np.outer(self._width, self._width), gradient * self._width
        self._start = (np.clip(centre, lower, upper) - lower) / self._width
        self._origin = (centre - lower) / self._width
        # Along the eigenvectors of A a Gaussian that the bounds do not touch is drawn exactly and at once; the
        # coordinates suit the corners of the box.
        self.directions = np.concatenate([np.linalg.eigh(self._a)[1].T, np.eye(len(centre))])

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draw (count, P) by hit-and-run: every sweep moves all chains along all directions."""
        y = np.repeat(self._start[None], count, axis=0)
        for _ in range(SWEEPS):
            for d in self.directions:
                y = self._along(y, d, rng)
        drawn: Array = self._lower + y * self._width
        return drawn

    def moved(self, x: Array, steps: int, rng: np.random.Generator) -> Array:
        """Move draws (N, P) along some directions chosen at random: a reversible step that keeps the density."""
        y = (x - self._lower) / self._width
        for number in rng.integers(len(self.directions), size=steps):
            y = self._along(y, self.directions[number], rng)
        drawn: Array = self._lower + y * self._width
        return drawn

    def _along(self, y: Array, d: Array, rng: np.random.Generator) -> Array:
        """Replace points (N, P) of the unit box by draws from the lines through them along d."""
        along = self._a @ d
        precision = max(float(d @ along), NARROWEST)
        mean = -(self._g @ d + (y - self._origin) @ along) / precision
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([-y / d, (1.0 - y) / d])
        ends = np.where(np.isnan(ends), np.inf, ends)
        least = np.where(d == 0.0, -np.inf, ends.min(axis=0)).max(axis=1)
        most = np.where(d == 0.0, np.inf, ends.max(axis=0)).min(axis=1)
        step = _truncated_normal(mean, 1.0 / np.sqrt(precision), np.minimum(least, 0.0), np.maximum(most, 0.0), rng)
        moved: Array = np.clip(y + step[:, None] * d, 0.0, 1.0)
        return moved


def _truncated_normal(mean: Array, sd: float, lower: Array, upper: Array, rng: np.random.Generator) -> Array:
    """Draw from normal distributions (n,) restricted to [lower, upper] (n,), by inversion in the lighter tail."""
    a, b = (lower - mean) / sd, (upper - mean) / sd
    flip = a > 0.0  # the distribution function is exact in the lower tail alone
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    low, high, u = log_ndtr(a), log_ndtr(b), rng.uniform(size=len(mean))
    z = np.clip(ndtri_exp(high + np.log(u + (1.0 - u) * np.exp(low - high))), a, b)
    drawn: Array = np.clip(mean + sd * np.where(flip, -z, z), lower, upper)
    return drawn
