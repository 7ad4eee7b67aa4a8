"""Momentum, energy, acceleration and period of an object's simulated motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.trajectory import Trajectory
from polyworld.world import World, geometry
from polyworld.world.parameters import object_mass

Array = NDArray[np.float64]

BAND = 0.2  # of the amplitude: a crossing of the middle counts once the object is further than this beyond it
NOISE = 4.0  # standard deviations of a value that such an excursion has to exceed: noise alone does not go round
SCATTER = 0.2  # relative standard deviation of the half-cycles above which a motion has no period


@dataclass(frozen=True)
class Quantities:
    """acceleration (T, 3) [m/s^2], momentum (T, 3) [kg m/s], kinetic and potential energy (T,) [J] of a rigid object.

    Kinetic energy includes that of rotation; potential energy is that of gravity, 0 where z = 0.
    """

    acceleration: Array
    momentum: Array
    kinetic_energy: Array
    potential_energy: Array


@dataclass(frozen=True)
class Period:
    """Period [s] of a coordinate over `cycles` of it; standard_error [s] from the noise of the samples, if stated."""

    period: float
    cycles: float
    standard_error: float | None = None


def mechanical_quantities(world: World, trajectory: Trajectory, name: str) -> Quantities:
    """Return acceleration, momentum and energies of a rigid object at every sample.

    Accelerations are central differences of the velocity: smeared over the two samples about an impact. Raises
    ValueError for a deformable object.
    """
    if not world.is_rigid(name):
        kind = world.item(name).representation
        raise ValueError(f"{name!r} is {kind}: momentum and energy are those of rigid objects")
    item = world.object(name)
    i = trajectory.index(name)
    mass = object_mass(item)
    velocity = trajectory.velocities[:, i]
    properties = geometry.mass_properties(item.shape)
    axes = geometry.quaternion_matrix(trajectory.orientations[:, i])
    spin = np.einsum("tji,tj->ti", axes, trajectory.angular_velocities[:, i])  # in the body's axes
    inertia = properties.inertia * (mass / properties.volume)
    turning = 0.5 * np.einsum("ti,ij,tj->t", spin, inertia, spin)
    return Quantities(
        acceleration=accelerations(trajectory, name),
        momentum=mass * velocity,
        kinetic_energy=0.5 * mass * (velocity**2).sum(axis=1) + turning,
        potential_energy=-mass * trajectory.positions[:, i] @ np.asarray(world.environment.gravity),
    )


def accelerations(trajectory: Trajectory, name: str) -> Array:
    """Return the acceleration (T, 3) of an object's centre by central differences of its velocity [m/s^2]."""
    velocity = trajectory.velocities[:, trajectory.index(name)]
    if len(trajectory.times) < 2:
        return np.full(velocity.shape, np.nan)
    found: Array = np.gradient(velocity, trajectory.times, axis=0)
    return found


def period(times: Array, values: Array, sigma: float | None = None) -> Period | None:
    """Return the period of values (T,) at times (T,) [s]; None where they do not go round at least once.

    Crossings t_k of the middle between the extremes are located on straight lines through the samples near it, and
    t_k = t_0 + k T / 2 + (-1)^k d is fitted by least squares: d takes up a middle that is not the mean. sigma: standard
    deviation of a value. None also where the half-cycles differ too much for a period.
    """
    known = np.isfinite(values)
    times, values = times[known], values[known]
    if len(values) < 5:
        return None
    level, amplitude = 0.5 * (values.max() + values.min()), 0.5 * float(np.ptp(values))
    band = max(BAND * amplitude, NOISE * (sigma or 0.0))
    if not 0.0 < band < amplitude:
        return None
    side = np.where(values > level + band, 1, np.where(values < level - band, -1, 0))
    far = np.flatnonzero(side)
    turns = np.flatnonzero(side[far[1:]] != side[far[:-1]])
    crossings, errors = [], []
    for k in turns:
        rows = slice(far[k], far[k + 1] + 1)
        slope, offset = np.polyfit(times[rows] - times[far[k]], values[rows] - level, 1)
        crossings.append(float(times[far[k]] - offset / slope))
        errors.append((sigma or 0.0) / (abs(slope) * np.sqrt(far[k + 1] - far[k] + 1)))
    count = len(crossings)
    if count < 3:
        return None
    t, half = np.asarray(crossings), np.arange(count)
    whole = t[2:] - t[:-2]  # between crossings in the same direction
    if count > 3 and whole.std() > SCATTER * whole.mean():
        return None
    design = np.stack([np.ones(count), 0.5 * half, (-1.0) ** half], axis=1)
    inverse = np.linalg.pinv(design)
    error = None if sigma is None else float(np.sqrt((inverse[1] ** 2) @ np.asarray(errors) ** 2))
    return Period(float(inverse[1] @ t), 0.5 * (count - 1), error)
