"""Velocity, acceleration, momentum and energy of measured tracks, with standard errors, by local least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks

Array = NDArray[np.float64]

LEAST, MOST = 5, 21  # samples in a window
SLACK = 2.0  # standard deviations of chi-square by which a window may fit worse than the noise allows


@dataclass(frozen=True)
class LocalMotion:
    """Motion of one track at its n observed samples.

    rows (n,): of the track. derivatives (n, 3, 3): position [m], velocity [m/s] and acceleration [m/s^2] (axis 1) along
    x, y, z (axis 2). covariances (n, 3, 3): of the three, in one axis, per variance of that axis' noise; scale (n, 3):
    the standard deviation of the noise along each axis.
    """

    rows: NDArray[np.intp]
    derivatives: Array
    covariances: Array
    scale: Array

    def standard_errors(self, order: int) -> Array:
        """Standard errors (n, 3) of position (0), velocity (1) or acceleration (2)."""
        errors: Array = np.sqrt(self.covariances[:, order, order])[:, None] * self.scale
        return errors

    def kinetic_energy(self, mass: float) -> tuple[Array, Array]:
        """Kinetic energy of the centre's motion and its standard error (n,) [J]."""
        velocity = self.derivatives[:, 1]
        error = np.sqrt(((mass * velocity * self.standard_errors(1)) ** 2).sum(axis=1))
        return 0.5 * mass * (velocity**2).sum(axis=1), error

    def potential_energy(self, mass: float, gravity: Array) -> tuple[Array, Array]:
        """Energy in a uniform field, 0 at the origin, and its standard error (n,) [J]."""
        error = np.sqrt(((mass * gravity * self.standard_errors(0)) ** 2).sum(axis=1))
        return -mass * self.derivatives[:, 0] @ gravity, error

    def energy(self, mass: float, gravity: Array) -> tuple[Array, Array]:
        """Sum of both and its standard error (n,) [J]."""
        velocity = self.derivatives[:, 1]
        slopes = np.stack([np.broadcast_to(-mass * gravity, velocity.shape), mass * velocity], axis=1)  # (n, 2, 3)
        variance = np.einsum("nia,nij,nja,na->n", slopes, self.covariances[:, :2, :2], slopes, self.scale**2)
        value = self.kinetic_energy(mass)[0] + self.potential_energy(mass, gravity)[0]
        return value, np.sqrt(variance)


def local_motion(tracks: ObservedTracks, name: str) -> LocalMotion:
    """Fit a parabola to every sample's surroundings in the widest window that follows the samples within their noise.

    An impact ends a window: over it the parabola does not fit. Raises ValueError for fewer than `LEAST` samples.
    """
    column = tracks.index(name)
    seen = np.flatnonzero((tracks.confidence[:, column] > 0) & np.isfinite(tracks.positions[:, column]).all(axis=1))
    if len(seen) < LEAST:
        raise ValueError(f"{name!r} has {len(seen)} measured positions; motion needs at least {LEAST}")
    times, places = tracks.times[seen], tracks.positions[seen, column]
    sigma = tracks.coordinate_sigma[seen, column]
    found = [_at(times, places, sigma, k) for k in range(len(seen))]
    return LocalMotion(
        rows=seen,
        derivatives=np.array([value for value, _, _ in found]),
        covariances=np.array([covariance for _, covariance, _ in found]),
        scale=np.array([scale for _, _, scale in found]),
    )


def _at(times: Array, places: Array, sigma: Array, k: int) -> tuple[Array, Array, Array]:
    """Derivatives (3, 3), covariance (3, 3) and noise scale (3,) at sample k."""
    best: tuple[Array, Array, Array] | None = None
    for width in range(LEAST, MOST + 1, 2):
        first = min(max(k - width // 2, 0), max(len(times) - width, 0))
        rows = slice(first, first + width)
        t = times[rows] - times[k]
        design = np.stack([np.ones_like(t), t, 0.5 * t**2], axis=1) / sigma[rows, None]
        covariance = np.asarray(np.linalg.inv(design.T @ design), dtype=np.float64)
        value = covariance @ design.T @ (places[rows] / sigma[rows, None])
        freedom = max(len(t) - 3, 1)
        reduced = ((design @ value - places[rows] / sigma[rows, None]) ** 2).sum(axis=0) / freedom  # (3,)
        if best is not None and reduced.max() > 1.0 + SLACK * np.sqrt(2.0 / freedom):
            break
        best = value, covariance, np.sqrt(np.maximum(reduced, 1.0))
        if len(t) < width:
            break
    assert best is not None
    return best
