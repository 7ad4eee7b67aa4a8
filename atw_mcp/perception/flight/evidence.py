"""Misfit of each stretch of a body's sightings by free flight, and by motion on a surface.

Either motion is linear in what is unknown of it: a flight X = p + v t + g t^2 / 2 in its start and velocity, motion on
a plane in place, velocity and a constant acceleration. Each sighting gives three linear equations, two across the line
of sight and one along it. So the unknowns of stretches follow from normal equations (Bayes' linear model with normal
priors), reweighted by Student's noise, and their misfits from these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.flight.settings import FlightSettings
from atw_mcp.perception.flight.sightings import Sightings

Floats = NDArray[np.float64]
SCALE = 6  # index of the unknown relative error of distances, after the six of the motion


@dataclass(frozen=True)
class Motion:
    """A motion whose place is linear in six unknowns: X(t) = known(t) + basis(t) theta.

    name: of the surface, or "flight". prior: standard deviations (6,) of the unknowns, were time counted from the
    middle of a stretch; mean (6,).
    """

    name: str
    origin: Floats
    axes: Floats
    drift: Floats
    mean: Floats
    prior: Floats
    curved: bool

    def basis(self, times: Floats) -> Floats:
        """Return the derivatives (K, 3, 6) of places by the unknowns."""
        powers = [np.ones_like(times), times] + ([0.5 * times**2] if self.curved else [])
        return np.concatenate([p[:, None, None] * self.axes.T for p in powers], axis=2)

    def known(self, times: Floats) -> Floats:
        """Return the places (K, 3) where all unknowns are zero."""
        return self.origin + 0.5 * times[:, None] ** 2 * self.drift

    def velocity_basis(self, times: Floats) -> Floats:
        """Return the derivatives (K, 3, 6) of velocities by the unknowns."""
        rates = [np.zeros_like(times), np.ones_like(times)] + ([times] if self.curved else [])
        return np.concatenate([rate[:, None, None] * self.axes.T for rate in rates], axis=2)

    def velocities(self, times: Floats, unknowns: Floats) -> Floats:
        """Return the velocities (K, 3) at times (K,), where the unknowns are (K, 6)."""
        moved = np.einsum("kij,kj->ki", self.velocity_basis(times), unknowns)
        return np.asarray(times[:, None] * self.drift + moved)

    def places(self, times: Floats, unknowns: Floats) -> Floats:
        """Return the places (K, 3) at times (K,), where the unknowns are (K, 6)."""
        return np.asarray(self.known(times) + np.einsum("kij,kj->ki", self.basis(times), unknowns))

    def expected(self, middles: Floats) -> tuple[Floats, Floats]:
        """Return rows (K, 6, 6) and values (K, 6): rows @ unknowns - values is standard normal a priori.

        middles (K,): of the stretches, from which the time of what is expected is counted.
        """
        size, pull = len(self.axes), self.axes @ self.drift
        rows, shift = np.tile(np.eye(6), (len(middles), 1, 1)), np.zeros((len(middles), 6))
        for k in range(size):
            rows[:, k, size + k] = middles
            shift[:, k], shift[:, size + k] = 0.5 * middles**2 * pull[k], middles * pull[k]
            if self.curved:
                rows[:, k, 2 * size + k], rows[:, size + k, 2 * size + k] = 0.5 * middles**2, middles
        return rows / self.prior[:, None], (self.mean - shift) / self.prior


def flight(gravity: Floats, centre: Floats, length: float, speed: float) -> Motion:
    """Free flight under gravity (3,) [m/s^2], somewhere within `length` [m] of a centre, at a speed [m/s] of about."""
    prior = np.repeat([length, speed], 3)
    return Motion("flight", centre, np.eye(3), gravity, np.zeros(6), prior, curved=False)


def sliding(
    name: str, point: Floats, axes: Floats, gravity: Floats, friction: float, length: float, speed: float
) -> Motion:
    """Motion in the plane through a point along axes (2, 3): gravity's pull along it and about `friction` of g."""
    pull = axes @ gravity
    prior = np.repeat([length, speed, friction * float(np.linalg.norm(gravity))], 2)
    mean = np.concatenate([np.zeros(4), pull])
    return Motion(name, point, axes, np.zeros(3), mean, prior, curved=True)


