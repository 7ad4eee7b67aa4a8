"""Find runs whose mechanical energy grows though nothing gives it: they diverge, and are not to be believed.

Kinetic energy gained since the start is at most the energy that weight and elastic parts gave, and the work of motors,
wind and effects (`energy_sources`): elastic energy is not negative, and contacts, joints and resistances only take.
This is checked at the samples. Worlds with led attachments, emitters, drains or driving effects have no such
bound and are not checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.model import model_of
from polyworld.solver.energy_sources import masses_of, points_masses, stored_energy, unbounded, work
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import World, geometry
from polyworld.world.representations.joint import Spring

Array = NDArray[np.float64]

# Share of the energy that there was to become motion by which it may be exceeded: contacts and unresolved stretch err
# by up to 10% at the coarsest steps that the tests hold, explosions by orders of magnitude.
TOLERANCE = 0.25
# Objects that overlap at the start are parted by up to their size, at this speed at most [m/s].
PARTING = 1.0


@dataclass(frozen=True)
class Growth:
    """Energy out of nothing: when it was first seen [s], in which moving object, at which of its nodes, in words."""

    time: float
    object: int
    element: int
    reason: str


def find_growth(world: World, motion: Trajectory) -> Growth | None:
    """Return where a world's energy first exceeds its bound at a sample of its motion; None where it does not."""
    if len(motion.times) < 2 or unbounded(world):
        return None
    masses = masses_of(world)
    allowed = _parting(world, masses)
    for exact in (False, True):  # most worlds need no more than a bound on the energy of spin
        kinetic, excess, available = balance(world, motion, masses, exact=exact)
        beyond = np.flatnonzero(np.isfinite(excess) & (excess > TOLERANCE * available + allowed))
        if not len(beyond):
            return None
    t = int(beyond[0])
    worst = int(np.argmax(kinetic[t] - kinetic[0]))
    name = motion.names[worst]
    element = 0
    if name in motion.deformables:
        element = int(np.nanargmax(np.linalg.norm(motion.deformables[name].velocities[t], axis=-1)))
    held = [repr(a.name) for a in world.attachments if name in (a.object, a.to)]
    fastened = f", and it is held by {', '.join(held)}" if held else ""
    reason = (
        f"its kinetic energy exceeds by {excess[t]:.3g} J the {available[t]:.3g} J that there was{fastened}; "
        "start it without overlaps, or take a shorter substep"
    )
    return Growth(float(motion.times[t]), worst, element, reason)


def balance(world: World, motion: Trajectory, masses: Array, *, exact: bool = True) -> tuple[Array, Array, Array]:
    """Kinetic energies (T, n); by how much (T,) they exceed what there was to become motion, and that (T,) [J].

    masses (n,): of the objects. exact: False for energies of spin about the axis of largest inertia, but of what there
    was at the start: bounds from the safe side.
    """
    kinetic, weight = energies(world, motion, masses, exact=exact)
    lost = weight[0].sum() - weight.sum(axis=1)
    there = stored_energy(world) + work(world, motion, masses)
    there = there + (kinetic[0] if exact else energies(world, motion, masses, samples=1)[0][0]).sum()
    available = there + np.maximum.accumulate(np.maximum(np.nan_to_num(lost), 0.0))
    return kinetic, kinetic.sum(axis=1) - lost - there, available


def watch(
    batch: BatchTrajectory, members: Sequence[World], *, from_start: bool = True
) -> tuple[BatchTrajectory, tuple[str | None, ...]]:
    """Mark as diverged the worlds of a batch whose energy grows out of nothing, and say why.

    from_start: whether the first sample is the worlds' own start; from a state saved later, what springs store is not
    known, and worlds with springs are not checked.
    """
    if not from_start and any(isinstance(j, Spring) for m in members for j in m.joints):
        return batch, (None,) * len(members)
    diverged, times = batch.diverged.copy(), batch.diverged_time.copy()
    objects = batch.diverged_object.copy()
    elements = np.full(len(members), -1) if batch.diverged_element is None else batch.diverged_element.copy()
    truncated = dict(batch.truncated)
    reasons: list[str | None] = []
    for w, member in enumerate(members):
        found = find_growth(member, batch.world(w))
        reasons.append(None if found is None else found.reason)
        if found is not None:
            diverged[w], times[w], objects[w], elements[w] = True, found.time, found.object, found.element
            truncated.pop(w, None)
    if not any(reasons):
        return batch, tuple(reasons)
    marked = replace(
        batch,
        diverged=diverged,
        diverged_time=times,
        diverged_object=objects,
        diverged_element=elements,
        truncated=truncated,
        events=tuple(
            events if reason is None else tuple(e for e in events if e.time < times[w])
            for w, (events, reason) in enumerate(zip(batch.events, reasons, strict=True))
        ),
    )
    return marked, tuple(reasons)


