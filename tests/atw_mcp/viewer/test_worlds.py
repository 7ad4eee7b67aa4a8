"""Worlds as the page gets them: shapes of the right size, lines of ropes round their wheels, fields of effects."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from pydantic import BaseModel

from atw_mcp.viewer import parts, world_parts
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.rollouts import rollout_view
from atw_mcp.viewer.shapes import shape_view
from atw_mcp.viewer.worlds import world_view
from polyworld.model import mesh_of
from polyworld.trajectory import PointMotion, Rollout, Trajectory
from polyworld.world import Effect, World, geometry
from polyworld.world.shapes import Box, Compound, ConvexMesh, Cylinder, Part, Plane, Sphere, TriangleMesh, Wall
from tests.atw_mcp.viewer import scenes


class Seen:
    """A world and its start as a rollout of so many samples."""

    def __init__(self, world: World, samples: int = 1, **options: Any) -> None:
        self.blocks = Blocks()
        self.result = at_rest(world, samples)
        colors = dict.fromkeys(world.moving_names, "#000000")
        run = self.result.trajectory
        about = {"label": "", "origin": "built", "parent": None, "committed": False}
        self.world = world_view(world, self.blocks, colors, runs=[run], **about)
        self.rollout = rollout_view("rollout-1", world, self.result, self.blocks, label="", **options)

    def __call__(self, block: parts.Block | None) -> NDArray[Any]:
        assert block is not None
        kind, count = np.dtype(block.dtype), int(np.prod(block.shape))
        return np.frombuffer(self.blocks.joined(), kind, count, block.offset).reshape(block.shape)

    def moving(self, name: str) -> world_parts.Moving:
        return next(m for m in self.world.moving if m.name == name)

    def part(self, name: str) -> Any:
        parts = [*self.world.joints, *self.world.regions, *self.world.effects]
        return next(p for p in parts if p.name == name)


def at_rest(world: World, samples: int) -> Rollout:
    """All objects where they start, at every sample."""
    places, soft = [np.asarray(o.position, dtype=float) for o in world.objects], world.deformables
    places += [nodes.mean(axis=0) if len(nodes := mesh_of(world, d).nodes) else np.full(3, np.nan) for d in soft]
    turns = [*(o.orientation for o in world.objects), *([(1.0, 0.0, 0.0, 0.0)] * len(world.deformables))]
    shape = (samples, len(places), 3)

    def still(name: str) -> PointMotion:
        nodes = mesh_of(world, world.deformable(name)).nodes
        return PointMotion(np.repeat(nodes[None], samples, axis=0), np.zeros((samples, *nodes.shape)))

    run = Trajectory(
        names=world.moving_names,
        times=np.arange(samples) * 0.02,
        positions=np.broadcast_to(places, shape),
        orientations=np.broadcast_to(turns, (*shape[:2], 4)),
        velocities=np.zeros(shape),
        angular_velocities=np.zeros(shape),
        active=np.ones(shape[:2], dtype=bool),
        deformables={d.name: still(d.name) for d in world.deformables},
    )
    return Rollout(world.id, float(run.times[-1]), run, ())


@pytest.mark.parametrize(
    "shape",
    [
        ConvexMesh(vertices=((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0.3))),
        Compound(
            parts=(
                Part(shape=Box(half_extents=(0.1, 0.2, 0.3)), position=(0.5, 0, 0)),
                Part(shape=Box(half_extents=(0.1, 0.1, 0.1)), position=(-0.5, 0, 0), orientation=(0.8, 0.6, 0, 0)),
            )
        ),
    ],
)
def test_a_mesh_has_the_volume_and_the_centre_of_its_body(shape: ConvexMesh | Compound) -> None:
    blocks = Blocks()
    found = shape_view(shape, blocks)
    assert isinstance(found, parts.Mesh)
    solid = mesh(found, blocks)
    assert_allclose(solid.volume, geometry.mass_properties(shape).volume, rtol=1e-5)  # outward: else it is negative
    assert_allclose(solid.center_mass, 0.0, atol=1e-5)


def test_statics_are_where_they_stand() -> None:
    blocks = Blocks()
    wall = shape_view(Wall(start=(1, 0, 0), end=(1, 2, 0), height=0.5, thickness=0.1), blocks)
    assert isinstance(wall, parts.Mesh)
    assert_allclose(mesh(wall, blocks).bounds, [[0.95, 0, 0], [1.05, 2, 0.5]], atol=1e-6)
    ground = TriangleMesh(vertices=((0, 0, 0), (1, 0, 0), (0, 1, 0)), faces=((0, 1, 2),))
    assert isinstance(shape_view(ground, blocks), parts.Mesh)
    assert shape_view(Plane(normal=(0, 0, 2.0), offset=0.3), blocks) == parts.Plane(normal=[0, 0, 1], offset=0.3)
    simple: list[tuple[Any, BaseModel]] = [
        (Sphere(radius=0.2), parts.Sphere(radius=0.2)),
        (Cylinder(radius=0.2, half_height=0.1), parts.Cylinder(radius=0.2, half_height=0.1)),
    ]
    assert all(shape_view(shape, blocks) == expected for shape, expected in simple)


def mesh(shape: parts.Mesh, blocks: Blocks) -> trimesh.Trimesh:
    whole = blocks.joined()
    vertices = np.frombuffer(whole, "<f4", 3 * shape.vertices.shape[0], shape.vertices.offset).reshape(-1, 3)
    triangles = np.frombuffer(whole, "<i4", 3 * shape.triangles.shape[0], shape.triangles.offset).reshape(-1, 3)
    return trimesh.Trimesh(vertices, triangles)


def test_a_rope_runs_round_its_wheel_and_is_held_by_its_ends() -> None:
    seen = Seen(scenes.rope().world, samples=2)
    rope = seen.moving("rope")
    points, segments = seen(seen.rollout.deformed[0].points), seen(rope.segments)
    assert points.shape == (2, len(segments) + 1, 3)
    assert rope.radius == 0.006
    middles = points[0][segments].mean(axis=1)
    distance = np.hypot(middles[:, 0], middles[:, 2])
    wheel = seen.part("wheel")
    assert (wheel.kind, wheel.radius, wheel.other) == ("pulley", 0.1, None)
    assert distance.min() > 0.97 * 0.1  # it goes round, not through
    assert [seen.part(name).held for name in ("left", "right")] == [[0], [len(segments)]]


def test_deformables_have_the_elements_of_their_meshes() -> None:
    cloth = Seen(scenes.cloth().world)
    triangles = seen_triangles(cloth, "sheet")
    assert_allclose(triangles.area, 0.64, rtol=1e-6)
    assert cloth.part("corner_3").held == [288]
    jelly = Seen(scenes.soft().world)
    assert_allclose(seen_triangles(jelly, "jelly").volume, 0.2**3, rtol=1e-5)  # closed and outward


def seen_triangles(seen: Seen, name: str) -> trimesh.Trimesh:
    points = next(d.points for d in seen.rollout.deformed if d.name == name)
    return trimesh.Trimesh(seen(points)[0], seen(seen.moving(name).triangles), process=False)


def test_a_fluid_has_particles_of_its_volume_and_its_boxes() -> None:
    seen = Seen(scenes.fluid().world)
    water = seen.moving("water")
    assert water.radius == 0.05 / 4
    assert (water.segments, water.triangles) == (None, None)
    assert [(r.name, r.kind) for r in seen.world.regions] == [
        ("fluid_grid", "closed fluid grid"),
        ("right_end", "container"),
    ]
    volume = next(q for q in seen.rollout.quantities if q.name == "volume")
    assert_allclose(seen(volume.values), 0.3 * 0.3 * 0.35, rtol=0.02)


def test_joints_have_their_axes_and_springs_both_ends() -> None:
    seen = Seen(scenes.joints().world)
    elbow, rail, spring = (seen.part(name) for name in ("elbow", "rail", "spring"))
    assert (elbow.kind, elbow.object, elbow.other, elbow.axis) == ("hinge", "lower_arm", "upper_arm", [0, 1, 0])
    assert (rail.axis, rail.other) == ([1, 0, 0], None)
    assert (spring.anchor, spring.other_anchor) == ([-0.32, 0.3, 0.5], [0.5, 0.3, 0.5])


def test_fields_of_effects_are_the_laws_on_a_grid_around_the_objects() -> None:
    world = scenes.joints().world
    seen = Seen(world)
    field = seen.part("breeze").field
    assert (field.unit, field.uniform) == ("m/s^2", False)
    points, vectors = seen(field.points).astype(float), seen(field.vectors)
    fall = np.exp(-((points - [0, 0, 0.6]) ** 2).sum(axis=1) / (2 * 0.4**2))
    assert_allclose(vectors[:, 0], 1.5 * fall / 0.3, rtol=1e-4, atol=1e-6)  # of the first object, 0.3 kg
    places = np.array([o.position for o in world.objects])
    assert (points.min(axis=0) <= places.min(axis=0)).all()
    assert (points.max(axis=0) >= places.max(axis=0)).all()
    (push,) = seen.rollout.pushes
    expected = 1.5 * np.exp(-(((places - [0, 0, 0.6]) ** 2).sum(axis=1)) / (2 * 0.4**2)) / [0.3, 0.3, 0.5, 0.4, 0.6]
    assert_allclose(seen(push.accelerations)[0, :, 0], expected, rtol=1e-5)


def test_a_planar_world_shows_fields_in_its_plane_and_friction_patches() -> None:
    seen = Seen(scenes.discs().world)
    magnet, rough = seen.part("magnet").field, seen.part("rough").field
    assert np.ptp(seen(magnet.points)[:, 2]) < 1e-6
    inside = np.hypot(*(seen(rough.points)[:, :2] - [0.8, 0.2]).T) < 0.29
    assert_allclose(seen(rough.vectors)[inside, 2], 0.5, rtol=1e-6)
    assert rough.unit == "1"
    assert [p.effect for p in seen.rollout.pushes] == ["magnet"]


def test_a_field_is_not_shown_where_nothing_has_a_place_yet() -> None:
    push = Effect(name="push", kind="uniform_acceleration", parameters={"x": 1.0})
    seen = Seen(scenes.tap().world.model_copy(update={"effects": (push,)}))
    assert seen.part("push").field is None
    assert seen.part("tap").kind == "emitter"


def test_long_rollouts_are_thinned_out_and_say_so() -> None:
    seen = Seen(scenes.discs().world, samples=1001, most_numbers=8000)
    times = seen(seen.rollout.times)
    assert 50 < len(times) < 110
    assert_allclose(times[[0, -1]], [0.0, 20.0])
    step = round(float(times[1]) / 0.02)
    assert f"every {step}th of 1001 samples" in seen.rollout.sampled
    assert seen(seen.rollout.positions).shape[0] == len(times)
