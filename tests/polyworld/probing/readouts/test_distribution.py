"""Amounts, fillings and fronts of particle clouds of which they are known exactly."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.probing.readouts import Level, check_readable, read
from polyworld.probing.readouts.distribution import (
    amount_inside,
    centre,
    front,
    grid_filling,
    in_container_axes,
    share_inside,
)
from polyworld.solver.rollout import rollout
from polyworld.trajectory import Trajectory
from polyworld.world import Environment, MotionPlane, World
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.representations.fluid import Container, Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box

Array = NDArray[np.float64]
H = 0.05


def block(lower: tuple[float, float, float], upper: tuple[float, float, float]) -> Array:
    """Particles that fill a box evenly, each the middle of a cube of edge H."""
    lines = [np.arange(a + H / 2, b, H) for a, b in zip(lower, upper, strict=True)]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)


BLOCK = block((0.0, 0.0, 0.0), (1.0, 0.5, 0.5))
VOLUMES = np.full(len(BLOCK), H**3)
EDGES = np.full((len(BLOCK), 3), H)


@pytest.mark.parametrize("border", [0.3, 0.31, 0.3171, 0.349])
def test_a_box_holds_the_volume_it_shares_with_the_fluid_wherever_its_border_runs(border: float) -> None:
    amount = amount_inside(BLOCK, VOLUMES, EDGES, np.array([border, -1.0, 0.1]), np.array([2.0, 1.0, 0.4]))
    assert amount == pytest.approx((1.0 - border) * 0.5 * 0.3, rel=1e-9)


def test_particles_that_are_gone_are_nowhere() -> None:
    points = BLOCK.copy()
    points[:10] = np.nan
    share = share_inside(points, EDGES, np.full(3, -1.0), np.full(3, 2.0))
    assert share.sum() == len(BLOCK) - 10
    assert front(points[None, :5], VOLUMES[:5], np.array([0.0, 0.0, 1.0]), 1.0) == pytest.approx([np.nan], nan_ok=True)
    assert np.isnan(centre(points[None, :5], VOLUMES[:5])).all()


def test_what_a_container_holds_does_not_change_when_both_are_carried_away_and_tipped() -> None:
    bucket = RigidObject(
        name="bucket",
        shape=Box(half_extents=(0.5, 0.5, 0.5)),
        position=(0.5, 0.25, 0.25),
        representation="rigid_spatial",
    )
    inside = Container(name="inside", lower=(0.2, 0.0, 0.0), upper=(0.7, 0.5, 0.4), object="bucket")
    world = World(objects=(bucket,), containers=(inside,))
    q = np.array([0.6, 0.0, 0.8, 0.0])
    moved = (BLOCK - np.asarray(bucket.position)) @ quaternion_matrix(q).T + [3.0, -1.0, 2.0]
    trajectory = Trajectory(
        names=("bucket",),
        times=np.array([0.0, 1.0]),
        positions=np.array([[bucket.position], [[3.0, -1.0, 2.0]]]),
        orientations=np.array([[[1.0, 0.0, 0.0, 0.0]], [q]]),
        velocities=np.zeros((2, 1, 3)),
        angular_velocities=np.zeros((2, 1, 3)),
        active=np.ones((2, 1), dtype=bool),
    )
    seen = in_container_axes(world, trajectory, inside, np.stack([BLOCK, moved]))
    amounts = amount_inside(seen, VOLUMES, EDGES, np.asarray(inside.lower), np.asarray(inside.upper))
    assert amounts == pytest.approx([0.5 * 0.5 * 0.4] * 2, rel=1e-9)
    still = amount_inside(moved, VOLUMES, EDGES, np.asarray(inside.lower), np.asarray(inside.upper))
    assert still == 0.0


def test_cells_inside_the_fluid_are_full_and_those_outside_empty() -> None:
    filled = grid_filling(
        np.stack([BLOCK, BLOCK + np.array([0.5, 0.0, 0.0])]),
        VOLUMES,
        np.zeros(3),
        np.array([2.0, 0.5, 0.5]),
        (8, 2, 2),
        None,
    ).reshape(2, 8, 2, 2)
    whole = filled[0].mean(axis=(1, 2))
    assert whole[1:3] == pytest.approx([1.0, 1.0], abs=0.02)
    assert whole[6:] == pytest.approx([0.0, 0.0])
    assert filled[1, 2:, :, :].mean(axis=(1, 2)) == pytest.approx(filled[0, :6].mean(axis=(1, 2)), abs=1e-9)


def test_filling_changes_smoothly_and_keeps_the_amount_as_the_fluid_moves() -> None:
    drop = block((0.4, 0.4, 0.4), (0.6, 0.6, 0.6))
    sizes = np.full(len(drop), H**3)
    moved = np.stack([drop + np.array([d, 0.0, 0.0]) for d in np.linspace(0.0, 0.1, 21)])
    filled = grid_filling(moved, sizes, np.zeros(3), np.ones(3), (5, 5, 5), None)
    assert filled.sum(axis=1) * 0.2**3 == pytest.approx(np.full(21, 0.2**3), rel=1e-9)
    assert np.abs(np.diff(filled, axis=0)).max() < 0.05


def test_fronts_are_quantiles_of_the_substance() -> None:
    tilted = np.array([1.0, 0.0, 0.0])
    assert front(BLOCK, VOLUMES, tilted, 0.5) == pytest.approx(0.5, abs=1e-9)
    assert front(BLOCK, VOLUMES, tilted, 0.9) == pytest.approx(0.9, abs=0.5 * H)
    assert front(BLOCK, VOLUMES, np.array([0.0, 0.0, 3.0]), 1.0) == pytest.approx(0.5 - H / 2)
    heavier = np.where(BLOCK[:, 0] < 0.25, 3.0, 1.0) * VOLUMES  # half of it in the first quarter
    assert front(BLOCK, heavier, tilted, 0.5) == pytest.approx(0.25, abs=H)


@pytest.mark.parametrize(("representation", "normal"), [("fluid", (0.0, 0.0, 1.0)), ("fluid_planar", (0.0, 1.0, 0.0))])
def test_level_is_the_depth_of_the_fluid_spread_over_the_bottom(
    representation: Literal["fluid", "fluid_planar"], normal: tuple[float, float, float]
) -> None:
    """A block 0.4 m wide and 0.2 m high, as deep as the 0.8 m wide tank, would stand 0.1 m high in it."""
    water = FluidVolume(shape=Box(half_extents=(0.2, 0.1, 0.1)), position=(-0.2, 0.0, 0.1))
    tank = World(
        deformables=(Fluid(name="water", representation=representation, volumes=(water,)),),
        fluid_grid=FluidGrid(lower=(-0.4, -0.1, 0.0), upper=(0.4, 0.1, 0.4), cell=0.04),
        containers=(Container(name="left", lower=(-0.4, -0.1, 0.0), upper=(0.0, 0.1, 0.4)),),
        environment=Environment(motion_plane=MotionPlane(normal=normal)),
    )
    start = rollout(tank, 0.001).trajectory
    for container, depth in ((None, 0.1), ("left", 0.2)):
        asked = Level(object="water", container=container)
        check_readable(asked, tank)
        assert read(asked, tank, start)[0, 0, 0] == pytest.approx(depth, rel=0.03)
