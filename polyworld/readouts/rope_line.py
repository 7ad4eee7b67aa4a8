"""The line of a rope as it is seen: through its nodes, and round the wheels that it runs over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.readouts.centreline import resampled
from polyworld.representations.rope import Pulley
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import World

Array = NDArray[np.float64]

PER_WHEEL = 16  # more points of a line for each wheel


def rope_line(world: World, motion: Trajectory | BatchTrajectory, name: str) -> Array:
    """Points (..., T, k, 3) of a rope's line from end to end: its nodes, or points as close where it has pulleys."""
    points = motion.deformables[name].points
    pulleys = [p for p in world.pulleys if p.rope == name]
    if not pulleys:
        return points
    # Imported here: most ropes have no pulleys, and pictures bring their kernels.
    from polyworld.deformable_pictures import along_wheels

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
