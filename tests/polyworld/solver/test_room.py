"""Buffers that are too small at first: they grow, change nothing, and end no other world of the batch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld.model import model_of
from polyworld.probing.compare import compare
from polyworld.probing.predicates import Collides, InContact, WithinDistance
from polyworld.probing.query import query
from polyworld.solver.core import episodes
from polyworld.solver.planar import simulator as planar_simulator
from polyworld.solver.rollout import rollout, rollouts, simulator
from polyworld.solver.spatial import buffers as spatial_buffers
from polyworld.solver.spatial.simulator import SpatialSimulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import StaticObject, World
from polyworld.world.shapes import Plane, Sphere, TriangleMesh
from tests.scenes.six_bodies import six_body_world
from tests.verification.planar_scenes import body as planar_body
from tests.verification.planar_scenes import disc, side_view
from tests.verification.spatial_world import body, make_world


def pile(count: int) -> World:
    """Spheres of restitution 0.9 that fall, two beside two, into a box of 30 cm."""
    rng = np.random.default_rng(0)
    radius, wall = 0.02, 0.15
    balls = []
    for k in range(count):
        place = np.array([0.044 * (k % 2), 0.044 * (k // 2 % 2), 0.07 + 0.046 * (k // 4)])
        place += rng.uniform(-0.01, 0.01, 3)
        balls.append(body(f"ball{k}", Sphere(radius=radius), place, restitution=0.9, friction=0.3))
    sides = {"left": (1.0, 0.0), "right": (-1.0, 0.0), "front": (0.0, 1.0), "back": (0.0, -1.0)}
    walls = [
        StaticObject(name=name, shape=Plane(normal=(x, y, 0.0)), position=(-wall * x, -wall * y, 0.0), restitution=0.9)
        for name, (x, y) in sides.items()
    ]
    floor = StaticObject(name="floor", shape=Plane(), restitution=0.9)
    return make_world(*balls, statics=(floor, *walls))


def crumbs() -> World:
    """A ball above 397 triangles in a heap smaller than itself."""
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (400, 3))
    heap = TriangleMesh(vertices=tuple(map(tuple, points.tolist())), faces=tuple((k, k + 1, k + 2) for k in range(397)))
    return make_world(body("b", Sphere(radius=0.5), (0, 0, 2.0)), statics=(StaticObject(name="heap", shape=heap),))


def same(one: BatchTrajectory, a: int, other: BatchTrajectory, b: int) -> bool:
    """Whether world a of one batch and world b of another have the same motion, to the bit."""
    names = ("positions", "orientations", "velocities", "angular_velocities")
    return all(getattr(one, n)[a].tobytes() == getattr(other, n)[b].tobytes() for n in names)


def test_a_bouncing_pile_of_fifty_has_its_motion_and_all_its_contacts() -> None:
    """Energy falls to the heap's, nothing leaves the shaft, and more contacts begin than a world has room for."""
    world = pile(50)
    times = np.linspace(0.0, 2.0, 41)
    small = SpatialSimulator(model_of(world), times, record_events=True, threads=1, episodes=64).run()
    begins = [e for e in small.events[0] if e.kind == "contact_begin"]
    assert len(begins) > 1024
    assert small.contacts_until == (None,)
    assert np.isfinite(small.positions).all()
    assert small.positions[..., 2].min() > 0.0199
    assert np.linalg.norm(small.velocities[0, -1], axis=-1).max() < 0.3
    large = SpatialSimulator(model_of(world), times, record_events=True, threads=1, episodes=10_000).run()
    assert small.events == large.events
    assert same(small, 0, large, 0)


def test_contacts_of_a_planar_pile_do_not_depend_on_the_room_at_first() -> None:
    balls = [planar_body(f"d{k}", disc(0.1), (0.05 * (k % 2), 0, 0.2 + 0.25 * k), restitution=0.9) for k in range(6)]
    world = side_view(*balls)
    times = np.linspace(0.0, 1.5, 31)
    small, large = (
        planar_simulator.PlanarSimulator(model_of(world), times, n_worlds=2, record_events=True, threads=1, episodes=n)
        for n in (2, 1000)
    )
    first, second = small.run(), large.run()
    assert len(first.events[0]) > 20
    assert first.events == second.events
    assert same(first, 1, second, 0)
    assert small.run().events == first.events


def test_a_world_with_more_contacts_than_room_leaves_the_others_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    world, times = crumbs(), np.linspace(0.0, 0.2, 6)
    height = np.array([2.0, 0.4, 1.5])
    batch = simulator(world, times, n_worlds=3, threads=1).run({"objects.b.position.z": height})
    assert not batch.truncated
    monkeypatch.setattr(spatial_buffers, "MESH_TRIANGLES", 400)
    for w in range(3):
        alone = simulator(world, times, threads=1).run({"objects.b.position.z": height[w : w + 1]})
        assert same(batch, w, alone, 0)


