"""Meshes as obstacles, and soft bodies and ropes in a liquid, in the coupled simulator."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from polyworld.solver.rollout import simulator
from polyworld.world import Environment, StaticObject, TimeBase, World
from polyworld.world.representations.fluid import Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, TriangleMesh
from tests.polyworld.solver.fluid.scenes import GRAVITY, Run


def _block(x: float, y: float, z: float) -> Fluid:
    """Water from the origin to (x, y, z)."""
    volume = FluidVolume(shape=Box(half_extents=(x / 2, y / 2, z / 2)), position=(x / 2, y / 2, z / 2))
    return Fluid(name="water", volumes=(volume,))


def test_water_stands_beside_a_mesh_that_lies_across_the_cells() -> None:
    """Pressure beside a block given by its triangles is rho g depth, 3%, and no particle gets into it."""
    block = trimesh.creation.box(extents=(0.1, 0.4, 0.2))
    block.apply_translation((0.05, 0.2, 0.1))
    shape = TriangleMesh(
        vertices=[tuple(v) for v in block.vertices.tolist()], faces=[tuple(f) for f in block.faces.tolist()]
    )
    world = World(
        statics=(StaticObject(name="block", shape=shape),),
        deformables=(_block(0.4, 0.4, 0.2),),
        fluid_grid=FluidGrid(lower=(0, 0, 0), upper=(0.4, 0.4, 0.4), cell=0.04),
    )
    run = Run(world, step=0.004)
    run.run(0.2)
    pressures = [run.fluid.pressure_at(np.array([[0.3, 0.2, 0.06]]))[0, 0] for _ in run.advance(0.2)]
    assert np.mean(pressures) == pytest.approx(1000 * GRAVITY * 0.14, rel=0.03)
    x, _ = run.present()
    assert not ((x[:, 0] < 0.0999) & (x[:, 2] < 0.1999)).any()


def test_soft_slab_of_half_density_floats_at_half_its_depth() -> None:
    """Draft of a soft slab, 10 cm thick: 5 cm within 0.15 of a cell of 25 mm, mean over its bobbing."""
    slab = Soft(
        name="slab",
        shape=Box(half_extents=(0.1, 0.1, 0.05)),
        density=500.0,
        youngs_modulus=2e4,
        damping=0.02,
        position=(0.15, 0.15, 0.2),
        resolution=0.1,
    )
    world = World(
        deformables=(slab, _block(0.3, 0.3, 0.2)),
        fluid_grid=FluidGrid(lower=(0, 0, 0), upper=(0.3, 0.3, 0.3), cell=0.025),
        time=TimeBase(substep=0.004),
    )
    rollout = simulator(world, np.linspace(0.0, 0.8, 17), n_worlds=1).run()
    assert not rollout.diverged.any()
    bottom = rollout.positions[0, 8:, 0, 2].mean() - 0.05
    volume = np.isfinite(rollout.deformables["water"].points[0, -1, :, 0]).sum() * 0.0125**3
    level = (volume - 0.04 * bottom) / 0.05
    assert level - bottom == pytest.approx(0.05, abs=0.00375)


def test_rope_in_a_drop_that_floats_free_passes_its_momentum_to_it() -> None:
    """Without gravity a rope shot into a drop is slowed, the drop carried along; momentum drift below 1e-4."""
    rope = Rope(
        name="rope",
        points=((0.12, 0.2, 0.2), (0.28, 0.2, 0.2)),
        segments=8,
        radius=0.01,
        linear_density=0.5,
        stretch_stiffness=200.0,
        velocity=(0.0, 0.0, 0.5),
    )
    volume = FluidVolume(shape=Box(half_extents=(0.08, 0.08, 0.06)), position=(0.2, 0.2, 0.2))
    water = Fluid(name="water", volumes=(volume,))
    world = World(
        deformables=(rope, water),
        fluid_grid=FluidGrid(lower=(0, 0, 0), upper=(0.4, 0.4, 0.5), cell=0.02),
        environment=Environment(gravity=(0, 0, 0)),
        time=TimeBase(substep=0.004),
    )
    rollout = simulator(world, np.array([0.0, 0.1]), n_worlds=1).run()
    v = rollout.deformables["water"].velocities[0, -1, :, 2]
    water_mass = 1000 * 0.01**3
    momentum = 0.08 * rollout.velocities[0, -1, 0, 2] + water_mass * np.nansum(v)
    assert rollout.velocities[0, -1, 0, 2] < 0.4
    assert momentum == pytest.approx(0.08 * 0.5, rel=1e-4)
