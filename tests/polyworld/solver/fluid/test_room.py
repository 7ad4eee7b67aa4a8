"""Fluids with less room than they need, for covered faces and for what an emitter sends, and with a lost particle."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.solver.fluid import solver, storage
from polyworld.solver.rollout import rollout
from polyworld.world import World
from polyworld.world.representations.fluid import Emitter
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box
from tests.polyworld.solver.fluid.scenes import Run, plane_world, pool


def _world(*emitters: Emitter) -> World:
    raft = RigidObject(
        name="raft",
        representation="rigid_planar",
        shape=Box(half_extents=(0.06, 0.05, 0.04)),
        density=500.0,
        position=(0.3, 0.0, 0.12),
    )
    water = pool("water", (0, 0), (0.6, 0.12))
    return plane_world(water, size=(0.6, 0.4), cell=0.03, objects=(raft,), emitters=emitters)


def test_more_covered_faces_than_room_begin_the_run_again(monkeypatch: pytest.MonkeyPatch) -> None:
    world = _world()
    large = rollout(world, 0.1)
    monkeypatch.setattr(storage, "faces_at_first", lambda *_: 2)
    small = rollout(world, 0.1)
    assert small.trajectory.positions.tobytes() == large.trajectory.positions.tobytes()
    ours, theirs = small.trajectory.deformables["water"], large.trajectory.deformables["water"]
    assert ours.points.tobytes() == theirs.points.tobytes()


def test_an_emitter_without_room_ends_its_world_with_the_motion_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    tap = Emitter(name="tap", fluid="water", position=(0.1, 0, 0.35), direction=(0, 0, -1), radius=0.03, rate=0.1)
    world = _world(tap)
    whole = rollout(world, 0.2)
    needed = solver.particles_needed
    monkeypatch.setattr(solver, "particles_needed", lambda *given: needed(*given) - 50)
    ended = rollout(world, 0.2)
    assert whole.status == "completed"
    assert ended.status == "truncated"
    assert ended.truncated is not None
    assert "lower the emitters' rates" in ended.truncated.reason
    count = len(ended.trajectory.times)
    assert 1 < count < len(whole.trajectory.times)
    assert np.array_equal(ended.trajectory.positions[:, 0], whole.trajectory.positions[:count, 0])


def test_world_with_a_lost_particle_stops_and_says_which() -> None:
    run = Run(_world(), n_worlds=2)
    run.run(0.01)
    run.fluid.records.particles.v.numpy()[1, 7] = np.nan
    run.run(0.01)
    assert run.fluid.diverged.numpy().tolist() == [-1, 7]
    x, _, fluid = run.fluid.particles()
    assert np.isfinite(x[0][fluid[0] >= 0]).all()
