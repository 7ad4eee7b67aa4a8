"""Fluids and rigid bodies acting on each other."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.solver.rollout import simulator
from polyworld.world import StaticObject, World
from polyworld.world.representations.fluid import Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Compound, Part, Plane, Sphere
from tests.polyworld.solver.fluid.scenes import GRAVITY, Run, plane_world, pool


def _raft(density: float, z: float, *, half: float = 0.2) -> RigidObject:
    return RigidObject(
        name="raft",
        representation="rigid_planar",
        shape=Box(half_extents=(half, 0.05, 0.1)),
        density=density,
        position=(0.5, 0.0, z),
    )


def test_floating_raft_of_half_density_draws_half_its_height() -> None:
    """Archimedes: draft over height is the ratio of densities. Mean over the bobbing after release 2 cm too high."""
    run = Run(plane_world(pool("water", (0, 0), (1, 0.3)), size=(1, 0.6), cell=0.04, objects=(_raft(500.0, 0.32),)))
    run.run(1.0)
    bottoms = []
    for _ in run.advance(3.0):
        bottoms.append(run.bodies.numpy()["x"][0, 0, 2] - 0.1)
    bottom = np.mean(bottoms)
    volume = len(run.present()[0]) * run.fluid.particle_volume
    level = (volume - 0.4 * bottom) / 0.6
    assert level - bottom == pytest.approx(0.1, rel=0.04)


@pytest.mark.parametrize("density", [20.0, pytest.param(200.0, marks=pytest.mark.benchmark)])
def test_light_bodies_are_stable(density: float) -> None:
    """A raft fifty times lighter than water rises from below, jumps, and floats; it never flies off."""
    raft = _raft(density, 0.15, half=0.1)
    run = Run(plane_world(pool("water", (0, 0), (1, 0.3)), size=(1, 0.8), cell=0.04, objects=(raft,)), step=0.004)
    heights = []
    for _ in run.advance(3.0):
        heights.append(run.bodies.numpy()["x"][0, 0, 2])
    assert np.max(heights) < 0.8
    assert np.mean(heights[-200:]) == pytest.approx(0.3 + 0.1 - 0.2 * density / 1000, abs=0.05)


@pytest.mark.parametrize("cell", [pytest.param(0.02, marks=pytest.mark.benchmark), 0.04])
def test_submerged_sphere_feels_archimedes_force(cell: float) -> None:
    """Force on a held sphere is the weight of the water it displaces; 2%, none sideways. In space."""
    ball = RigidObject(
        name="ball", representation="rigid_spatial", shape=Sphere(radius=0.1), density=700.0, position=(0.21, 0.19, 0.2)
    )
    half = (0.2, 0.2, 0.18)
    water = Fluid(name="water", volumes=(FluidVolume(shape=Box(half_extents=half), position=(0.2, 0.2, 0.18)),))
    grid = FluidGrid(lower=(0, 0, 0), upper=(0.4, 0.4, 0.48), cell=cell)
    run = Run(World(objects=(ball,), deformables=(water,), fluid_grid=grid), step=0.004)
    mass = 1e9  # it does not move
    run.bodies.numpy()["inverse_mass"][:] = 1.0 / mass
    before = run.bodies.numpy()["v"][0, 0].copy()
    run.run(0.2, held=True)
    force = (run.bodies.numpy()["v"][0, 0] - before) * mass / 0.2
    weight = 1000 * GRAVITY * 4 / 3 * np.pi * 0.1**3
    assert force == pytest.approx([0.0, 0.0, weight], abs=0.02 * weight)


def _push_on_block(left: float, right: float, *, cell: float) -> np.ndarray:
    """Force (3,) [N/m] on a block held on the floor of a box, 0.3 m high, with water 0.2 m deep up to its sides.

    left, right: how far water reaches on either side, from the block [m].
    """
    block = RigidObject(
        name="block",
        representation="rigid_planar",
        shape=Box(half_extents=(0.1, 0.05, 0.15)),
        position=(0.5, 0.0, 0.15),
    )
    pools = [pool("left", (0.4 - left, 0.0), (0.4, 0.2))] if left else []
    pools += [pool("right", (0.6, 0.0), (0.6 + right, 0.2))] if right else []
    run = Run(plane_world(*pools, size=(1.0, 0.5), cell=cell, objects=(block,)), step=0.004)
    mass = 1e9  # it does not move
    run.bodies.numpy()["inverse_mass"][:] = 1.0 / mass
    before = run.bodies.numpy()["v"][0, 0].copy()
    run.run(0.1, held=True)
    force: np.ndarray = (run.bodies.numpy()["v"][0, 0] - before) * mass / 0.1
    return force / 0.1  # it is 0.1 m deep


@pytest.mark.parametrize("cell", [0.04, 0.025])
def test_block_on_a_floor_is_lifted_once_water_is_on_both_its_sides(cell: float) -> None:
    """Archimedes: water on both sides lifts by the weight of what the block displaces but in the lowest half cell, 2%;
    on one side it presses the block away, by half of rho g h^2, 5%, and lifts by no more than below a cell's width."""
    pressure = 1000.0 * GRAVITY * 0.2
    lift = pressure * (0.2 - cell / 2)
    assert _push_on_block(0.4, 0.4, cell=cell) == pytest.approx([0.0, 0.0, lift], abs=0.02 * lift)
    thrust = 0.5 * pressure * 0.2
    push = _push_on_block(0.4, 0.0, cell=cell)
    assert push[0] == pytest.approx(thrust, rel=0.05)
    assert 0.0 <= push[2] <= pressure * cell


