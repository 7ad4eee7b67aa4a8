"""Silhouettes against the projections of simple solids, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.model import mesh_of
from polyworld.pictures.render import look_at, render
from polyworld.probing.readouts.silhouette import image_occupancy, silhouette
from polyworld.world import World
from polyworld.world.camera import Camera
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.fluid import Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Sphere
from tests.polyworld.synthetic import camera_above

CAMERA = Camera(**camera_above())


def test_a_soft_ball_looks_like_the_disc_that_touches_its_tangent_rays() -> None:
    ball = Soft(name="ball", shape=Sphere(radius=0.8), position=(0.4, -0.3, 3.0), resolution=0.25)
    mesh = mesh_of(World(deformables=(ball,)), ball)
    mask = silhouette(mesh.nodes, mesh, CAMERA)
    v, u = np.nonzero(mask)
    # A ball of radius r at depth d, near the axis, covers about the radius f r / sqrt(d^2 - r^2).
    radius = 600.0 * 0.8 / np.sqrt(7.0**2 - 0.8**2)
    assert mask.sum() == pytest.approx(np.pi * radius**2, rel=0.03)
    assert [u.mean(), v.mean()] == pytest.approx(CAMERA.project(np.array([0.4, -0.3, 3.0])), abs=0.8)


def test_a_rope_covers_its_length_times_its_width() -> None:
    rope = Rope(name="rope", points=((-1.0, 0.1, 5.0), (1.0, 0.3, 5.0)), segments=10, radius=0.05)
    mesh = mesh_of(World(deformables=(rope,)), rope)
    coarse = image_occupancy(mesh.nodes, mesh, CAMERA, 40, 30)
    scale = 600.0 / 5.0
    expected = (np.hypot(2.0, 0.2) * scale) * (0.1 * scale) + np.pi * (0.05 * scale) ** 2
    assert coarse.sum() * 8.0 * 8.0 == pytest.approx(expected, rel=0.1)


def test_a_batch_is_seen_as_its_worlds_one_by_one_and_what_is_out_of_view_is_not() -> None:
    sheet = Sheet(corner=(-1.0, -1.0, 2.0), edge_u=(1.6, 0.0, 0.0), edge_v=(0.0, 1.2, 0.0), divisions=(6, 6))
    cloth = Cloth(name="cloth", geometry=sheet)
    mesh = mesh_of(World(deformables=(cloth,)), cloth)
    shifts = np.array([[0.0, 0.0, 0.0], [0.35, -0.2, 0.0], [50.0, 0.0, 0.0], [0.0, 0.0, 20.0]])
    batch = (mesh.nodes + shifts[:, None]).reshape(2, 2, -1, 3)
    seen = image_occupancy(batch, mesh, CAMERA, 16, 12)
    assert seen.shape == (2, 2, 12, 16)
    assert seen[0, 1] == pytest.approx(image_occupancy(batch[0, 1], mesh, CAMERA, 16, 12), abs=1e-9)
    assert seen[1].sum() == 0.0  # beside the image; behind the camera
    area = 1.6 * 1.2 * (600.0 / 8.0) ** 2
    assert seen[0, 0].sum() * 20.0 * 20.0 == pytest.approx(area, rel=0.06)


EYE = look_at(np.array([0.6, -3.0, 1.6]), np.array([0.5, 0.0, 0.5]), focal=420.0, width=320, height=240)
ROPE = Rope(name="rope", points=((0.0, 0.0, 1.0), (0.4, 0.2, 0.3), (1.0, 0.0, 0.9)), segments=30, radius=0.03)
SHEET = Sheet(corner=(0.0, -0.4, 0.4), edge_u=(1.0, 0.0, 0.3), edge_v=(0.0, 0.9, 0.2), divisions=(8, 8))
BODIES = [
    ROPE,
    Cloth(name="cloth", geometry=SHEET),
    Soft(name="soft", shape=Sphere(radius=0.4), position=(0.5, 0.0, 0.5)),
    Soft(name="block", shape=Box(half_extents=(0.3, 0.2, 0.4)), position=(0.5, 0.0, 0.5)),
]


def test_a_pool_is_seen_without_gaps_between_its_particles_as_it_is_drawn() -> None:
    pool = FluidVolume(shape=Box(half_extents=(0.4, 0.3, 0.2)), position=(0.5, 0.0, 0.4))
    water = Fluid(name="water", volumes=(pool,))
    world = World(deformables=(water,), fluid_grid=FluidGrid(lower=(0.0, -0.5, 0.0), upper=(1.0, 0.5, 1.0), cell=0.05))
    mesh = mesh_of(world, water)
    jitter = mesh.nodes + 0.004 * np.random.default_rng(0).normal(size=mesh.nodes.shape)
    picture = render(world, np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), EYE, points={"water": jitter})
    drawn = picture.mask(0)
    mask = silhouette(jitter, mesh, EYE)
    assert (mask & drawn).sum() / (mask | drawn).sum() > 0.9
    coarse = image_occupancy(jitter, mesh, EYE, 20, 15)
    inner = drawn.reshape(15, 16, 20, 16).all(axis=(1, 3))
    assert coarse[inner].min() > 0.9
    assert coarse.sum() * 256.0 == pytest.approx(drawn.sum(), rel=0.06)


@pytest.mark.parametrize("item", BODIES, ids=lambda item: item.name)
def test_a_silhouette_is_that_of_the_drawn_picture(item: Rope | Cloth | Soft) -> None:
    """The renderer follows rays; nothing is shared with the sampling here but the camera."""
    world = World(deformables=(item,))
    mesh = mesh_of(world, item)
    rng = np.random.default_rng(2)
    bent = mesh.nodes + 0.15 * np.sin(3.0 * mesh.nodes[:, [1, 2, 0]]) + 0.05 * rng.normal(size=3)
    picture = render(world, bent.mean(axis=0)[None], np.array([[1.0, 0.0, 0.0, 0.0]]), EYE, points={item.name: bent})
    drawn = picture.mask(0)
    mask = silhouette(bent, mesh, EYE)
    assert (mask & drawn).sum() / (mask | drawn).sum() > (0.93 if item.name == "rope" else 0.97)
    coarse = image_occupancy(bent, mesh, EYE, 20, 15)
    expected = drawn.reshape(15, 16, 20, 16).mean(axis=(1, 3))
    assert np.abs(coarse - expected).max() < 0.15
    assert coarse.sum() == pytest.approx(expected.sum(), rel=0.06)
