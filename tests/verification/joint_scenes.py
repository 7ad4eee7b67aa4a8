"""Short-hand for the jointed spatial worlds that the verification cases run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.model import model_of
from polyworld.solver.spatial.simulator import SpatialSimulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Environment, StaticObject, TimeBase, World, geometry
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Slider, Spring
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]
G = 9.81  # [m/s^2]


def linked(
    *objects: RigidObject,
    joints: tuple[Hinge | Slider | Ball | Fixed | Spring, ...],
    statics: tuple[StaticObject, ...] = (),
    gravity: float = G,
    substep: float = 0.002,
) -> World:
    """A spatial world in which gravity pulls along -z."""
    return World(
        objects=objects,
        statics=statics,
        joints=joints,
        environment=Environment(gravity=(0.0, 0.0, -gravity)),
        time=TimeBase(substep=substep),
    )


def moved(
    world: World,
    duration: float,
    *,
    step: float = 0.01,
    overrides: Mapping[str, Array] | None = None,
    n_worlds: int = 1,
) -> BatchTrajectory:
    """The world's motion, sampled every `step` [s]."""
    times = np.arange(round(duration / step) + 1) * step
    simulator = SpatialSimulator(model_of(world), times, n_worlds=n_worlds, record_events=True, threads=1)
    return simulator.run(overrides)


def moments(world: World) -> Array:
    """Moments of inertia (n, 3, 3) about the centres of mass, body axes [kg m^2]."""
    solids = [geometry.mass_properties(o.shape) for o in world.objects]
    return np.array([s.inertia / s.volume * o.mass for s, o in zip(solids, world.objects, strict=True)])


def energy(world: World, motion: BatchTrajectory) -> Array:
    """Kinetic and potential energy (T,) [J]."""
    masses = np.array([o.mass for o in world.objects])
    turns = geometry.quaternion_matrix(motion.orientations[0])
    spin = np.einsum("tnij,tni->tnj", turns, motion.angular_velocities[0])
    turning = 0.5 * np.einsum("tni,nij,tnj->t", spin, moments(world), spin)
    moving = 0.5 * (np.square(motion.velocities[0]).sum(axis=2) * masses).sum(axis=1)
    height: Array = -(motion.positions[0] @ np.asarray(world.environment.gravity) * masses).sum(axis=1)
    return turning + moving + height


def momentum(world: World, motion: BatchTrajectory) -> tuple[Array, Array]:
    """Momentum [kg m/s] and angular momentum about the origin [kg m^2/s], each (T, 3)."""
    masses = np.array([o.mass for o in world.objects])[:, None]
    turns = geometry.quaternion_matrix(motion.orientations[0])
    linear = masses * motion.velocities[0]
    own = np.einsum("tnij,njk,tnlk,tnl->tni", turns, moments(world), turns, motion.angular_velocities[0])
    return linear.sum(axis=1), (np.cross(motion.positions[0], linear) + own).sum(axis=1)


def body(name: str, shape: Any, position: Any, **fields: Any) -> RigidObject:
    """A body of 1 kg by default."""
    fields.setdefault("mass", 1.0)
    vectors = {k: tuple(map(float, v)) if np.ndim(v) else v for k, v in fields.items()}
    return RigidObject(name=name, shape=shape, position=tuple(map(float, position)), **vectors)


def turned(axis: Any, angle: float) -> tuple[float, float, float, float]:
    """Quaternion w, x, y, z of a turn about a unit axis [rad]."""
    w, x, y, z = geometry.rotation_quaternion(np.asarray(axis, dtype=float) * angle)
    return float(w), float(x), float(y), float(z)


def upward_crossings(times: Array, values: Array, rates: Array) -> Array:
    """Times at which a sampled function rises through 0: roots of the cubics through values and rates."""
    found = []
    for i in np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0)):
        h = times[i + 1] - times[i]
        p, q, m, n = values[i], values[i + 1], rates[i] * h, rates[i + 1] * h
        roots = np.roots([2 * p + m - 2 * q + n, -3 * p - 2 * m + 3 * q - n, m, p])
        inside = [r.real for r in roots if abs(r.imag) < 1e-9 and -1e-9 <= r.real <= 1 + 1e-9]
        found.append(times[i] + h * inside[0])
    return np.array(found)
