"""Resting, stacking and rolling of every shape on every kind of support, and shapes that are the same solid."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polyworld.world import StaticObject, geometry
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Plane, Sphere, TriangleMesh, Wall
from tests.verification.spatial_world import FLOOR, GRAVITY, body, make_world, run

CORNERS = np.array(list(itertools.product([-1.0, 1.0], repeat=3)))
CUBE = Box(half_extents=(0.1, 0.1, 0.1))
CUBE_MESH = ConvexMesh(vertices=tuple(map(tuple, (0.1 * CORNERS).tolist())))
SHAPES = {
    "sphere": Sphere(radius=0.1),
    "box": CUBE,
    "cylinder": Cylinder(radius=0.1, half_height=0.1),
    "capsule": Capsule(radius=0.1, half_height=0.1),
    "mesh": CUBE_MESH,
}
LYING = (float(np.sqrt(0.5)), float(np.sqrt(0.5)), 0.0, 0.0)  # body z along -y


def grid_floor(cells: int = 6, size: float = 3.0, height: float = 0.0) -> StaticObject:
    """A flat floor of many triangles, none of whose inner edges should be felt."""
    ticks = np.linspace(-size, size, cells + 1)
    vertices = tuple((float(x), float(y), height) for x in ticks for y in ticks)
    faces = []
    for i, j in itertools.product(range(cells), repeat=2):
        a = i * (cells + 1) + j
        b = a + cells + 1
        faces += [(a, b, b + 1), (a, b + 1, a + 1)]
    return StaticObject(name="floor", shape=TriangleMesh(vertices=vertices, faces=tuple(faces)))


FLOORS = {
    "plane": FLOOR,
    "box": StaticObject(name="floor", shape=Box(half_extents=(3, 3, 0.5)), position=(0, 0, -0.5)),
    "wall": StaticObject(name="floor", shape=Wall(start=(-3, 0, -0.5), end=(3, 0, -0.5), height=0.5, thickness=6.0)),
    "mesh": StaticObject(
        name="floor",
        shape=ConvexMesh(vertices=tuple(map(tuple, (CORNERS * (3, 3, 0.5)).tolist()))),
        position=(0, 0, -0.5),
    ),
    "triangles": grid_floor(),
    "cylinder": StaticObject(name="floor", shape=Cylinder(radius=3, half_height=0.5), position=(0, 0, -0.5)),
}


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_rests_on_every_floor(shape: str, floor: str) -> None:
    """Dropped from 5 cm onto its flat side it settles at its own half height and stays there."""
    orientation = LYING if shape == "capsule" else (1.0, 0.0, 0.0, 0.0)
    item = body("b", SHAPES[shape], (0.23, 0.31, 0.15), orientation=orientation, restitution=0.3)
    out = run(make_world(item, statics=(FLOORS[floor],)), 2.0)
    assert out.positions[0, -1, 0] == pytest.approx([0.23, 0.31, 0.1], abs=1e-4)
    late = out.positions[0, out.times[0] > 1.5, 0]
    assert np.abs(late - late[0]).max() < 1e-6


@pytest.mark.parametrize(("below", "above"), list(itertools.product(["box", "cylinder", "mesh"], repeat=2)))
def test_flat_faces_stack(below: str, above: str) -> None:
    """One on the other, overhanging a little: nothing moves for 2 s."""
    out = run(make_world(body("a", SHAPES[below], (0, 0, 0.1)), body("b", SHAPES[above], (0.03, 0.02, 0.3))), 2.0)
    assert np.abs(out.positions[0] - out.positions[0, 0]).max() < 1e-5


def test_tower_of_eight_boxes_stands() -> None:
    """Eight cubes, each placed 1 mm off: still standing after 3 s.

    Each contact may keep an overlap of 1e-4 of a cube's bounding radius, 0.14 mm over the tower.
    """
    cubes = [body(f"c{k}", CUBE, (0.001 * (-1) ** k, 0, 0.1 + 0.2 * k), restitution=0.2) for k in range(8)]
    out = run(make_world(*cubes), 3.0)
    assert np.abs(out.positions[0, -1] - out.positions[0, 0]).max() < 2e-4
    assert np.abs(out.velocities[0, -1]).max() < 1e-4


def test_box_beyond_its_edge_falls_off_the_stack() -> None:
    """A cube with its centre 5 mm beyond the edge of the one below tips over it; 5 mm inside it stays."""
    for offset, falls in ((0.105, True), (0.095, False)):
        base = StaticObject(name="base", shape=CUBE, position=(0, 0, 0.1), friction=0.8)
        out = run(make_world(body("b", CUBE, (offset, 0, 0.3), friction=0.8), statics=(FLOOR, base)), 2.0)
        assert (out.positions[0, -1, 0, 2] < 0.2) == falls


def _thrown(shape: Box | ConvexMesh, floor: StaticObject) -> np.ndarray:
    item = body("b", shape, (0, 0, 0.1), velocity=(1.5, 0.4, 0), angular_velocity=(0, 0, 3), friction=0.3)
    return run(make_world(item, statics=(floor,)), 1.5).positions[0, :, 0]


def test_mesh_cube_moves_like_the_box() -> None:
    """The same solid, described twice, slides and turns the same way.

    Not to the last digit: how four corners share a load is not determined, and the spin depends on it a little.
    """
    assert np.abs(_thrown(CUBE_MESH, FLOOR) - _thrown(CUBE, FLOOR)).max() < 3e-3


@pytest.mark.parametrize("floor", ["box", "mesh", "triangles", "wall"])
def test_flat_floors_act_like_the_plane(floor: str) -> None:
    """A sliding, turning cube does not notice what its floor is made of, nor triangle edges within it."""
    assert np.abs(_thrown(CUBE, FLOORS[floor]) - _thrown(CUBE, FLOOR)).max() < 5e-3


@pytest.mark.parametrize("shape", ["sphere", "cylinder", "capsule"])
@pytest.mark.parametrize("floor", FLOORS)
def test_rolling_body_feels_no_bumps(shape: str, floor: str) -> None:
    """A rolling round body keeps its height and its speed on every flat floor."""
    item = body(
        "b", SHAPES[shape], (-1.2, 0.13, 0.1), orientation=LYING, velocity=(1, 0, 0), angular_velocity=(0, 10, 0)
    )
    out = run(make_world(item, statics=(FLOORS[floor],)), 2.0)
    assert np.abs(out.positions[0, :, 0, 2] - 0.1).max() < 5e-5
    assert np.abs(out.velocities[0, :, 0, 0] - 1).max() < 1e-4
    assert out.positions[0, -1, 0, 0] == pytest.approx(0.8, abs=1e-3)
    assert out.positions[0, -1, 0, 1] == pytest.approx(0.13, abs=1e-3)


@pytest.mark.parametrize(("first", "second"), list(itertools.product(SHAPES, SHAPES)))
def test_pairs_collide_head_on(first: str, second: str) -> None:
    """Equal masses, e = 1, flat or round sides facing: the velocities are exchanged and nobody turns."""
    upright = (1.0, 0.0, 0.0, 0.0)
    a = body("a", SHAPES[first], (-0.5, 0, 0), velocity=(1, 0, 0), restitution=1.0, orientation=upright)
    b = body("b", SHAPES[second], (0.5, 0, 0), velocity=(-1, 0, 0), restitution=1.0, orientation=upright)
    out = run(make_world(a, b, statics=(), gravity=(0, 0, 0)), 1.0)
    assert np.abs(out.velocities[0, -1, :, 0] - [-1, 1]).max() < 1e-6
    assert np.abs(out.angular_velocities[0, -1]).max() < 1e-5
    begin = out.events[0][0]
    assert begin.time == pytest.approx(0.4, abs=1e-4)
    assert begin.speed == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("offset", [0.05, 0.12])
def test_upright_cylinders_part_like_balls(offset: float) -> None:
    """Smooth sides: the direction after an oblique hit is that of the line of centres, not of a facet."""
    can = Cylinder(radius=0.1, half_height=0.2)
    a = body("a", can, (-0.5, offset, 0), velocity=(1, 0, 0), restitution=1.0, friction=0.0)
    b = body("b", can, (0, 0, 0), restitution=1.0, friction=0.0)
    out = run(make_world(a, b, statics=(), gravity=(0, 0, 0)), 1.0)
    line = np.array([np.sqrt(0.04 - offset**2), -offset]) / 0.2
    assert np.abs(out.velocities[0, -1, 1, :2] - line[0] * line).max() < 1e-4


def test_dropped_heap_comes_to_rest_without_sinking() -> None:
    """Twenty mixed bodies fall into a box of walls; in the end none moves fast, none is below the floor."""
    rng = np.random.default_rng(11)
    turns = Rotation.random(20, random_state=4).as_quat()
    names = list(SHAPES)
    items = [
        body(
            f"b{k}",
            SHAPES[names[k % 5]],
            (rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 0.3 + 0.25 * k),
            orientation=np.roll(turns[k], 1),
            restitution=0.2,
            friction=0.6,
            rolling_resistance=0.005,
        )
        for k in range(20)
    ]
    walls = tuple(
        StaticObject(name=f"wall{k}", shape=Plane(normal=n, offset=-0.6))
        for k, n in enumerate([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])
    )
    out = run(make_world(*items, statics=(FLOOR, *walls), substep=0.004), 5.0)
    assert not out.diverged.any()
    assert out.positions[0, -1, :, 2].min() > 0.09
    assert np.abs(out.positions[0, -1, :, :2]).max() < 0.6
    assert np.linalg.norm(out.velocities[0, -1], axis=1).max() < 0.1


@pytest.mark.parametrize("floor", ["plane", "box", "triangles", "mesh"])
@pytest.mark.parametrize("seed", [1, 2, 9])
def test_irregular_hull_tumbles_to_rest_without_sinking(seed: int, floor: str) -> None:
    """No vertex of a thrown hull, long and thin ones among them, gets below the floor by more than 0.2 mm.

    Gaps are predicted on straight lines, and within a step the hull turns.
    """
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(int(rng.integers(5, 40)), 3)) * rng.uniform(0.03, 0.25, 3)
    shape = ConvexMesh(vertices=tuple(map(tuple, points.tolist())))
    turn = np.roll(Rotation.random(random_state=seed).as_quat(), 1)
    item = body(
        "rock", shape, (0.3, 0.2, 1.0), orientation=turn, velocity=(0.5, 0, 0), angular_velocity=(3, 2, 1), friction=0.5
    )
    out = run(make_world(item, statics=(FLOORS[floor],)), 4.0, samples=401)
    turns = geometry.quaternion_matrix(out.orientations[0, :, 0])
    heights = np.einsum("tj,vj->tv", turns[:, 2], np.asarray(geometry.hull(shape).vertices))
    assert (heights + out.positions[0, :, 0, 2:]).min() > -2e-4
    assert np.abs(out.velocities[0, -1]).max() < 1e-4


def test_overlapping_bodies_are_taken_apart_gently() -> None:
    """Two cubes that start 4 cm inside each other end side by side, and never move faster than 0.5 m/s."""
    a = body("a", CUBE, (0, 0, 0.1), friction=0.1)
    b = body("b", CUBE, (0.16, 0.01, 0.1), friction=0.1)
    out = run(make_world(a, b), 1.0)
    assert np.linalg.norm(out.velocities[0], axis=2).max() < 0.5
    assert out.positions[0, -1, 1, 0] - out.positions[0, -1, 0, 0] == pytest.approx(0.2, abs=1e-3)


def test_ball_rolls_across_a_valley_of_triangles() -> None:
    """Without friction the ball keeps its energy sliding through a curved channel of 24 strips."""
    angle = np.linspace(-1.2, 1.2, 25)
    ring = np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    vertices = tuple((float(x), y, float(z)) for x, z in ring for y in (-1.0, 1.0))
    faces = tuple(f for k in range(24) for f in ((2 * k, 2 * k + 2, 2 * k + 1), (2 * k + 1, 2 * k + 2, 2 * k + 3)))
    valley = StaticObject(name="valley", shape=TriangleMesh(vertices=vertices, faces=faces))
    start = -0.8
    inner = 1 - 0.05
    ball = body(
        "b",
        Sphere(radius=0.05),
        (inner * np.sin(start), 0, 1 - inner * np.cos(start) + 1e-3),
        friction=0.0,
        restitution=0.0,
    )
    out = run(make_world(ball, statics=(valley,)), 3.0, samples=601)
    height, speed = out.positions[0, :, 0, 2], np.linalg.norm(out.velocities[0, :, 0], axis=1)
    assert height.min() > 0.05 - 1e-4
    energy = GRAVITY * height + 0.5 * speed**2
    assert energy.max() < energy[0] * (1 + 1e-3)
    assert out.positions[0, :, 0, 0].max() > 0.5
