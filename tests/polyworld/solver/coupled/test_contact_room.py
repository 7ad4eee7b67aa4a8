"""Contacts of deformable objects beyond the room at first: the search is done again, and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.model import model_of
from polyworld.solver.core import episodes
from polyworld.solver.coupled import contact, surface
from polyworld.solver.coupled.simulator import CoupledSimulator
from polyworld.solver.spatial import buffers as spatial_buffers
from polyworld.trajectory import BatchTrajectory
from polyworld.world import StaticObject, World
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Sphere, TriangleMesh
from tests.verification.coupled_world import FLOOR, VACUUM, sheet
from tests.verification.spatial_world import body

TIMES = np.linspace(0.0, 0.12, 5)
HEIGHTS = np.array([0.0, 0.3])  # of the upper sheet's start above where it is described: of the second, it never lands


def sheets() -> World:
    """A sheet that falls on another, which lies on the floor."""
    lower = sheet("lower", (0, 0, 0.01), 0.4, 0.4, (6, 6))
    upper = sheet("upper", (0.1, 0.1, 0.05), 0.3, 0.3, (5, 5))
    return World(deformables=(lower, upper), statics=(FLOOR,), environment=VACUUM)


def run(world: World, heights: np.ndarray, threads: int = 1) -> BatchTrajectory:
    machine = CoupledSimulator(model_of(world), TIMES, n_worlds=len(heights), record_events=True, threads=threads)
    return machine.run({"objects.upper.shift.z": heights})


def bytes_of(batch: BatchTrajectory, w: int) -> list[bytes]:
    return [m.points[w].tobytes() + m.velocities[w].tobytes() for m in batch.deformables.values()]


def test_contacts_beyond_the_room_at_first_give_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    world = sheets()
    large = run(world, HEIGHTS)
    assert len(large.events[0]) > len(large.events[1]) > 0
    monkeypatch.setattr(contact, "room_at_first", lambda *_: 16)
    monkeypatch.setattr(contact, "MOST_ROOM", 100)
    monkeypatch.setattr(surface, "ROOM", 1)
    monkeypatch.setattr(episodes, "EPISODES", 1)
    monkeypatch.setattr(episodes, "FEWEST_EPISODES", 1)
    small = run(world, HEIGHTS)
    assert not small.truncated
    for w in range(2):
        assert bytes_of(small, w) == bytes_of(large, w)
    assert small.events == large.events
    apart = run(world, HEIGHTS, threads=2)
    assert bytes_of(apart, 0) == bytes_of(large, 0)


def test_a_world_with_too_many_contacts_is_truncated_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lower sheet needs room for its 49 nodes on the floor, and no more while nothing lands on it."""
    world = sheets()
    large = run(world, HEIGHTS)
    monkeypatch.setattr(contact, "room_at_first", lambda *_: 64)
    monkeypatch.setattr(contact, "MOST_ROOM", 1)
    monkeypatch.setattr(surface, "ROOM", 400)
    small = run(world, HEIGHTS)
    assert set(small.truncated) == {0}
    assert bytes_of(small, 1) == bytes_of(large, 1)
    end = small.truncated[0]
    assert 0.02 < end.time < 0.12
    assert "more than 64 contacts of deformable objects" in end.reason
    reached = end.time > TIMES
    for name, motion in small.deformables.items():
        kept = large.deformables[name].points[0]
        assert motion.points[0, reached].tobytes() == kept[reached].tobytes()
        assert np.isnan(motion.points[0, ~reached]).all()


def test_rigid_contacts_beyond_the_room_begin_the_run_again(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (100, 3))
    heap = TriangleMesh(vertices=tuple(map(tuple, points.tolist())), faces=tuple((k, k + 1, k + 2) for k in range(97)))
    rope = Rope(name="upper", points=((2, 0, 1), (2.3, 0, 1)), radius=0.01, segments=4, linear_density=0.1)
    world = World(
        objects=(body("ball", Sphere(radius=0.5), (0, 0, 0.4)),),
        statics=(StaticObject(name="heap", shape=heap),),
        deformables=(rope,),
        environment=VACUUM,
    )
    small = run(world, HEIGHTS)
    monkeypatch.setattr(spatial_buffers, "MESH_TRIANGLES", 100)
    large = run(world, HEIGHTS)
    assert small.positions.tobytes() == large.positions.tobytes()
    assert small.events == large.events
    monkeypatch.setattr(spatial_buffers, "MESH_TRIANGLES", 24)
    monkeypatch.setattr(spatial_buffers, "MOST_BYTES", 0)
    ended = run(world, HEIGHTS)
    assert set(ended.truncated) == {0, 1}
    assert "rigid objects" in ended.truncated[0].reason
    assert ended.positions[0, 0].tobytes() == large.positions[0, 0].tobytes()