@dataclass(frozen=True)
class Normal:
    """Normal equations of a motion in every frame, weighted: matrix (K, 7, 7), right side (K, 7), squares (K,)."""

    matrix: Floats
    right: Floats
    square: Floats


def normal_equations(motion: Motion, seen: Sightings, centre: Floats) -> Normal:
    """Return the equations of each frame for a motion seen from a camera's centre; the scale error is unknown too."""
    across = _across(seen.directions)
    basis, rest = motion.basis(seen.times), centre - motion.known(seen.times)
    rows = np.zeros((len(seen.rows), 3, 7))
    right = np.zeros((len(seen.rows), 3))
    rows[:, :2, :6] = np.einsum("kai,kij->kaj", across, basis) / seen.across[:, None, None]
    right[:, :2] = np.einsum("kai,ki->ka", across, rest) / seen.across[:, None]
    rows[:, 2, :6] = np.einsum("ki,kij->kj", seen.directions, basis) / seen.along[:, None]
    rows[:, 2, SCALE] = -seen.distances / seen.along
    right[:, 2] = (seen.distances + np.einsum("ki,ki->k", seen.directions, rest)) / seen.along
    return Normal(
        np.einsum("kai,kaj->kij", rows, rows),
        np.einsum("kai,ka->ki", rows, right),
        np.einsum("ka,ka->k", right, right),
    )


def energy_gains(motion: Motion, ends: Floats, unknowns: Floats, gravity: Floats, settings: FlightSettings) -> Floats:
    """Return the prices (S,) of being faster at the end of a stretch than gravity explains: friction only slows down.

    ends (S, 2) [s]: its first and last time; unknowns (S, 6). Energy is compared with the least that the stretch has.
    """
    first, last = ends.T

    def energies(times: Floats) -> Floats:
        """Kinetic and potential energy (S,) of the unit of mass [m^2/s^2]."""
        speeds = motion.velocities(times, unknowns)
        return np.asarray(0.5 * np.sum(speeds**2, axis=1) - motion.places(times, unknowns) @ gravity)

    start, middle, end = (energies(times) for times in (first, 0.5 * (first + last), last))
    # A parabola in the share s of the time from first to last, as places are quadratic in time.
    bend, slope = 2.0 * (start - 2.0 * middle + end), 4.0 * middle - 3.0 * start - end
    turning = np.divide(-slope, 2.0 * bend, out=np.zeros_like(bend), where=bend > 0.0)
    lowest = np.minimum(start, energies(first + np.clip(turning, 0.0, 1.0) * (last - first)))
    speed = np.linalg.norm(motion.velocities(last, unknowns), axis=1)
    excess = speed - np.sqrt(np.maximum(speed**2 - 2.0 * np.maximum(end - lowest, 0.0), 0.0))
    return np.asarray(0.5 * (excess / settings.gain) ** 2)


def weights_of(squares: Floats, settings: FlightSettings) -> Floats:
    """Return the weights of frames whose equations have these squared errors, under Student's noise."""
    return np.asarray((settings.tails + 3.0) / (settings.tails + squares) / settings.alike)


def misfits(squares: Floats, settings: FlightSettings) -> Floats:
    """Return minus twice the log density of frames' three equations with these squared errors, under Student's noise.

    Up to a constant.
    """
    return np.asarray((settings.tails + 3.0) / settings.alike * np.log1p(squares / settings.tails))


def squares_of(normal: Normal, unknowns: Floats) -> Floats:
    """Return the squared errors (K,) of each frame's equations, in units of their noise, at unknowns (7,)."""
    squares = np.einsum("kij,i,j->k", normal.matrix, unknowns, unknowns) + normal.square - 2.0 * normal.right @ unknowns
    found: Floats = np.maximum(squares, 0.0)
    return found


def _across(directions: Floats) -> Floats:
    """Return two unit vectors (K, 2, 3) across each direction."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    one = np.cross(directions, least)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return np.stack([one, np.cross(directions, one)], axis=1)