def test_a_world_that_no_memory_holds_is_truncated_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """It keeps its motion up to the heap, 0.5 m below it, and says why it has no more."""
    world = crumbs()
    monkeypatch.setattr(spatial_buffers, "MOST_BYTES", 0)
    falls = [w for z in (2.0, 1.0) for w in (world.model_copy(update={"objects": (_at(world, z),)}),)]
    high, low = rollouts(world, falls, {"objects.b.position.z": np.array([2.0, 1.0])}, 0.5, sample_interval=0.05)
    assert high.status == "completed"
    assert low.status == "truncated"
    assert low.truncated is not None
    assert low.truncated.time == pytest.approx(np.sqrt(2.0 * 0.45 / 9.81), abs=0.02)  # 5 cm of heap
    assert "mesh is too fine" in low.truncated.reason
    assert "truncated at 0.3" in str(low.why_ended())
    shown = low.trajectory.times
    assert 0.25 <= shown[-1] < low.truncated.time
    np.testing.assert_allclose(low.trajectory.positions[:, 0, 2], 1.0 - 0.5 * 9.81 * shown**2, atol=1e-9)


def _at(world: World, height: float) -> Any:
    return world.objects[0].model_copy(update={"position": (0.0, 0.0, height)})


def test_overlapping_discs_get_all_the_contact_rows_they_need(monkeypatch: pytest.MonkeyPatch) -> None:
    discs = [planar_body(f"d{k}", disc(0.3), (0.01 * k, 0, 1.0 + 0.005 * k)) for k in range(40)]
    world, times = side_view(*discs), np.array([0.0, 0.004])
    grown = planar_simulator.PlanarSimulator(model_of(world), times, threads=1)
    moved = grown.run()
    assert not moved.truncated
    assert grown._contacts.rows.shape[2] > 12 * 41 + 64
    monkeypatch.setattr(planar_simulator, "MOST_BYTES", 0)
    ended = simulator(world, times, threads=1).run()
    assert ended.truncated[0].time == 0.0
    assert np.isnan(ended.positions[0]).all()


def test_motion_without_events_is_the_same_and_says_that_it_has_none() -> None:
    world = six_body_world(planar=False)
    whole = rollout(world, 1.0)
    bare = rollout(world, 1.0, record_events=False)
    assert bare.trajectory.positions.tobytes() == whole.trajectory.positions.tobytes()
    assert whole.contacts_until is None
    assert whole.events
    assert (bare.events, bare.contacts_until) == ((), 0.0)
    a, b = world.objects[0].name, world.objects[1].name
    for predicate in (InContact(a=a, b=b), Collides(a=a, b=b)):
        assert query(whole, world, predicate).decided
        answer = query(bare, world, predicate)
        assert not answer.decided
        assert "record_events=False" in str(answer.reason)
    far = WithinDistance(a=a, b=b, distance=0.01)
    assert query(bare, world, far).value == query(whole, world, far).value
    with pytest.raises(ValueError, match="record_events=False"):
        compare(whole, bare)


def test_contacts_beyond_the_most_are_unknown_and_the_motion_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    ball = body("ball", Sphere(radius=0.1), (0, 0, 0.6), restitution=0.8)
    world = make_world(ball)
    whole = rollout(world, 2.0)
    begins = [e.time for e in whole.events if e.kind == "contact_begin"]
    assert len(begins) > 3
    monkeypatch.setattr(episodes, "MOST_EPISODES", 2)
    monkeypatch.setattr(episodes, "EPISODES", 1)
    monkeypatch.setattr(episodes, "FEWEST_EPISODES", 1)
    part = rollout(world, 2.0)
    assert part.trajectory.positions.tobytes() == whole.trajectory.positions.tobytes()
    assert part.contacts_until == begins[1]
    assert [e.time for e in part.events if e.kind == "contact_begin"] == begins[:2]
    touches = Collides(a="ball", b="floor")
    assert query(part, world, touches, (0.0, 0.5)).value is True
    late = query(part, world, touches, (begins[1] + 0.01, 2.0))
    assert "up to" in str(late.reason)
    assert not query(part, world, touches, aggregation="count").decided


def test_a_contact_begins_again_only_where_the_surfaces_have_parted() -> None:
    """By more than the gap that counts as touching, 1e-4 of the radius; until then they may bear nothing."""
    world, times = pile(30), np.arange(1501) * 0.002
    run = SpatialSimulator(model_of(world), times, record_events=True, threads=1).run()
    column = {name: k for k, name in enumerate(run.names)}
    ended: dict[tuple[str, ...], float] = {}
    again = 0
    for event in run.events[0]:
        pair = event.participants
        if event.kind == "contact_end":
            ended[pair] = event.time
        elif pair in ended and set(pair) <= set(column):
            between = (times >= ended[pair]) & (times <= event.time)
            a, b = (run.positions[0, between, column[name]] for name in pair)
            assert np.linalg.norm(a - b, axis=1).max() - 0.04 > 2e-6
            again += 1
    assert again > 50
