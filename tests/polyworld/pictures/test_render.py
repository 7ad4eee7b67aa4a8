"""Pictures against analytic silhouettes and depths."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from polyworld.pictures.render import Picture, default_camera, look_at, render
from polyworld.world import MotionPlane, StaticObject, World
from polyworld.world.camera import Camera
from polyworld.world.colors import rgb
from polyworld.world.description import Appearance
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Plane, Sphere, TriangleMesh, Wall

Array = NDArray[np.float64]

CAMERA = look_at(np.array([1.5, -4.0, 2.5]), np.array([0.1, 0.2, 0.3]), focal=420.0, width=320, height=240)
TURN = np.array([0.8, 0.3, -0.4, 0.2]) / np.linalg.norm([0.8, 0.3, -0.4, 0.2])
POINT = np.array([0.25, 0.15, 0.45])


def draw(shape: Sphere | Box | Cylinder | Capsule | ConvexMesh, camera: Camera = CAMERA) -> Picture:
    world = World(objects=(RigidObject(name="it", shape=shape, position=(0.0, 0.0, 0.0)),))
    return render(world, POINT[None], TURN[None], camera)


def pixel_grid(camera: Camera) -> Array:
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.stack([u, v], axis=-1).astype(float)


def margin_to_hull(points: Array, camera: Camera) -> Array:
    """Signed distance [px] of every pixel from the convex hull of projected points, negative inside."""
    hull = ConvexHull(camera.project(points))
    return np.max(pixel_grid(camera) @ hull.equations[:, :2].T + hull.equations[:, 2], axis=-1)


def placed(points: Array) -> Array:
    return points @ quaternion_matrix(TURN).T + POINT


def test_silhouette_of_a_sphere_is_the_cone_of_rays_that_touch_it() -> None:
    radius = 0.4
    picture = draw(Sphere(radius=radius))
    to_centre = POINT - CAMERA.centre
    distance = np.linalg.norm(to_centre)
    cosine = CAMERA.rays(pixel_grid(CAMERA)) @ to_centre / distance
    limit = np.sqrt(1.0 - (radius / distance) ** 2)
    clear = np.abs(cosine - limit) > 1e-6  # float32 decides the rest
    assert clear.mean() > 0.999
    assert np.array_equal((picture.labels == 0)[clear], (cosine > limit)[clear])


def test_sphere_is_as_deep_as_its_nearest_point() -> None:
    picture = draw(Sphere(radius=0.4))
    column, row = np.rint(CAMERA.project(POINT)).astype(int)
    ray = CAMERA.rays(np.array([column, row], dtype=float))
    to_centre = POINT - CAMERA.centre
    along = ray @ to_centre
    hit = along - np.sqrt(0.4**2 - (to_centre @ to_centre - along**2))
    assert picture.depth[row, column] == pytest.approx(CAMERA.to_camera(CAMERA.centre + hit * ray)[2], abs=1e-5)


def cylinder_rims(radius: float, half_height: float) -> Array:
    angle = np.linspace(0.0, 2 * np.pi, 721)[:-1]
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros_like(angle)], axis=1)
    lift = np.array([0.0, 0.0, half_height])
    return np.concatenate([ring - lift, ring + lift])


def capsule_points(radius: float, half_height: float) -> Array:
    ball = np.asarray(trimesh.creation.icosphere(subdivisions=5, radius=radius).vertices)
    lift = np.array([0.0, 0.0, half_height])
    return np.concatenate([ball - lift, ball + lift])


CORNERS = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float)
CLOUD = np.random.default_rng(7).normal(size=(30, 3)) * 0.2
HULL_CENTRE = trimesh.convex.convex_hull(CLOUD).center_mass


@pytest.mark.parametrize(
    ("shape", "points"),
    [
        (Box(half_extents=(0.3, 0.2, 0.45)), CORNERS * [0.3, 0.2, 0.45]),
        (Cylinder(radius=0.3, half_height=0.2), cylinder_rims(0.3, 0.2)),
        (Capsule(radius=0.15, half_height=0.3), capsule_points(0.15, 0.3)),
        (ConvexMesh(vertices=tuple(tuple(p) for p in CLOUD.tolist())), CLOUD - HULL_CENTRE),
    ],
    ids=["box", "cylinder", "capsule", "convex_mesh"],
)
def test_silhouette_of_a_convex_body_is_the_hull_of_its_projected_points(
    shape: Box | Cylinder | Capsule | ConvexMesh, points: Array
) -> None:
    picture = draw(shape)
    margin = margin_to_hull(placed(points), CAMERA)
    clear = np.abs(margin) > 0.05  # the sampled rims are that close to the true outline
    assert (margin < 0).sum() > 1000
    assert np.array_equal((picture.labels == 0)[clear], (margin < 0)[clear])


def test_plane_is_seen_where_the_rays_meet_it_and_nowhere_above_the_horizon() -> None:
    floor = StaticObject(name="floor", shape=Plane(normal=(0.1, -0.2, 1.0), offset=-0.3))
    picture = render(World(statics=(floor,)), np.zeros((0, 3)), np.zeros((0, 4)), CAMERA)
    normal = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
    points = CAMERA.onto_plane(pixel_grid(CAMERA), -0.3 * normal, normal)
    depth = CAMERA.to_camera(points)[..., 2]
    near = np.isfinite(depth) & (depth < 50.0)
    assert np.all(picture.labels[near] == 0)
    assert np.allclose(picture.depth[near], depth[near], rtol=1e-4)
    tilted_up = look_at(np.array([0.0, 0.0, 1.0]), np.array([0.0, -5.0, 2.0]), focal=420.0, width=64, height=48)
    sky = render(
        World(statics=(StaticObject(name="floor", shape=Plane()),)), np.zeros((0, 3)), np.zeros((0, 4)), tilted_up
    )
    rays = tilted_up.rays(pixel_grid(tilted_up))
    assert np.array_equal(sky.labels == 0, rays[..., 2] < -1e-9)
    assert np.all(np.isinf(sky.depth[sky.labels < 0]))


def test_wall_stands_between_its_ends() -> None:
    wall = StaticObject(name="wall", shape=Wall(start=(-0.5, 0.3, 0.0), end=(0.7, 0.3, 0.0), height=0.6, thickness=0.1))
    picture = render(World(statics=(wall,)), np.zeros((0, 3)), np.zeros((0, 4)), CAMERA)
    corners = np.array([[x, y, z] for x in (-0.5, 0.7) for y in (0.25, 0.35) for z in (0.0, 0.6)])
    margin = margin_to_hull(corners, CAMERA)
    clear = np.abs(margin) > 0.01
    assert np.array_equal((picture.labels == 0)[clear], (margin < 0)[clear])


def test_triangle_mesh_of_a_box_looks_like_the_box() -> None:
    solid = trimesh.creation.box(extents=(0.6, 0.4, 0.9))
    solid.apply_transform(trimesh.transformations.quaternion_matrix(TURN))
    solid.apply_translation(POINT)
    mesh = TriangleMesh(
        vertices=tuple(map(tuple, solid.vertices.tolist())), faces=tuple(map(tuple, solid.faces.tolist()))
    )
    as_mesh = render(World(statics=(StaticObject(name="it", shape=mesh),)), np.zeros((0, 3)), np.zeros((0, 4)), CAMERA)
    as_box = draw(Box(half_extents=(0.3, 0.2, 0.45)))
    assert (as_mesh.labels != as_box.labels).mean() < 1e-4
    both = (as_mesh.labels == 0) & (as_box.labels == 0)
    assert np.allclose(as_mesh.depth[both], as_box.depth[both], atol=1e-4)


def two_balls() -> World:
    return World(
        objects=(
            RigidObject(name="near", shape=Sphere(radius=0.2), appearance=Appearance(color="red"), position=(0, 0, 0)),
            RigidObject(name="far", shape=Sphere(radius=0.4), appearance=Appearance(color="blue"), position=(0, 0, 0)),
        ),
        statics=(StaticObject(name="floor", shape=Plane()),),
    )


def test_nearer_object_hides_the_farther_one() -> None:
    ray = CAMERA.rays(np.array([160.0, 120.0]))
    positions = CAMERA.centre + np.array([[2.0], [4.0]]) * ray
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    picture = render(two_balls(), positions, identity, CAMERA)
    assert picture.labels[120, 160] == 0
    red, green, blue = picture.color[120, 160]
    assert red > green
    assert red > blue
    without = render(two_balls(), positions, identity, CAMERA, visible=[False, True])
    assert without.labels[120, 160] == 1
    assert not without.mask(0).any()


def test_planar_world_is_drawn_on_the_plane_it_slides_on() -> None:
    body = RigidObject(name="disc", representation="rigid_planar", shape=Sphere(radius=0.2), position=(0, 0, 0.7))
    plane = MotionPlane(point=(0.0, 0.0, 0.5))
    world = World(objects=(body,), environment=World().environment.model_copy(update={"motion_plane": plane}))
    picture = render(world, np.array([[0.0, 0.0, 0.7]]), np.array([[1.0, 0, 0, 0]]), CAMERA)
    points = CAMERA.onto_plane(pixel_grid(CAMERA), np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.0, 1.0]))
    depth = CAMERA.to_camera(points)[..., 2]
    floor = picture.labels == 1
    assert floor.mean() > 0.3
    assert np.allclose(picture.depth[floor], depth[floor], rtol=1e-3)
    hanging = plane.model_copy(update={"supports": False})
    free = World(objects=(body,), environment=World().environment.model_copy(update={"motion_plane": hanging}))
    assert not render(free, np.array([[0.0, 0.0, 0.7]]), np.array([[1.0, 0, 0, 0]]), CAMERA).mask(1).any()


def test_object_without_a_position_is_not_drawn() -> None:
    positions = np.array([[np.nan, 0.0, 0.2], [1.0, 0.0, 0.4]])
    picture = render(two_balls(), positions, np.tile([1.0, 0, 0, 0], (2, 1)), CAMERA)
    assert not picture.mask(0).any()
    assert picture.mask(1).any()


def test_arrays_of_another_world_are_refused() -> None:
    with pytest.raises(ValueError, match=r"2 objects: positions must be \(2, 3\)"):
        render(two_balls(), np.zeros((3, 3)), np.zeros((3, 4)), CAMERA)


def test_default_camera_sees_every_position() -> None:
    positions = np.random.default_rng(1).uniform(-3, 3, size=(50, 2, 3))
    camera = default_camera(two_balls(), positions)
    assert camera.sees(positions).all()
    column, row = camera.project((positions.reshape(-1, 3).min(axis=0) + positions.reshape(-1, 3).max(axis=0)) / 2)
    assert column == pytest.approx((camera.width - 1) / 2)
    assert row == pytest.approx((camera.height - 1) / 2)


@pytest.mark.parametrize(
    ("text", "expected"), [("#0a141e", (10, 20, 30)), ("Dark Red", rgb("red")), ("rubber", None), ("grey", rgb("gray"))]
)
def test_colour_names(text: str, expected: tuple[int, int, int] | None) -> None:
    assert rgb(text) == expected
