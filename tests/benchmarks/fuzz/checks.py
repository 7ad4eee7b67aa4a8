"""Checks of a rollout of any world: finite numbers, and no more energy than is available."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.model.rope import threading
from polyworld.trajectory import Trajectory
from polyworld.world import Deformable, World, geometry
from polyworld.world.materials import PLANAR, material_of
from polyworld.world.parameters import object_mass

Array = NDArray[np.float64]

NOISE = 0.05  # of the energy that is exchanged: errors of first order in the step, far from an explosion
EXPULSION = 10.0  # of sqrt(g size): speed at which things that started inside each other may part


def not_finite(world: World, trajectory: Trajectory) -> str | None:
    """Name the first quantity with a number that is not finite; particles that are not there, and fluids, excepted."""
    liquids = {f.name for f in world.of_form("liquid")}
    kept = [i for i, name in enumerate(trajectory.names) if name not in liquids]
    for quantity in ("positions", "orientations", "velocities", "angular_velocities"):
        bad = ~np.isfinite(getattr(trajectory, quantity)[:, kept]).all(axis=(0, 2))
        if bad.any():
            return f"{quantity} of {trajectory.names[kept[int(np.argmax(bad))]]}"
    for name, motion in trajectory.deformables.items():
        if name not in liquids and not (np.isfinite(motion.points).all() and np.isfinite(motion.velocities).all()):
            return f"points of {name}"
    return None


def energy_excess(world: World, trajectory: Trajectory, *, overlaps: bool) -> float:
    """Gain of mechanical energy over all that could supply it, as a part of the latter; above 1 is an explosion.

    0 for worlds whose supply is not bounded here: emitters, and fastenings that are led along.
    """
    if world.emitters or any(a.motion for a in world.attachments):
        return 0.0
    kinetic, height = _energies(world, trajectory)
    energy = kinetic + height
    size = _size(world)
    g = float(np.linalg.norm(world.environment.gravity))
    mass = sum(float(np.sum(_masses(world, d))) for d in world.deformables) + sum(map(object_mass, world.objects))
    exchanged = float(np.ptp(height)) + float(kinetic.max() if kinetic[0] == kinetic.max() else np.ptp(kinetic))
    supply = NOISE * (exchanged + kinetic[0] + mass * g * size) + _stored(world) + _work(world, trajectory)
    if overlaps:
        supply += 0.5 * mass * EXPULSION**2 * max(g, 1.0) * size
    return float((energy - energy[0]).max()) / supply


def _energies(world: World, trajectory: Trajectory) -> tuple[Array, Array]:
    """Kinetic energy (T,) and that of height [J]; what has not joined counts as at its start."""
    gravity = np.asarray(world.environment.gravity)
    kinetic, height = np.zeros(len(trajectory.times)), np.zeros(len(trajectory.times))
    for i, item in enumerate(world.objects):
        here = trajectory.active[:, i]
        x = np.where(here[:, None], trajectory.positions[:, i], item.position)
        v = np.where(here[:, None], trajectory.velocities[:, i], item.velocity)
        w = np.where(here[:, None], trajectory.angular_velocities[:, i], item.angular_velocity)
        q = np.where(here[:, None], trajectory.orientations[:, i], item.orientation)
        mass = object_mass(item)
        solid = geometry.mass_properties(item.shape)
        spin = np.einsum("tji,tj->ti", geometry.quaternion_matrix(q), w)
        kinetic += 0.5 * mass * (v**2).sum(axis=1)
        kinetic += 0.5 * mass / solid.volume * np.einsum("ti,ij,tj->t", spin, solid.inertia, spin)
        height -= mass * x @ gravity
    for soft in world.deformables:
        motion, mass_of = trajectory.deformables[soft.name], _masses(world, soft)
        kinetic += 0.5 * np.nansum(mass_of * (motion.velocities**2).sum(axis=-1), axis=1)
        height -= np.nansum(mass_of * (motion.points @ gravity), axis=1)
    return kinetic, height


def _masses(world: World, item: Deformable) -> Array:
    """Mass [kg] of each point at the start."""
    mesh = mesh_of(world, item)
    density = float(getattr(item, material_of(item).density))
    if material_of(item).form == "liquid":
        assert world.fluid_grid is not None
        power = 2 if item.representation.endswith(PLANAR) else 3
        return np.full(len(mesh.nodes), density * (world.fluid_grid.cell / 2.0) ** power)
    found: Array = density * mesh.measure
    return found


def _size(world: World) -> float:
    """A length of the things in the world [m]."""
    sizes = [geometry.circumscribed_radius(o.shape) for o in world.objects]
    for item in world.deformables:
        nodes = mesh_of(world, item).nodes
        sizes += [float(np.ptp(nodes, axis=0).max())] if len(nodes) else []
    return max([*sizes, 1e-6])


def _stored(world: World) -> float:
    """Elastic energy at the start [J]: stretched and bent ropes, springs."""
    total = 0.0
    for rope in world.of_form("line"):
        thread = threading(world, rope)
        chain = np.linalg.norm(np.diff(thread.nodes, axis=0), axis=1)
        rest = thread.segment_length
        if not thread.pulleys:
            total += 0.5 * rope.stretch_stiffness * float((np.maximum(chain / rest - 1.0, 0.0) ** 2).sum()) * rest
        else:
            total += 0.5 * rope.stretch_stiffness * (thread.stretch - 1.0) ** 2 * float(thread.rest.sum())
        if not rope.curved_at_rest:
            t = np.diff(thread.nodes, axis=0) / chain[:, None]
            turn = np.arccos(np.clip((t[1:] * t[:-1]).sum(axis=1), -0.999, 1.0))
            total += rope.bending_stiffness * float((2.0 * np.tan(turn / 2.0) ** 2).sum()) * 2.0 / rest
        total += rope.linear_density * 9.81 * sum(p.radius for p in thread.pulleys) ** 2 * 6.0
    for joint in world.joints:
        if joint.kind == "spring":
            reach = float(np.linalg.norm(np.subtract(joint.anchor, joint.other_anchor)))
            total += 0.5 * joint.stiffness * (reach - joint.length) ** 2
    return total


def _work(world: World, trajectory: Trajectory) -> float:
    """Most that effects and motors can have done [J], from the ways gone between samples."""
    total = 0.0
    lengths = np.abs(np.diff(trajectory.times))
    paths, turns = {}, {}
    for i, name in enumerate(trajectory.names):
        speed = np.linalg.norm(np.nan_to_num(trajectory.velocities[:, i]), axis=1)
        spin = np.linalg.norm(np.nan_to_num(trajectory.angular_velocities[:, i]), axis=1)
        paths[name] = float((np.maximum(speed[1:], speed[:-1]) * lengths).sum())
        turns[name] = float((np.maximum(spin[1:], spin[:-1]) * lengths).sum())
    for joint in world.joints:
        motor = getattr(joint, "motor", None)
        if motor is not None:
            way = turns if joint.kind == "hinge" else paths
            gone = way[joint.object] + (way[joint.other] if joint.other is not None else 0.0)
            if motor.target_speed is not None:
                gone += abs(motor.target_speed) * float(trajectory.times[-1])
            total += 2.0 * motor.limit * gone
    air, wind = world.environment.air_density, float(np.linalg.norm(world.environment.wind))
    for sheet in world.of_form("sheet"):
        area = float(mesh_of(world, sheet).measure.sum())
        total += 0.5 * air * (sheet.drag_normal + sheet.drag_tangential) * area * (2.0 * wind) ** 2 * paths[sheet.name]
    masses = {o.name: object_mass(o) for o in world.objects}
    masses |= {s.name: float(_masses(world, s).sum()) for s in world.deformables}
    for effect in world.effects:
        for name in effect.objects or trajectory.names:
            reach = float(np.linalg.norm(np.nan_to_num(trajectory.positions[:, trajectory.index(name)]), axis=1).max())
            total += 2.0 * _force(effect.kind, effect.parameters, masses[name], reach, world) * paths[name]
    return total


def _force(kind: str, p: Any, mass: float, reach: float, world: World) -> float:
    """Largest force of an effect that can do work [N], on a body no further than `reach` from the origin."""
    vector = float(np.sqrt(sum(abs(p.get(a, 0.0)) ** 2 for a in ("x", "y", "z"))))
    if kind == "uniform_acceleration":
        return mass * vector
    if kind == "uniform_force":
        return vector
    if kind == "periodic_forcing":
        return mass * float(sum(abs(p[f"amplitude_{a}"]) for a in "xyz"))
    if kind == "fan":
        return float(sum(abs(p[f"force_{a}"]) for a in "xyz"))
    if kind == "wind":
        return 4.0 * p["coefficient"] * float(sum(p[f"velocity_{a}"] ** 2 for a in "xyz"))
    if kind in ("spring", "tether"):
        return float(p["stiffness"]) * (reach + sum(abs(p[f"anchor_{a}"]) for a in "xyz") + p["rest_length"])
    if kind == "central_force":
        far = reach + sum(abs(p[f"centre_{a}"]) for a in "xyz") + 1.0
        return abs(p["strength"]) * max(far ** p["exponent"], p["softening"] ** p["exponent"])
    if kind == "buoyancy":
        return mass * float(np.linalg.norm(world.environment.gravity)) * p["density_ratio"]
    if kind == "coriolis":  # with the centrifugal force
        return mass * reach * float(sum(p[f"rotation_{a}"] ** 2 for a in "xyz"))
    return 0.0
