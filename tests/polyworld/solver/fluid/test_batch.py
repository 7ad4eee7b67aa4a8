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


def _final(run: Run) -> list[bytes]:
    x, v, fluid = run.fluid.particles()
    bodies = run.bodies.numpy()
    return [
        x[w].tobytes() + v[w].tobytes() + fluid[w].tobytes() + bodies["x"][w].tobytes() + bodies["w"][w].tobytes()
        for w in range(len(x))
    ]


def test_worlds_of_a_batch_equal_single_runs_to_the_bit() -> None:
    values = {"density": (1000.0, 1400.0), "viscosity": (0.001, 5.0), "surface_tension": (0.0, 2.0)}
    batch = Run(_world(), n_worlds=2)
    batch.fluid.write({"water": {name: np.array(pair) for name, pair in values.items()}})
    batch.fluid.reset()
    batch.run(0.3)
    together = _final(batch)
    for w in range(2):
        # Both worlds have tension arrays in the batch: zero tension in one must be as good as none.
        alone = Run(_world(**{name: pair[w] for name, pair in values.items()}))
        alone.run(0.3)
        assert _final(alone)[0] == together[w]
    assert together[0] != together[1]


def test_reset_starts_again_from_the_same_bytes() -> None:
    run = Run(_world())
    start = run.bodies.numpy().copy()
    run.run(0.1)
    first = _final(run)
    run.fluid.reset()
    run.bodies.numpy()[:] = start
    run.time = 0.0
    run.run(0.1)
    assert _final(run) == first


def test_world_with_a_lost_particle_stops_and_says_which() -> None:
    run = Run(_world(), n_worlds=2)
    run.run(0.01)
    run.fluid.records.particles.v.numpy()[1, 7] = np.nan
    run.run(0.01)
    assert run.fluid.diverged.numpy().tolist() == [-1, 7]
    x, _, _ = run.fluid.particles()
    assert np.isfinite(x[0][run.fluid.particles()[2][0] >= 0]).all()
