"""Pictures of ropes, cloth, soft bodies, fluids, compounds and pulleys against silhouettes worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from polyworld.pictures.render import Picture, default_camera, look_at, render
from polyworld.world import StaticObject, World
from polyworld.world.camera import Camera
from polyworld.world.description import Appearance
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.fluid import Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Pulley, Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Compound, Part, Sphere

Array = NDArray[np.float64]

CAMERA = look_at(np.array([1.5, -4.0, 2.5]), np.array([0.1, 0.2, 0.3]), focal=420.0, width=320, height=240)
IDENTITY = (1.0, 0.0, 0.0, 0.0)


def rays() -> Array:
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    return CAMERA.rays(np.stack([u, v], axis=-1).astype(float))


def draw(world: World, points: dict[str, Array] | None = None, camera: Camera = CAMERA) -> Picture:
    n = len(world.moving_names)
    positions = np.array([*(o.position for o in world.objects), *([(0.0, 0.0, 0.0)] * len(world.deformables))])
    return render(world, positions.reshape(n, 3), np.tile(IDENTITY, (n, 1)), camera, points=points)


def inside_hull(points: Array) -> Array:
    """Signed distance [px] of every pixel from the hull of projected points, negative inside."""
    hull = ConvexHull(CAMERA.project(points))
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    pixels = np.stack([u, v], axis=-1).astype(float)
    return np.max(pixels @ hull.equations[:, :2].T + hull.equations[:, 2], axis=-1)


def sheet() -> World:
    geometry = Sheet(corner=(-0.5, -0.3, 0.4), edge_u=(1.0, 0.1, 0.2), edge_v=(-0.1, 0.7, 0.1), divisions=(7, 5))
    return World(deformables=(Cloth(name="sheet", geometry=geometry, appearance=Appearance(color="red")),))


def test_flat_sheet_covers_the_parallelogram_it_is() -> None:
    picture = draw(sheet())
    corners = np.array([-0.5, -0.3, 0.4]) + np.array([[0, 0, 0], [1, 0.1, 0.2], [0.9, 0.8, 0.3], [-0.1, 0.7, 0.1]])
    margin = inside_hull(corners)
    clear = np.abs(margin) > 0.05
    assert (margin < 0).sum() > 1000
    assert np.array_equal((picture.labels == 0)[clear], (margin < 0)[clear])
    normal = np.cross([1.0, 0.1, 0.2], [-0.1, 0.7, 0.1])
    seen = picture.labels == 0
    along = ((corners[0] - CAMERA.centre) @ normal) / (rays() @ normal)
    depth = CAMERA.to_camera(CAMERA.centre + along[..., None] * rays())[..., 2]
    assert np.allclose(picture.depth[seen], depth[seen], atol=1e-4)


def test_rope_covers_the_rays_that_pass_nearer_than_its_radius() -> None:
    start, end, radius = np.array([-0.6, 0.4, 0.2]), np.array([0.7, -0.2, 0.6]), 0.05
    rope = Rope(name="rope", points=(tuple(start), tuple(end)), segments=9, radius=radius)
    picture = draw(World(deformables=(rope,)))
    # Distance between each ray and the straight line, where their nearest points lie between the rope's ends.
    axis = (end - start) / np.linalg.norm(end - start)
    d = rays()
    across = np.cross(d, axis)
    distance = np.abs((start - CAMERA.centre) @ across.reshape(-1, 3).T).reshape(d.shape[:2])
    distance /= np.linalg.norm(across, axis=-1)
    b = d @ axis
    offset = start - CAMERA.centre
    along = (b * (d @ offset) - axis @ offset) / (1.0 - b**2)
    middle = (along > 0.05) & (along < np.linalg.norm(end - start) - 0.05)
    clear = middle & (np.abs(distance - radius) > 1e-4)
    assert (distance[clear] < radius).sum() > 300
    assert np.array_equal((picture.labels == 0)[clear], (distance < radius)[clear])


def test_soft_ball_looks_like_the_ball_it_is() -> None:
    soft = Soft(name="soft", shape=Sphere(radius=0.4), position=(0.25, 0.15, 0.45), resolution=0.1)
    rigid = RigidObject(name="rigid", shape=Sphere(radius=0.4), position=(0.25, 0.15, 0.45))
    a, b = draw(World(deformables=(soft,))).mask(0), draw(World(objects=(rigid,))).mask(0)
    assert (a & b).sum() / (a | b).sum() > 0.97


def bucket_of_water() -> World:
    grid = FluidGrid(lower=(-0.5, -0.5, 0.0), upper=(0.5, 0.5, 1.0), cell=0.05)
    volume = FluidVolume(shape=Box(half_extents=(0.3, 0.3, 0.2)), position=(0.0, 0.0, 0.2))
    return World(deformables=(Fluid(name="water", volumes=(volume,)),), fluid_grid=grid)


def test_block_of_fluid_covers_the_block_within_a_particle() -> None:
    picture = draw(bucket_of_water())
    corners = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (0.0, 0.4)])
    margin = inside_hull(corners)
    spacing = 0.025 * 420.0 / 4.4  # [px]
    clear = np.abs(margin) > spacing
    assert np.array_equal((picture.labels == 0)[clear], (margin < 0)[clear])
    seen = picture.labels == 0
    red, _, blue = picture.color[seen].mean(axis=0)
    assert blue > red + 30


def test_lone_drop_is_a_ball_and_two_far_apart_do_not_join() -> None:
    at = np.array([[-0.2, 0.1, 0.4], [0.1, 0.1, 0.4]])
    picture = draw(bucket_of_water(), {"water": at})
    radius = 0.85 * 0.025
    to_drops = at - CAMERA.centre
    distance = np.linalg.norm(to_drops, axis=1)
    sine = np.sqrt(1.0 - np.minimum((rays() @ to_drops.T / distance) ** 2, 1.0))
    off = (sine * distance - radius).min(axis=-1) * 420.0 / distance.mean()  # [px] from the nearest outline
    clear = np.abs(off) > 0.3
    assert (off < 0.0).sum() > 20
    assert np.array_equal((picture.labels == 0)[clear], (off < 0.0)[clear])


def test_liquids_that_touch_leave_no_gap_of_light_between_them() -> None:
    grid = FluidGrid(lower=(-0.5, -0.5, 0.0), upper=(0.5, 0.5, 1.0), cell=0.1)
    lower = FluidVolume(shape=Box(half_extents=(0.5, 0.5, 0.2)), position=(0.0, 0.0, 0.2))
    upper = FluidVolume(shape=Box(half_extents=(0.5, 0.5, 0.2)), position=(0.0, 0.0, 0.6))
    whole = draw(World(deformables=(Fluid(name="a", volumes=(lower, upper)),), fluid_grid=grid))
    layers = Fluid(name="a", volumes=(lower,)), Fluid(name="b", volumes=(upper,))
    parted = draw(World(deformables=layers, fluid_grid=grid))
    # Inside the picture of the upper one both rays pass the same depth of water.
    inner = np.abs(inside_hull(np.array([[x, y, 0.8] for x in (-0.4, 0.4) for y in (-0.4, 0.4)])) + 20.0) < 15.0
    assert inner.sum() > 500
    assert np.abs(parted.color[inner].astype(int) - whole.color[inner]).max() < 12


def test_fluid_in_front_hides_and_fluid_behind_is_hidden() -> None:
    world = bucket_of_water()
    for place, expected in (((-0.45, 1.2, -0.45), {0}), ((0.52, -1.4, 1.0), {1})):
        wall = StaticObject(name="wall", shape=Box(half_extents=(0.3, 0.02, 0.2)), position=place)
        both = draw(world.model_copy(update={"statics": (wall,)}))
        shared = draw(world).mask(0) & draw(World(statics=(wall,))).mask(0)
        assert shared.sum() > 100
        assert set(np.unique(both.labels[shared])) == expected


def test_glass_is_looked_through_and_still_seen() -> None:
    pane = {"shape": Box(half_extents=(0.5, 0.02, 0.4)), "position": (0.52, -1.4, 1.0)}
    clear = StaticObject(name="pane", appearance=Appearance(material="glass"), **pane)
    ball = RigidObject(name="ball", shape=Sphere(radius=0.3), position=(0.0, 0.0, 0.3))
    alone, behind = draw(World(objects=(ball,))), draw(World(objects=(ball,), statics=(clear,)))
    hidden = draw(World(objects=(ball,), statics=(StaticObject(name="pane", **pane),)))
    covered = alone.mask(0) & ~hidden.mask(0)
    assert covered.sum() > 500
    assert np.array_equal(behind.mask(0), alone.mask(0))
    assert np.all(np.any(behind.color[covered] != alone.color[covered], axis=-1))
    assert behind.mask(1).sum() > 500  # where it stands before nothing


def test_particles_that_are_not_there_are_not_drawn() -> None:
    world = bucket_of_water()
    assert not draw(world, {"water": np.full((10, 3), np.nan)}).mask(0).any()


def test_pieces_of_a_compound_share_its_label() -> None:
    parts = [Part(shape=Box(half_extents=(0.1, 0.1, 0.3)), position=(x, 0.0, 0.0)) for x in (-0.4, 0.4)]
    both = draw(World(objects=(RigidObject(name="pair", shape=Compound(parts=tuple(parts)), position=(0, 0, 0.5)),)))
    boxes = [
        RigidObject(name=name, shape=Box(half_extents=(0.1, 0.1, 0.3)), position=(x, 0, 0.5))
        for name, x in (("left", -0.4), ("right", 0.4))
    ]
    apart = draw(World(objects=tuple(boxes)))
    assert np.array_equal(both.labels == 0, apart.labels >= 0)
    assert np.array_equal(both.depth, apart.depth)


def over_a_wheel(radius: float = 0.02, carrier: str | None = None) -> World:
    rope = Rope(name="rope", points=((-0.3, 0.0, 0.0), (0.3, 0.0, 0.0)), radius=radius)
    wheel = Pulley(name="wheel", rope="rope", centre=(0.0, 0.0, 0.8), radius=0.3, after=0, object=carrier)
    body = RigidObject(name="hook", shape=Sphere(radius=0.05), position=(0.0, 0.0, 1.3))
    return World(objects=(body,), deformables=(rope,), pulleys=(wheel,))


def test_rope_is_drawn_round_the_wheel_and_not_through_it() -> None:
    camera = look_at(np.array([0.0, -4.0, 0.8]), np.array([0.0, 0.0, 0.8]), focal=420.0, width=320, height=240)
    picture = draw(over_a_wheel(), camera=camera)
    top, centre = camera.project(np.array([[0.0, 0.0, 1.1], [0.0, 0.0, 0.8]]))
    column, row = np.rint(top).astype(int)
    assert picture.labels[row, column] == 1
    column, row = np.rint(centre).astype(int)
    assert picture.labels[row, column] == 3  # two objects, no static, no plane: the first pulley


def test_carried_pulley_goes_with_the_object_that_carries_it() -> None:
    world = over_a_wheel(carrier="hook")
    positions, turn = np.array([(0.5, 0.0, 1.3), (0.0, 0.0, 0.0)]), np.tile(IDENTITY, (2, 1))
    moved = render(world, positions, turn, CAMERA).mask(3)
    pixels = np.argwhere(moved).mean(axis=0)[::-1]
    assert np.linalg.norm(pixels - CAMERA.project(np.array([0.5, 0.0, 0.8]))) < 4.0


def test_default_camera_fills_the_picture_with_what_is_there() -> None:
    world = sheet()
    points = np.random.default_rng(3).uniform(-1.0, 1.0, size=(200, 3)) * [2.0, 0.2, 0.5]
    camera = default_camera(world, points)
    pixels = camera.project(points)
    assert camera.sees(points).all()
    span = np.ptp(pixels, axis=0) / [camera.width, camera.height]
    fitted = int(np.argmax(span))
    assert span[fitted] > 0.8
    free = pixels.min(axis=0), np.array([camera.width - 1, camera.height - 1]) - pixels.max(axis=0)
    assert free[0][fitted] == pytest.approx(free[1][fitted], abs=1.0)


def test_points_of_what_is_not_deformable_are_refused() -> None:
    with pytest.raises(ValueError, match=r"points of \['ghost'\]: deformable objects are \['sheet'\]"):
        draw(sheet(), {"ghost": np.zeros((4, 3))})
