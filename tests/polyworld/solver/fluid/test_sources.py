"""Emitters and drains: rates, schedules, and where particles start."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.solver.fluid.seeding import fluid_particles
from polyworld.solver.fluid.solver import FluidSolver
from polyworld.world import Environment, MotionPlane, World
from polyworld.world.representations.fluid import Drain, Emitter, Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere
from tests.polyworld.solver.fluid.scenes import Run, plane_world, pool


def _tap(**changes: object) -> Emitter:
    values = {
        "name": "tap",
        "fluid": "water",
        "position": (0.3, 0.0, 0.5),
        "direction": (0, 0, -1),
        "radius": 0.03,
        "rate": 0.05,
        **changes,
    }
    return Emitter(**values)


def _empty(name: str = "water") -> Fluid:
    return Fluid(name=name, representation="fluid_planar")


def test_emitter_sends_its_rate_between_start_and_end() -> None:
    """Volume is rate times time to within one particle."""
    world = plane_world(_empty(), size=(0.6, 0.6), cell=0.02, emitters=(_tap(start=0.1, end=0.5),))
    run = Run(world, horizon=1.0)
    particle = run.fluid.particle_volume
    run.run(0.1)
    assert len(run.present()[0]) == 0
    run.run(0.2)
    assert run.fluid.flow()["tap"][0] == pytest.approx(0.05 * 0.2, abs=particle)
    run.run(0.4)
    assert run.fluid.flow()["tap"][0] == pytest.approx(0.05 * 0.4, abs=particle)
    assert len(run.present()[0]) * particle == pytest.approx(run.fluid.flow()["tap"][0])


def test_schedule_scales_the_rate_linearly_between_its_points() -> None:
    """A ramp 0 to 1 over 0.4 s sends half of what the full rate would."""
    tap = _tap(schedule=((0.0, 0.0), (0.4, 1.0)))
    run = Run(plane_world(_empty(), size=(0.6, 0.6), cell=0.02, emitters=(tap,)), horizon=0.4)
    run.run(0.4)
    assert run.fluid.flow()["tap"][0] == pytest.approx(0.05 * 0.2, abs=1.5 * run.fluid.particle_volume)
    assert not run.fluid.full.any()


def test_jet_leaves_with_the_speed_that_its_rate_and_mouth_imply() -> None:
    tap = _tap(direction=(1, 0, 0), rate=0.06)
    run = Run(plane_world(_empty(), size=(0.6, 0.6), cell=0.02, gravity=0.0, emitters=(tap,)), horizon=1.0)
    run.run(0.2)
    _, v = run.present()
    assert v == pytest.approx(np.tile([0.06 / 0.06, 0.0, 0.0], (len(v), 1)), abs=0.02)


def test_round_nozzle_of_space_spreads_over_its_mouth() -> None:
    tap = Emitter(name="tap", fluid="water", position=(0.1, 0.1, 0.18), radius=0.03, rate=1e-3)
    grid = FluidGrid(lower=(0, 0, 0), upper=(0.2, 0.2, 0.2), cell=0.01)
    run = Run(World(deformables=(Fluid(name="water"),), fluid_grid=grid, emitters=(tap,)), horizon=0.1)
    run.run(0.1)
    x, _ = run.present()
    r = np.hypot(x[:, 0] - 0.1, x[:, 1] - 0.1)
    young = x[:, 2] > 0.15
    assert len(x) * run.fluid.particle_volume == pytest.approx(1e-4, rel=0.01)
    assert r[young].max() < 0.032
    assert (r[young] ** 2).mean() == pytest.approx(0.03**2 / 2, rel=0.1)  # even over the disc


def test_drain_takes_no_faster_than_its_rate() -> None:
    drain = Drain(name="hole", lower=(0.4, -1, 0.0), upper=(0.5, 1, 0.1), rate=0.02, start=0.1)
    run = Run(plane_world(pool("water", (0, 0), (0.6, 0.2)), size=(0.6, 0.6), cell=0.02, drains=(drain,)))
    run.run(0.6)
    taken = run.fluid.flow()["hole"][0]
    assert taken == pytest.approx(0.02 * 0.5, abs=2 * run.fluid.particle_volume)
    assert len(run.present()[0]) * run.fluid.particle_volume == pytest.approx(0.12 - taken)


def test_drain_without_rate_takes_all_that_comes() -> None:
    drain = Drain(name="hole", lower=(0.5, -1, 0.0), upper=(0.6, 1, 0.6))
    run = Run(plane_world(pool("water", (0, 0), (0.2, 0.2)), size=(0.6, 0.6), cell=0.02, drains=(drain,)))
    run.run(1.5)
    assert run.fluid.amount((0.5, -1, 0), (0.6, 1, 0.6))[0, 0] == 0.0
    assert run.fluid.flow()["hole"][0] > 0.02


def test_fluid_leaves_through_the_sides_of_an_open_grid() -> None:
    run = Run(plane_world(pool("water", (0.2, 0.1), (0.4, 0.3)), size=(0.6, 0.5), cell=0.02, closed=False))
    run.run(0.5)
    assert len(run.present()[0]) == 0


def test_rates_of_a_batch_give_each_world_its_own_flow() -> None:
    run = Run(plane_world(_empty(), size=(0.6, 0.6), cell=0.02, emitters=(_tap(),)), n_worlds=2, horizon=0.3)
    assert run.fluid.write({"tap": {"rate": np.array([0.02, 0.1])}})
    run.fluid.reset()
    run.run(0.3)
    assert run.fluid.flow()["tap"] == pytest.approx([0.006, 0.03], abs=run.fluid.particle_volume)
    assert not run.fluid.full.any()


def test_too_many_particles_are_refused_with_the_numbers() -> None:
    world = plane_world(_empty(), size=(0.6, 0.6), cell=0.02, emitters=(_tap(rate=10.0),))
    with pytest.raises(ValueError, match=r"fluid particles.*more than 8000000.*from the emitters within 100 s.*tap"):
        FluidSolver(world, 1, 100.0)


def test_emitter_out_of_the_plane_is_refused() -> None:
    world = plane_world(_empty(), size=(0.6, 0.6), cell=0.02, emitters=(_tap(direction=(0, 1, -1)),))
    with pytest.raises(ValueError, match="leaves the motion plane"):
        FluidSolver(world, 1, 1.0)


def test_plane_across_the_axes_is_refused() -> None:
    world = plane_world(pool("water", (0, 0), (0.2, 0.2)), size=(0.6, 0.6), cell=0.02)
    tilted = world.model_copy(
        update={
            "environment": Environment(
                gravity=(0, 0, -9.81), motion_plane=MotionPlane(normal=(1, 1, 0), supports=False)
            )
        }
    )
    with pytest.raises(ValueError, match="planes along the axes"):
        FluidSolver(tilted, 1, 1.0)


def _collapse(axis: int) -> np.ndarray:
    """Places (k, 2) of a collapsed column in the plane across an axis, gravity along the second axis of the plane."""
    across = np.eye(3)[axis]
    first, down = np.eye(3)[[i for i in range(3) if i != axis]]

    def triple(vector: np.ndarray) -> tuple[float, float, float]:
        return float(vector[0]), float(vector[1]), float(vector[2])

    volume = FluidVolume(
        shape=Box(half_extents=triple(0.1 * first + 0.15 * down + across)), position=triple(0.1 * first + 0.15 * down)
    )
    water = Fluid(name="water", representation="fluid_planar", volumes=(volume,))
    environment = Environment(
        gravity=triple(-9.81 * down), motion_plane=MotionPlane(normal=triple(across), supports=False)
    )
    grid = FluidGrid(lower=(0, 0, 0), upper=triple(0.6 * first + 0.4 * down + 0.1 * across), cell=0.02)
    run = Run(World(deformables=(water,), fluid_grid=grid, environment=environment))
    run.run(0.3)
    return run.present()[0] @ np.stack([first, down], axis=1)


def test_any_plane_along_the_axes_gives_the_same_flow() -> None:
    reference = _collapse(1)
    assert reference[:, 0].max() > 0.45
    for axis in (0, 2):
        assert _collapse(axis) == pytest.approx(reference, abs=1e-6)


def test_fluid_fills_its_volumes_once_and_leaves_out_what_is_taken() -> None:
    ball = RigidObject(
        name="ball", representation="rigid_planar", shape=Sphere(radius=0.1), position=(0.3, 0.0, 0.2), density=500.0
    )
    box = FluidVolume(shape=Box(half_extents=(0.3, 1.0, 0.2)), position=(0.3, 0.0, 0.2))
    twice = Fluid(name="water", representation="fluid_planar", volumes=(box, box))
    oil = Fluid(name="oil", representation="fluid_planar", volumes=(box,))
    world = plane_world(twice, oil, size=(0.6, 0.6), cell=0.02, objects=(ball,))
    water = fluid_particles(world, twice)
    assert water.measure.sum() == pytest.approx(0.24 - np.pi * 0.01, rel=0.01)
    assert len(fluid_particles(world, oil).nodes) == 0
    assert np.array_equal(water.nodes, fluid_particles(world, twice).nodes)
    assert np.linalg.norm(water.nodes - [0.3, 0.0, 0.2], axis=1).min() > 0.1
