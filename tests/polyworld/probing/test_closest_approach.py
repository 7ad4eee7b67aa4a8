"""Gaps between surfaces: on paper where motion is known, and against MuJoCo for any pose of any pair of shapes."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polyworld.probing.closest_approach import closest_approach
from polyworld.solver.rollout import rollout
from polyworld.trajectory import Trajectory
from polyworld.world import Environment, StaticObject, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Plane, Sphere, Wall
from tests.verification.planar_scenes import body, disc, top_view

POINTS = np.random.default_rng(5).normal(size=(14, 3)) * 0.15
SHAPES: dict[str, Any] = {
    "sphere": Sphere(radius=0.2),
    "box": Box(half_extents=(0.15, 0.2, 0.3)),
    "cylinder": Cylinder(radius=0.2, half_height=0.25),
    "capsule": Capsule(radius=0.15, half_height=0.2),
    "mesh": ConvexMesh(vertices=tuple(map(tuple, POINTS.tolist()))),
}
PAIRS = [(a, b) for k, a in enumerate(SHAPES) for b in list(SHAPES)[k:]]


def mujoco_geom(kind: str) -> str:
    shape = SHAPES[kind]
    if isinstance(shape, Sphere):
        return f'type="sphere" size="{shape.radius}"'
    if isinstance(shape, Box):
        return 'type="box" size="{} {} {}"'.format(*shape.half_extents)
    if isinstance(shape, ConvexMesh):
        return 'type="mesh" mesh="hull"'
    return f'type="{kind}" size="{shape.radius} {shape.half_height}"'


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_gap_is_that_of_mujoco(a: str, b: str) -> None:
    vertices = " ".join(f"{x:.12g}" for x in np.asarray(geometry.hull(SHAPES["mesh"]).vertices).ravel())
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="hull" vertex="{vertices}"/></asset><worldbody>'
        f'<body mocap="true"><geom {mujoco_geom(a)}/></body><body mocap="true"><geom {mujoco_geom(b)}/></body>'
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    rng = np.random.default_rng(1)
    for _ in range(10):
        q = Rotation.random(2, random_state=rng).as_quat()[:, [3, 0, 1, 2]]
        p = np.stack([np.zeros(3), rng.normal(size=3)])
        data.mocap_pos[:], data.mocap_quat[:] = p, q
        mujoco.mj_forward(model, data)
        expected = mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None)
        items = tuple(
            RigidObject(name=n, shape=SHAPES[s], position=tuple(x), orientation=tuple(o))
            for n, s, x, o in zip("ab", (a, b), p.tolist(), q.tolist(), strict=True)
        )
        still = np.zeros((2, 2, 3))
        trajectory = Trajectory(
            ("a", "b"), np.array([0.0, 1.0]), np.stack([p, p]), np.stack([q, q]), still, still, np.ones((2, 2), bool)
        )
        found = closest_approach(World(objects=items), trajectory, "a", "b", (0.0, 1.0))
        assert found is not None
        assert found.gap == pytest.approx(max(expected, 0.0), abs=2e-5)


def test_passing_ball_comes_nearest_between_two_samples() -> None:
    """It passes at 0.7 m, centre to centre, when it has gone 0.53 m at 2 m/s; the radii take 0.35 m."""
    ball = RigidObject(name="ball", shape=Sphere(radius=0.1), position=(-0.53, 0.7, 1.0), velocity=(2.0, 0.0, 0.0))
    post = RigidObject(name="post", shape=Sphere(radius=0.25), position=(0.0, 0.0, 1.0))
    world = World(objects=(ball, post), environment=Environment(gravity=(0.0, 0.0, 0.0)))
    found = closest_approach(world, rollout(world, 1.0).trajectory, "ball", "post", (0.0, 1.0))
    assert found is not None
    assert found.gap == pytest.approx(0.35, abs=1e-9)
    assert found.time == pytest.approx(0.265, abs=1e-6)


def test_gap_of_planar_outlines_to_disc_box_wall_and_half_plane() -> None:
    """A disc of radius 0.2 goes along y = 0; the turned box's corner is 0.1 sqrt(2) from its centre at y = 1."""
    mover = body("mover", disc(), (-1.0, 0.0, 0.2), velocity=(2.0, 0.0, 0.0))
    corner = float(np.sin(np.pi / 8)), float(np.cos(np.pi / 8))
    box = body("box", Box(half_extents=(0.1, 0.1, 0.1)), (0.0, 1.0, 0.1), orientation=(corner[1], 0.0, 0.0, corner[0]))
    low = StaticObject(name="low", shape=Wall(start=(-2.0, -0.6, 0.0), end=(2.0, -0.6, 0.0), thickness=0.1))
    side = StaticObject(name="side", shape=Plane(normal=(-1.0, 0.0, 0.0), offset=-3.0))
    world = top_view(mover, box, gravity=0.0, statics=(low, side, StaticObject(name="floor", shape=Plane())))
    trajectory = rollout(world, 1.0).trajectory

    def gap(other: str, until: float = 1.0) -> tuple[float, float]:
        found = closest_approach(world, trajectory, "mover", other, (0.0, until))
        assert found is not None
        return found.gap, found.time

    assert gap("box") == pytest.approx((1.0 - 0.2 - 0.1 * 2**0.5, 0.5), abs=1e-6)
    assert gap("low")[0] == pytest.approx(0.6 - 0.2 - 0.05, abs=1e-9)
    assert gap("side", 0.7) == pytest.approx((3.0 - 0.4 - 0.2, 0.7), abs=1e-9)
    assert closest_approach(world, trajectory, "mover", "floor", (0.0, 1.0)) is None
