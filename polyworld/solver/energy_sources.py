"""The most energy that can come into a world's motion: stored at the start, and by the work of what acts on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.effects.law import Course
from polyworld.expressions.effect import law_of
from polyworld.model import model_of
from polyworld.trajectory import Trajectory
from polyworld.world import World
from polyworld.world.parameters import object_mass
from polyworld.world.representations.joint import Spring

Array = NDArray[np.float64]

# Ways are those of the samples, along which speeds may peak in between: twice the work that they show is allowed.
BETWEEN = 2.0


def unbounded(world: World) -> tuple[str, ...]:
    """Name what may do work on a world's objects that is not bounded here."""
    found = [a.name for a in world.attachments if a.motion]
    found += [e.name for e in (*world.emitters, *world.drains)]
    found += [e.name for e in world.effects if law_of(e).work is None]
    return tuple(found)


def stored_energy(world: World) -> float:
    """Elastic energy of springs and ropes at the start, or somewhat more [J]."""
    total = 0.0
    for joint in world.joints:
        if isinstance(joint, Spring):
            stretch = float(np.linalg.norm(np.subtract(joint.anchor, joint.other_anchor))) - joint.length
            total += 0.5 * joint.stiffness * stretch**2
    model = model_of(world)
    for item in world.deformables:
        total += model.materials[item.name].stored(world, item, model.mesh(item.name))
    return total


def work(world: World, motion: Trajectory, masses: Array) -> Array:
    """Most work (T,) that motors, wind and effects can have done by each sample [J]. masses (n,): of the objects."""
    if not (world.effects or world.joints or np.any(world.environment.wind)):
        return np.zeros(len(motion.times))
    steps = np.diff(motion.times, prepend=motion.times[0])[:, None]
    ways = np.cumsum(_upper(motion.velocities) * steps, axis=0)
    turns = np.cumsum(_upper(motion.angular_velocities) * steps, axis=0)
    total = np.zeros(len(motion.times))
    for joint in world.joints:
        motor = getattr(joint, "motor", None)
        if motor is not None:
            gone = turns if joint.kind == "hinge" else ways
            bodies = [motion.index(name) for name in (joint.object, joint.other) if name is not None]
            driven = abs(motor.target_speed or 0.0) * (motion.times - motion.times[0])
            total += motor.limit * (gone[:, bodies].sum(axis=1) + driven)
    air, wind = world.environment.air_density, float(np.linalg.norm(world.environment.wind))
    for sheet in world.of_form("sheet"):
        area = float(model_of(world).mesh(sheet.name).measure.sum())
        most = 0.5 * air * (sheet.drag_normal + sheet.drag_tangential) * area * (2.0 * wind) ** 2
        total += most * ways[:, motion.index(sheet.name)]
    for effect in world.effects:
        law = law_of(effect)
        assert law.work is not None  # else the world is `unbounded`
        parameters = {n: effect.parameters.get(n, q.default) for n, q in law.parameters.items()}
        for name in effect.objects or motion.names:
            k = motion.index(name)
            course = Course(
                mass=float(masses[k]),
                gravity=float(np.linalg.norm(world.environment.gravity)),
                path=ways[:, k],
                reach=_largest(motion.positions[:, k]),
                speed=_largest(motion.velocities[:, k]),
                spin=_largest(motion.angular_velocities[:, k]),
            )
            total += law.work(parameters, course)
    return BETWEEN * total


def _largest(vectors: Array) -> float:
    """Return the largest length of vectors (T, 3), of those that are known."""
    return float(np.nanmax(np.linalg.norm(vectors, axis=1), initial=0.0))


def _upper(velocities: Array) -> Array:
    """Higher speeds (T, n) of each sample and the one before."""
    speeds = np.linalg.norm(np.nan_to_num(velocities), axis=-1)
    speeds[1:] = np.maximum(speeds[1:], speeds[:-1])
    return speeds


def masses_of(world: World) -> Array:
    """Masses (n,) of the objects [kg]; of a liquid, that of its start."""
    rigid = [object_mass(o) for o in world.objects]
    return np.array([*rigid, *(float(points_masses(world, d.name).sum()) for d in world.deformables)])


def points_masses(world: World, name: str, points: int | None = None) -> Array:
    """Masses of a deformable object's nodes or particles [kg], of a slice's per metre of it."""
    model = model_of(world)
    item, material = world.deformable(name), model.materials[name]
    density = float(getattr(item, material.density))
    if material.form == "liquid":
        assert world.fluid_grid is not None
        size = (world.fluid_grid.cell / 2.0) ** (2 if world.planar else 3)
        return np.full(len(model.mesh(name).nodes) if points is None else points, density * size)
    found: Array = density * model.mesh(name).measure
    return found