@pytest.mark.parametrize("substep", [0.002, 0.004])
def test_disc_rebounds_from_the_floor_of_a_pool_no_farther_than_water_lets_it(substep: float) -> None:
    """A disc of 1.1 times water's density sinks at 0.35 m/s to the floor. Water that still sinks holds it back: with a
    restitution of 0.5 it comes up at 0.10 to 0.15 m/s by the FLIP of `tests.benchmarks.examination_scenes`, not at 0.17
    as in a vacuum, nor at 0.34 as where the water's blow is returned by the contact."""
    disc = RigidObject(
        name="disc",
        representation="rigid_planar",
        shape=Sphere(radius=0.05),
        density=1100.0,
        position=(0.3, 0.0, 0.15),
        velocity=(0.0, 0.0, -0.8),
        restitution=0.5,
    )
    floor = StaticObject(name="floor", shape=Plane(normal=(0, 0, 1), offset=0.0), restitution=0.5)
    scene = plane_world(
        pool("water", (0, 0), (0.6, 0.3)), size=(0.6, 0.5), cell=0.02, objects=(disc,), statics=(floor,)
    )
    times = np.arange(150) * 0.004
    speeds = simulator(scene.with_substep(substep), times).run().velocities[0, :, 0, 2]
    assert speeds.max() == pytest.approx(0.12, abs=0.05)


def test_light_block_rises_from_the_floor() -> None:
    """A block of 0.65 of water's density, flush with the floor, comes up and floats at its draft."""
    block = RigidObject(
        name="block",
        representation="rigid_planar",
        shape=Box(half_extents=(0.1, 0.05, 0.1)),
        density=650.0,
        position=(0.5, 0.0, 0.1),
    )
    pools = pool("left", (0.0, 0.0), (0.4, 0.4)), pool("right", (0.6, 0.0), (1.0, 0.4))
    over = pool("over", (0.4, 0.2), (0.6, 0.4))
    run = Run(plane_world(*pools, over, size=(1.0, 0.8), cell=0.04, objects=(block,)), step=0.004)
    run.run(2.0)
    heights = [float(run.bodies.numpy()["x"][0, 0, 2]) for _ in run.advance(2.0)]
    level = (0.36 + 0.65 * 0.04) / 1.0
    assert np.mean(heights) == pytest.approx(level + 0.1 - 0.65 * 0.2, abs=0.015)


def test_momentum_passes_between_body_and_fluid_and_none_is_lost() -> None:
    """Without gravity and walls, a moving plate hits a drop at rest: momentum drift below 1e-4 of what there is."""
    plate = RigidObject(
        name="plate",
        representation="rigid_planar",
        shape=Box(half_extents=(0.05, 0.05, 0.15)),
        density=600.0,
        position=(0.22, 0.0, 0.5),
        velocity=(1.0, 0.0, 0.0),
    )
    drop = pool("drop", (0.3, 0.4), (0.5, 0.6))
    run = Run(plane_world(drop, size=(1.2, 1.0), cell=0.02, gravity=0.0, objects=(plate,)))
    mass_of_plate = 600.0 * 0.1 * 0.3  # per metre of thickness
    start = mass_of_plate * 1.0
    run.run(0.15)
    _, v = run.present()
    fluid = 1000 * run.fluid.particle_volume * v.sum(axis=0)
    plate_v = run.bodies.numpy()["v"][0, 0]
    assert fluid[0] > 0.2 * start
    assert (fluid + mass_of_plate * plate_v)[[0, 2]] == pytest.approx([start, 0.0], abs=1e-6 * start)