def energies(
    world: World, motion: Trajectory, masses: Array, *, exact: bool = True, samples: int | None = None
) -> tuple[Array, Array]:
    """Kinetic energy and energy of weight (T, n) of all objects [J]; what has not joined counts as at its start.

    masses (n,): of the objects. exact, samples: see `balance`; how many samples from the first, default all.
    """
    gravity = np.asarray(world.environment.gravity, dtype=float)
    kinetic = np.zeros((len(motion.times[:samples]), len(motion.names)))
    weight = np.zeros_like(kinetic)
    if world.objects:
        _add_rigid(world, motion, masses, gravity, kinetic, weight, exact=exact)
    for item in world.deformables:
        k, points = motion.names.index(item.name), motion.deformables[item.name]
        mass = points_masses(world, item.name, points.points.shape[-2])
        kinetic[:, k] = 0.5 * np.nan_to_num((points.velocities[:samples] ** 2).sum(axis=-1)) @ mass
        weight[:, k] = -np.nan_to_num(points.points[:samples] @ gravity) @ mass
    return kinetic, weight


def _add_rigid(
    world: World, motion: Trajectory, masses: Array, gravity: Array, kinetic: Array, weight: Array, *, exact: bool
) -> None:
    """Fill in the columns of the rigid objects."""
    count, n = len(kinetic), len(world.objects)
    solids = model_of(world).solids
    starts = (motion.positions, motion.velocities, motion.angular_velocities, motion.orientations)
    x, v, w, q = (values[:count, :n] for values in starts)
    if not motion.active[:count, :n].all():
        here = motion.active[:count, :n, None]
        names = ("position", "velocity", "angular_velocity", "orientation")
        initial = (np.array([getattr(o, name) for o in world.objects]) for name in names)
        x, v, w, q = (np.where(here, values, start) for values, start in zip((x, v, w, q), initial, strict=True))
    weight[:, :n] = -(x @ gravity) * masses[:n]
    kinetic[:, :n] = 0.5 * (v * v).sum(axis=2) * masses[:n]
    if exact:
        inertia = np.array([s.inertia * (m / s.volume) for s, m in zip(solids, masses, strict=False)])
        spin = np.einsum("tnji,tnj->tni", geometry.quaternion_matrix(q), w)
        kinetic[:, :n] += 0.5 * np.einsum("tni,nij,tnj->tn", spin, inertia, spin)
    else:
        largest = np.array([np.trace(s.inertia) * (m / s.volume) for s, m in zip(solids, masses, strict=False)])
        kinetic[:, :n] += 0.5 * (w * w).sum(axis=2) * largest


def _parting(world: World, masses: Array) -> float:
    """Energy that parting overlaps may give: objects overlap by no more than they are thick [J]."""
    gravity = float(np.linalg.norm(world.environment.gravity))
    model = model_of(world)
    thick = [float(np.cbrt(solid.volume)) for solid in model.solids]
    for item in world.deformables:
        mesh = model.mesh(item.name)
        solid = model.materials[item.name].form in ("solid", "liquid") and len(mesh.nodes) > 0
        flat = np.ptp(mesh.nodes, axis=0) if solid else np.zeros(3)
        thick.append(float(flat[flat > 0.0].min()) if solid else 2.0 * float(np.max(mesh.radius, initial=0.0)))
    return float(masses @ (gravity * np.array(thick) + 0.5 * PARTING**2)) if thick else 0.0
