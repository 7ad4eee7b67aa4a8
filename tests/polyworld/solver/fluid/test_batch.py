"""Worlds of a batch do not feel each other, and equal inputs give equal bytes."""

from __future__ import annotations

import numpy as np

from polyworld.world import World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box
from tests.polyworld.solver.fluid.scenes import Run, plane_world, pool


def _world(**parameters: float) -> World:
    raft = RigidObject(
        name="raft",
        representation="rigid_planar",
        shape=Box(half_extents=(0.06, 0.05, 0.04)),
        density=500.0,
        position=(0.4, 0.0, 0.3),
    )
    oil = pool("oil", (0.3, 0), (0.6, 0.1), density=800.0)
    water = pool("water", (0, 0), (0.2, 0.3), **parameters)
    return plane_world(water, oil, size=(0.6, 0.5), cell=0.03, objects=(raft,))


def test_world_with_a_lost_particle_stops_and_says_which() -> None:
    run = Run(_world(), n_worlds=2)
    run.run(0.01)
    run.fluid.records.particles.v.numpy()[1, 7] = np.nan
    run.run(0.01)
    assert run.fluid.diverged.numpy().tolist() == [-1, 7]
    x, _, _ = run.fluid.particles()
    assert np.isfinite(x[0][run.fluid.particles()[2][0] >= 0]).all()
