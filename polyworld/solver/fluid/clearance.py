"""Distances of points from a world's solids at the start."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.fluid.covering import distances
from polyworld.solver.fluid.scene import build_solids
from polyworld.world import World, geometry

Array = NDArray[np.float64]


def clearance(world: World, points: Array) -> Array:
    """Distance (k,) of points (k, 3) from statics and from rigid objects that are there at time 0 [m]."""
    if len(points) == 0 or not (world.statics or world.objects):
        return np.full(len(points), np.inf)
    with buffers.on_cpu():  # a world has the same particles on every device
        solids, _meshes = build_solids(world)
        objects = world.objects
        present = np.array([o.start_time == 0.0 for o in objects] or [False], dtype=np.int32)
        position = np.array([o.position for o in objects] or [(0.0, 0.0, 0.0)], dtype=float)
        orientations = np.array([o.orientation for o in objects] or [(1.0, 0.0, 0.0, 0.0)], dtype=float)
        out = buffers.zeros(len(points), wp.float64)
        buffers.launch(
            distances,
            len(points),
            [
                solids,
                buffers.array(present, wp.int32),
                buffers.array(position, wp.vec3d),
                buffers.array(geometry.quaternion_matrix(orientations), wp.mat33d),
                buffers.array(np.ascontiguousarray(points), wp.vec3d),
                out,
            ],
        )
        result: Array = buffers.read(out)
    return result
