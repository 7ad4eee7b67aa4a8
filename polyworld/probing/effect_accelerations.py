"""The acceleration that each effect of a world gives its objects, over a rollout."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.solver.core.effect_evaluation import Bodies, accelerations_of, enabled
from polyworld.solver.energy_sources import points_masses
from polyworld.trajectory import Rollout, Trajectory
from polyworld.world import World, geometry
from polyworld.world.parameters import object_mass

Array = NDArray[np.float64]


def effect_accelerations(world: World, result: Rollout) -> Array:
    """Return the acceleration (e, T, n, 3) that each enabled effect gives each object of a rollout [m/s^2].

    Of a deformable object the mean over its mass; 0 where an effect does not act, and before an object joins.
    """
    run = result.trajectory
    effects, touching = enabled(world), in_contact(world, result)
    found = np.zeros((len(effects), len(run.times), len(run.names), 3))
    if not effects:
        return found
    times = world.time.origin + run.times
    for k, name in enumerate(run.names):
        acts = np.array([e.objects is None or name in e.objects for e in effects])
        here = run.active[:, k]
        if not (acts.any() and here.any()):
            continue
        if world.is_rigid(name):
            item, count = world.object(name), int(here.sum())
            bodies = Bodies(
                mass=np.full(count, object_mass(item)),
                radius=np.full(count, geometry.equivalent_radius(item.shape)),
                positions=run.positions[here, k],
                velocities=run.velocities[here, k],
                spins=run.angular_velocities[here, k],
                times=times[here],
                contact=touching[here, k].astype(float),
            )
            push = accelerations_of(world, bodies)
        else:
            push = _of_points(world, run, name, here, times)
        found[:, here, k] = np.where(acts[:, None, None], push, 0.0)
    return found


def _of_points(world: World, run: Trajectory, name: str, here: NDArray[np.bool_], times: Array) -> Array:
    """Mean acceleration (e, t, 3) of a deformable object's nodes or particles that are there."""
    points, velocities = run.deformables[name].points[here], run.deformables[name].velocities[here]
    samples, k = points.shape[:2]
    mass = np.broadcast_to(points_masses(world, name, k), (samples, k))
    known = np.isfinite(points).all(axis=-1) & (mass > 0.0)
    bodies = Bodies(
        mass=mass[known],
        radius=np.zeros(int(known.sum())),
        positions=points[known],
        velocities=np.nan_to_num(velocities[known]),
        spins=np.zeros((int(known.sum()), 3)),
        times=np.broadcast_to(times[here][:, None], (samples, k))[known],
        contact=np.zeros(int(known.sum())),
    )
    each = accelerations_of(world, bodies)
    row = np.broadcast_to(np.arange(samples)[:, None], (samples, k))[known]
    total = np.maximum(np.bincount(row, weights=bodies.mass, minlength=samples), 1e-300)
    sums = [[np.bincount(row, bodies.mass * a[:, axis], samples) for axis in range(3)] for a in each]
    mean: Array = np.moveaxis(np.array(sums), 1, -1) / total[:, None]
    return mean


def in_contact(world: World, result: Rollout) -> NDArray[np.bool_]:
    """Return whether each object of a rollout touches another or is pressed on the supporting plane (T, n).

    Between the events that begin and end a contact; where those are not known throughout, up to where they are.
    """
    run, plane = result.trajectory, world.environment.motion_plane
    if world.planar and plane.supports and float(np.dot(world.environment.gravity, plane.normal)) < 0.0:
        return np.ones(run.active.shape, dtype=bool)
    touching = np.zeros(run.active.shape, dtype=bool)
    begins: dict[tuple[str, ...], float] = {}
    spans: list[tuple[tuple[str, ...], float, float]] = []
    for event in result.events:
        if event.kind == "contact_begin":
            begins.setdefault(event.participants, event.time)
        elif event.kind == "contact_end":
            spans.append((event.participants, begins.pop(event.participants, -np.inf), event.time))
    spans += [(pair, first, np.inf) for pair, first in begins.items()]
    for pair, first, last in spans:
        for name in set(pair) & set(run.names):
            touching[(run.times >= first) & (run.times <= last), run.index(name)] = True
    return touching
