"""A world at its start, for those that were not run: where each object begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from atw_mcp.viewer import world_parts
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.rollouts import shown_points
from polyworld.model import mesh_of
from polyworld.trajectory import PointMotion, Trajectory
from polyworld.world import World


def start_view(world: World, blocks: Blocks) -> world_parts.Start:
    """Return all objects where they begin, those too that join later; NaN where a world does not say where that is."""
    start = start_of(world, [item.name for item in world.deformables])
    return world_parts.Start(
        names=list(start.names),
        times=blocks.floats(start.times),
        positions=blocks.floats(start.positions),
        orientations=blocks.floats(start.orientations),
        active=blocks.raw(start.active),
        deformed=[
            world_parts.Deformed(name=name, points=blocks.floats(shown_points(world, start, name)))
            for name in start.deformables
        ],
    )


def start_of(world: World, deformables: Sequence[str]) -> Trajectory:
    """Return one sample of all moving objects where they begin, with the points of some deformable ones."""
    names = world.moving_names
    rigid = {item.name: item for item in world.objects}
    positions = np.full((1, len(names), 3), np.nan)
    orientations = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(names), 1))
    for column, name in enumerate(names):
        if name in rigid:
            positions[0, column] = np.array(rigid[name].position, dtype=float)
            orientations[0, column] = np.array(rigid[name].orientation, dtype=float)
    points = {name: mesh_of(world, world.deformable(name)).nodes for name in deformables}
    for name, nodes in points.items():
        if len(nodes):  # a fluid that flows in has none
            positions[0, names.index(name)] = nodes.mean(axis=0)
    return Trajectory(
        names=names,
        times=np.zeros(1),
        positions=positions,
        orientations=orientations,
        velocities=np.zeros((1, len(names), 3)),
        angular_velocities=np.zeros((1, len(names), 3)),
        active=np.ones((1, len(names)), dtype=bool),
        deformables={name: PointMotion(nodes[None], np.zeros((1, *nodes.shape))) for name, nodes in points.items()},
    )
