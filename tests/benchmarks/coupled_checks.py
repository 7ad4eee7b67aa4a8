"""Check a rollout of coupled materials, whatever they do: each check a number and its bound."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.worlds.marks import held_nodes
from atw_mcp.worlds.rollout_cost import emitted
from polyworld.model import mesh_of
from polyworld.model.rope import threading
from polyworld.trajectory import Rollout
from polyworld.world import Deformable, World, geometry
from polyworld.world.parameters import object_mass
from polyworld.world.representations.cloth import Cloth
from polyworld.world.representations.fluid import Fluid
from polyworld.world.representations.rope import Rope

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Check:
    """One thing that must hold: value <= bound."""

    name: str
    value: float
    bound: float

    @property
    def holds(self) -> bool:
        """Whether it does."""
        return bool(np.isfinite(self.value) and self.value <= self.bound)


def checks(world: World, result: Rollout) -> Iterator[Check]:
    """Return all that applies to a world."""
    trajectory = result.trajectory
    yield Check("seconds not run", result.horizon - float(trajectory.times[-1]), 1e-9)
    yield Check("values that are not finite", float(_not_finite(world, result)), 0.0)
    sizes = [
        np.ptp(m.points[0], axis=0).max() for m in trajectory.deformables.values() if np.isfinite(m.points[0]).all()
    ]
    size = max([*map(float, sizes), 0.1])
    if not world.emitters and not world.drains:
        energy = mechanical_energy(world, result)
        scale = max(float(np.ptp(energy)), float(total_mass(world)) * 9.81 * 0.1 * size)
        # Without forces from outside, what is stored in deformation (never negative, none at the start) and what is
        # rubbed away leave less than there was.
        yield Check("energy gained / energy exchanged", float((energy - energy[0]).max()) / scale, 0.02)
    for item in world.deformables:
        if isinstance(item, Fluid):
            yield from _fluid_checks(world, result, item)
        else:
            lowest = float(trajectory.deformables[item.name].points[..., 2].min())
            radius = float(mesh_of(world, item).radius.max())
            yield Check(f"{item.name} below the floor [m]", -lowest - min(radius, 0.0), 0.02 * size)
        if isinstance(item, Rope):
            yield _rope_length(world, result, item)
    for attachment in world.attachments:
        yield Check(f"{attachment.name} slips [m]", _slip(world, result, attachment.name), 0.01)
    for joint in world.joints:
        column = trajectory.index(joint.object)
        item = world.object(joint.object)
        arm = np.asarray(joint.anchor) - np.asarray(item.position)
        turn = geometry.quaternion_matrix(trajectory.orientations[:, column])
        apart = trajectory.positions[:, column] + turn @ arm - np.asarray(joint.anchor)
        yield Check(f"{joint.name} pulled apart [m]", float(np.linalg.norm(apart, axis=1).max()), 0.003)


def mechanical_energy(world: World, result: Rollout) -> Array:
    """Kinetic energy and that of height (T,) [J], without what is stored in deformation."""
    trajectory = result.trajectory
    gravity = np.asarray(world.environment.gravity)
    total: Array = np.zeros(len(trajectory.times))
    for column, item in enumerate(world.objects):
        mass = object_mass(item)
        inertia = geometry.mass_properties(item.shape).inertia * mass / geometry.mass_properties(item.shape).volume
        turn = geometry.quaternion_matrix(trajectory.orientations[:, column])
        spin = np.einsum("tji,tj->ti", turn, trajectory.angular_velocities[:, column])
        speed = (trajectory.velocities[:, column] ** 2).sum(axis=1)
        total += 0.5 * mass * speed + 0.5 * np.einsum("ti,ij,tj->t", spin, inertia, spin)
        total -= mass * trajectory.positions[:, column] @ gravity
    for soft in world.deformables:
        motion, mass_of = trajectory.deformables[soft.name], node_masses(world, soft)
        total += 0.5 * np.nansum(mass_of * (motion.velocities**2).sum(axis=-1), axis=1)
        total -= np.nansum(mass_of * (motion.points @ gravity), axis=1)
    return total


def total_mass(world: World) -> float:
    """Mass of everything that moves at the start [kg]."""
    soft = sum(float(np.sum(node_masses(world, d) * np.ones(len(mesh_of(world, d).nodes)))) for d in world.deformables)
    return sum(object_mass(o) for o in world.objects) + soft


def node_masses(world: World, item: Deformable) -> Array:
    """Mass [kg] of each node, or of every particle alike (1,)."""
    mesh = mesh_of(world, item)
    if isinstance(item, Fluid):
        assert world.fluid_grid is not None
        return np.array([item.density * (world.fluid_grid.cell / 2.0) ** 3])
    density = (
        item.linear_density
        if isinstance(item, Rope)
        else item.areal_density
        if isinstance(item, Cloth)
        else item.density
    )
    return density * mesh.measure


def _not_finite(world: World, result: Rollout) -> int:
    trajectory = result.trajectory
    arrays = [trajectory.positions, trajectory.velocities, trajectory.orientations, trajectory.angular_velocities]
    fluids = {d.name for d in world.deformables if isinstance(d, Fluid)}
    if world.emitters:  # before the first drop a fluid has no centre
        columns = [i for i, name in enumerate(trajectory.names) if name not in fluids]
        arrays = [a[:, columns] for a in arrays]
    for name, motion in trajectory.deformables.items():
        if name not in fluids:
            arrays += [motion.points, motion.velocities]
    return sum(int((~np.isfinite(a)).sum()) for a in arrays)


def _fluid_checks(world: World, result: Rollout, fluid: Fluid) -> Iterator[Check]:
    assert world.fluid_grid is not None
    points = result.trajectory.deformables[fluid.name].points
    there = np.isfinite(points).all(axis=-1).sum(axis=1)
    size = (world.fluid_grid.cell / 2.0) ** 3
    start = len(mesh_of(world, fluid).nodes) * size
    poured = sum(emitted(e, float(result.trajectory.times[-1])) for e in world.emitters if e.fluid == fluid.name)
    volume = float(there[-1]) * size
    yield Check(f"{fluid.name}: volume off / volume", abs(volume - start - poured) / (start + poured), 0.02)
    lower = np.asarray(world.fluid_grid.lower) - points
    upper = points - np.asarray(world.fluid_grid.upper)
    yield Check(f"{fluid.name} outside its box [m]", float(np.nanmax(np.maximum(lower, upper))), 1e-6)


def _rope_length(world: World, result: Rollout, rope: Rope) -> Check:
    """Return how much longer than without tension a rope is, with the parts that it lays on its wheels."""
    from polyworld.probing.readouts.rope_line import along_wheels

    points = result.trajectory.deformables[rope.name].points
    wheels = [p for p in world.pulleys if p.rope == rope.name]
    rest = float(threading(world, rope).rest.sum())
    longest = 0.0
    for places in points:
        line, _ = along_wheels(rope.name, places, wheels)
        longest = max(longest, float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()))
    return Check(f"{rope.name}: longest stretch", longest / rest - 1.0, 0.02)


def _slip(world: World, result: Rollout, name: str) -> float:
    """Return how far held nodes come from where they are held [m]; from a soft body, how much the distance changes."""
    attachment = next(a for a in world.attachments if a.name == name)
    trajectory = result.trajectory
    nodes = held_nodes(world, attachment)
    points = trajectory.deformables[attachment.object].points[:, nodes]
    if attachment.to is None:
        return float(np.linalg.norm(points - points[0], axis=-1).max())
    if attachment.to in trajectory.deformables:
        other = trajectory.deformables[attachment.to].points
        nearest = np.argmin(np.linalg.norm(other[0][None] - points[0][:, None], axis=-1), axis=1)
        gap = np.linalg.norm(points - other[:, nearest], axis=-1)
        return float(np.abs(gap - gap[0]).max())
    column = trajectory.index(attachment.to)
    turn = geometry.quaternion_matrix(trajectory.orientations[:, column])
    local = np.einsum("tji,tkj->tki", turn, points - trajectory.positions[:, column, None])
    return float(np.linalg.norm(local - local[0], axis=-1).max())
