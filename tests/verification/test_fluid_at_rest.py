"""Fluids that should be at rest, or come to rest with the volume they had. Planar, per metre of thickness."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.world import StaticObject
from polyworld.world.shapes import Box, Plane
from tests.polyworld.solver.fluid.scenes import GRAVITY, Run, plane_world, pool


@pytest.mark.parametrize("cell", [0.02, 0.04])
def test_hydrostatic_pressure_is_rho_g_depth(cell: float) -> None:
    """p = rho g (H - z), Archimedes and Stevin; 0.5%."""
    run = Run(plane_world(pool("water", (0, 0), (0.4, 0.4)), size=(0.4, 0.6), cell=cell))
    run.run(0.2)
    z = np.array([0.03, 0.11, 0.2, 0.31])
    points = np.stack([np.full(4, 0.21), np.zeros(4), z], axis=1)
    assert run.fluid.pressure_at(points)[0] == pytest.approx(1000 * GRAVITY * (0.4 - z), rel=0.005)
    assert np.abs(run.present()[1]).max() < 1e-3


def test_hydrostatic_pressure_over_walls_that_lie_across_the_cells() -> None:
    """The same over a floor in the middle of a cell and beside a wall that stands at 30 degrees to the grid; 2%."""
    floor = StaticObject(name="floor", shape=Plane(offset=0.011))
    slope = StaticObject(
        name="slope",
        shape=Box(half_extents=(0.1, 1.0, 0.6)),
        position=(0.0, 0.0, 0.3),
        orientation=(np.cos(np.pi / 12), 0.0, np.sin(np.pi / 12), 0.0),
    )
    world = plane_world(pool("water", (0, 0), (0.6, 0.4)), size=(0.6, 0.6), cell=0.02, statics=(floor, slope))
    run = Run(world)
    run.run(1.0)
    x, v = run.present()
    z = np.array([0.1, 0.2])
    pressures = run.fluid.pressure_at(np.stack([np.full(2, 0.5), np.zeros(2), z], axis=1))[0]
    assert np.diff(pressures)[0] == pytest.approx(-1000 * GRAVITY * 0.1, rel=0.02)
    assert x[:, 2].min() >= 0.011
    assert np.sqrt((v**2).mean()) < 0.02


@pytest.mark.parametrize(
    ("cell", "duration", "tolerance"),
    [(0.02, 5.0, 0.005), pytest.param(0.04, 20.0, 0.01, marks=pytest.mark.benchmark)],
)
def test_settled_volume_is_that_poured_in(cell: float, duration: float, tolerance: float) -> None:
    """A column falls over and sloshes; what lies under its surface, over the last half second, is its volume."""
    run = Run(plane_world(pool("water", (0, 0), (0.4, 0.5)), size=(1.0, 1.0), cell=cell), step=0.004)
    run.run(duration - 0.5)
    heights = [_mean_height(run, cell) for i, _ in enumerate(run.advance(0.5)) if i % 10 == 0]
    assert len(run.present()[0]) * run.fluid.particle_volume == pytest.approx(0.2)
    assert np.mean(heights) == pytest.approx(0.2, rel=tolerance)


def _mean_height(run: Run, cell: float) -> float:
    """Mean over the box's columns of the height of their highest surface."""
    line = np.arange(0.5 * cell, 1.0, cell)
    x, z = np.meshgrid(line, line, indexing="ij")
    points = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3)
    level = run.fluid.level_at(points)[0].reshape(x.shape)
    total = 0.0
    for column in level:
        top = int(np.flatnonzero(column < 0).max())
        total += line[top] + cell * column[top] / (column[top] - column[top + 1])
    return total / len(line)


def test_water_at_rest_between_walls_that_line_its_box_stays_at_rest() -> None:
    """Floor and walls that lie along the box's sides take no room twice: no creep in 3 s, particles stay spread."""
    floor = StaticObject(name="floor", shape=Plane())
    walls = (
        StaticObject(name=name, shape=Box(half_extents=(0.02, 1.0, 0.4)), position=(x, 0.0, 0.4))
        for name, x in (("west", -0.02), ("east", 0.42))
    )
    world = plane_world(pool("water", (0, 0), (0.4, 0.24)), size=(0.4, 0.5), cell=0.04, statics=(floor, *walls))
    run = Run(world, step=0.004)
    run.run(3.0)
    x, v = run.present()
    assert x[:, 2].mean() == pytest.approx(0.12, rel=0.005)
    assert np.sqrt((v**2).sum(axis=1).mean()) < 1e-3
    counts = np.unique(np.floor(x / 0.04).astype(int), axis=0, return_counts=True)[1]
    assert counts.min() >= 3  # 4 at the start
    assert counts.max() <= 5


def test_still_water_whose_surface_lies_within_a_cell_keeps_its_height_within_its_cell() -> None:
    """Half a cell of liquid over the last full one. Its top stirs by centimetres a second, since the topmost particles
    fall a little and are lifted again, and its centre rises by a tenth of a cell: 2% of this depth of 6.5 cells.
    """
    run = Run(plane_world(pool("water", (0, 0), (0.4, 0.26)), size=(0.4, 0.5), cell=0.04), step=0.004)
    run.run(6.0)
    x, v = run.present()
    assert x[:, 2].mean() == pytest.approx(0.13, abs=0.004)
    assert np.sqrt((v**2).sum(axis=1).mean()) < 0.1


def test_layers_of_different_density_stay_at_rest() -> None:
    """Oil on water: pressures add up, and the interface does not mix in a second."""
    oil, water = pool("oil", (0, 0.2), (0.4, 0.3), density=800.0), pool("water", (0, 0), (0.4, 0.2))
    run = Run(plane_world(oil, water, size=(0.4, 0.5), cell=0.02))
    run.run(1.0)
    points = np.array([[0.2, 0, 0.25], [0.2, 0, 0.11]])
    exact = GRAVITY * np.array([800 * 0.05, 800 * 0.1 + 1000 * 0.09])
    assert run.fluid.pressure_at(points)[0] == pytest.approx(exact, rel=0.01)
    x, _, fluid = run.fluid.particles()
    assert x[0, fluid[0] == 0, 2].min() > x[0, fluid[0] == 1, 2].max() - 0.01


def test_heavy_over_light_overturns() -> None:
    """Rayleigh-Taylor: most of the heavy layer ends below, however much the two have mixed on the way."""
    heavy, light = pool("heavy", (0, 0.15), (0.2, 0.3), density=3000.0), pool("light", (0, 0), (0.2, 0.15))
    dent = pool("dent", (0.0, 0.3), (0.1, 0.31), density=3000.0)
    run = Run(plane_world(heavy, light, dent, size=(0.2, 0.4), cell=0.01), step=0.004)
    run.run(3.0)
    x, _, fluid = run.fluid.particles()
    assert x[0, fluid[0] == 0, 2].mean() < 0.15  # 0.225 at the start, 0.075 fully below
    assert x[0, fluid[0] == 1, 2].mean() > 0.15 + 0.3 * 0.075