def test_particles_are_never_inside_a_body_that_ploughs_through() -> None:
    ball = RigidObject(
        name="ball",
        representation="rigid_planar",
        shape=Sphere(radius=0.1),
        density=3000.0,
        position=(0.4, 0.0, 0.5),
        velocity=(0.5, 0.0, -1.0),
    )
    run = Run(plane_world(pool("water", (0, 0), (1, 0.3)), size=(1, 0.8), cell=0.02, objects=(ball,)))
    for _ in run.advance(0.4):
        x, _ = run.present()
        centre = run.bodies.numpy()["x"][0, 0]
        assert np.linalg.norm((x - centre)[:, [0, 2]], axis=1).min() >= 0.1 - 1e-9


def test_disc_that_falls_into_the_middle_of_a_pool_falls_straight() -> None:
    """What is symmetric stays so, to the accuracy of the pressure: 1e-5 of its speed of 1 m/s and of its spin."""
    disc = RigidObject(
        name="disc",
        representation="rigid_planar",
        shape=Sphere(radius=0.07),
        density=2000.0,
        position=(0.3, 0.0, 0.2),
        velocity=(0.0, 0.0, -0.5),
    )
    run = Run(plane_world(pool("water", (0, 0), (0.6, 0.15)), size=(0.6, 0.5), cell=0.03, objects=(disc,)))
    run.run(0.06)
    disc_now = run.bodies.numpy()[0, 0]
    assert disc_now["x"][2] < 0.165
    assert abs(disc_now["v"][0]) < 1e-5
    assert abs(disc_now["w"][1]) < 1e-5


def _bucket() -> World:
    """A bucket of 0.24 kg, walls of one cell, with 6.7 kg of water in it. In space."""
    walls = [
        Part(shape=Box(half_extents=(0.12, 0.12, 0.01)), position=(0.0, 0.0, -0.11)),
        Part(shape=Box(half_extents=(0.01, 0.12, 0.1)), position=(0.11, 0.0, 0.0)),
        Part(shape=Box(half_extents=(0.01, 0.12, 0.1)), position=(-0.11, 0.0, 0.0)),
        Part(shape=Box(half_extents=(0.1, 0.01, 0.1)), position=(0.0, 0.11, 0.0)),
        Part(shape=Box(half_extents=(0.1, 0.01, 0.1)), position=(0.0, -0.11, 0.0)),
    ]
    bucket = RigidObject(
        name="bucket",
        representation="rigid_spatial",
        shape=Compound(parts=tuple(walls)),
        density=50.0,
        position=(0.2, 0.2, 0.2),
    )
    volume = FluidVolume(shape=Box(half_extents=(0.1, 0.1, 0.08)), position=(0.2, 0.2, 0.2071))  # on its floor
    water = Fluid(name="water", volumes=(volume,))
    grid = FluidGrid(lower=(0, 0, 0), upper=(0.4, 0.4, 0.4), cell=0.02)
    return World(objects=(bucket,), deformables=(water,), fluid_grid=grid)


@pytest.mark.benchmark
def test_light_bucket_held_by_a_support_bears_the_water_in_it() -> None:
    """A bucket's support carries the water too: the water's push is predicted, so that the support can resist it.

    The support sets the bucket's velocity to zero, as a joint or a contact would in the rigid step. The water stays,
    and the support's force becomes the weight of both; 3%.
    """
    run = Run(_bucket(), step=0.002)
    start = run.present()[0][:, 2].mean()
    bodies = run.bodies.numpy()
    mass = 1.0 / bodies["inverse_mass"][0, 0]
    forces = []
    for _ in range(300):
        run.fluid.apply_prediction(run.clock)
        bodies["v"] += run.step * run.gravity
        forces.append(-mass * bodies["v"][0, 0, 2] / run.step)
        bodies["v"][:], bodies["w"][:] = 0.0, 0.0
        run.fluid.step(run.clock)
    x, _ = run.present()
    weight = GRAVITY * (mass + 1000 * len(x) * run.fluid.particle_volume)
    assert np.mean(forces[-50:]) == pytest.approx(weight, rel=0.03)
    assert x[:, 2].mean() == pytest.approx(start, abs=0.015)
    inside = (np.abs(x[:, :2] - 0.2) < 0.1).all(axis=1)
    assert inside.all()
