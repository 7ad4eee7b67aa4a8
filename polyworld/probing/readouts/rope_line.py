"""The line of a rope as it is seen: through its nodes, and round the wheels that it runs over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.model.rope import tangent_point, unit_axis
from polyworld.probing.readouts.centreline import resampled
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import World, geometry
from polyworld.world.representations.rope import Pulley

Array = NDArray[np.float64]

ARC_STEP = 0.15  # [rad] between the pieces of a rope on a wheel

PER_WHEEL = 16  # more points of a line for each wheel


def rope_line(world: World, motion: Trajectory | BatchTrajectory, name: str) -> Array:
    """Points (..., T, k, 3) of a rope's line from end to end: its nodes, or points as close where it has pulleys."""
    points = motion.deformables[name].points
    pulleys = [p for p in world.pulleys if p.rope == name]
    if not pulleys:
        return points
    count = 2 * points.shape[-2] + PER_WHEEL * len(pulleys)
    centres = np.stack([_centre(world, motion, p) for p in pulleys], axis=-2)
    centres = np.broadcast_to(centres, (*points.shape[:-2], len(pulleys), 3)).reshape(-1, len(pulleys), 3)
    flat = points.reshape(-1, *points.shape[-2:])
    line = np.empty((len(flat), count, 3))
    for i, nodes in enumerate(flat):
        wheels = [p.model_copy(update={"centre": tuple(c)}) for p, c in zip(pulleys, centres[i], strict=True)]
        line[i] = resampled(along_wheels(name, nodes, wheels)[0], count)
    return line.reshape(*points.shape[:-2], count, 3)


def _centre(world: World, motion: Trajectory | BatchTrajectory, pulley: Pulley) -> Array:
    """Centre (..., T, 3) of a wheel, which moves with the object that carries it."""
    start = np.asarray(pulley.centre)
    if pulley.object is None:
        return start
    item, column = world.object(pulley.object), motion.names.index(pulley.object)
    local = geometry.quaternion_matrix(np.asarray(item.orientation)).T @ (start - np.asarray(item.position))
    turn = geometry.quaternion_matrix(motion.orientations[..., column, :])
    centre: Array = motion.positions[..., column, :] + turn @ local
    return centre


def along_wheels(rope: str, nodes: Array, wheels: Sequence[Pulley]) -> tuple[Array, NDArray[np.int64]]:
    """The rope's line (k, 3) [m] through its nodes and round the wheels it passes, and the segment (k - 1,) that each
    piece belongs to. Nodes do not lie on wheels: the segment that would cut through one goes round it instead."""
    number = np.arange(len(nodes) - 1)
    line = nodes
    if not np.all(np.isfinite(nodes)):
        return line, number
    for wheel in wheels:
        axis, centre = unit_axis(wheel), np.asarray(wheel.centre, dtype=float)
        flat = (line - centre) - np.outer((line - centre) @ axis, axis)
        start, step = flat[:-1], np.diff(flat, axis=0)
        share = np.clip(-(start * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-300), 0.0, 1.0)
        distance = np.linalg.norm(start + share[:, None] * step, axis=1)
        k = int(np.argmin(distance))
        if distance[k] >= wheel.radius or np.linalg.norm(flat[[k, k + 1]], axis=1).min() <= wheel.radius:
            continue
        ends = [tangent_point(rope, wheel, line[k + i], 1.0 - 2.0 * i) - centre for i in range(2)]
        angle = float(np.arctan2(axis @ np.cross(*ends), ends[0] @ ends[1])) % (2.0 * np.pi)
        turns = np.linspace(0.0, angle, max(2, round(angle / ARC_STEP)))[:, None]
        arc = centre + ends[0] * np.cos(turns) + np.cross(axis, ends[0]) * np.sin(turns)
        line = np.concatenate([line[: k + 1], arc, line[k + 1 :]])
        number = np.concatenate([number[:k], np.full(len(arc) + 1, number[k]), number[k + 1 :]])
    return line, number
