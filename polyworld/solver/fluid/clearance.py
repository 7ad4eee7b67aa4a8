"""Distances of points from a world's solids at the start."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.solver.fluid.covering import distances
from polyworld.solver.fluid.scene import build_solids
from polyworld.world import World, geometry

Array = NDArray[np.float64]


def clearance(world: World, points: Array) -> Array:
    """Distance (k,) of points (k, 3) from statics and from rigid objects that are there at time 0 [m]."""
    if len(points) == 0 or not (world.statics or world.objects):
        return np.full(len(points), np.inf)
    solids, _meshes = build_solids(world)
    objects = world.objects
    present = np.array([o.start_time == 0.0 for o in objects] or [False], dtype=np.int32)
    position = np.array([o.position for o in objects] or [(0.0, 0.0, 0.0)], dtype=float)
    orientations = np.array([o.orientation for o in objects] or [(1.0, 0.0, 0.0, 0.0)], dtype=float)
    out = wp.zeros(len(points), dtype=wp.float64, device="cpu")
    wp.launch(
        distances,
        dim=len(points),
        inputs=[
            solids,
            wp.array(present, dtype=wp.int32, device="cpu"),
            wp.array(position, dtype=wp.vec3d, device="cpu"),
            wp.array(geometry.quaternion_matrix(orientations), dtype=wp.mat33d, device="cpu"),
            wp.array(np.ascontiguousarray(points), dtype=wp.vec3d, device="cpu"),
            out,
        ],
        device="cpu",
    )
    result: Array = out.numpy()
    return result
