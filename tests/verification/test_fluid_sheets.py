"""Light sheets in water: many times more water than sheet moves with it, so that each exchange could overshoot."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.solver.rollout import simulator
from polyworld.world import World
from polyworld.world.representations.attachment import Attachment, Region
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.fluid import Fluid, FluidGrid, FluidVolume
from polyworld.world.shapes import Box
from tests.polyworld.solver.fluid.scenes import GRAVITY

Array = NDArray[np.float64]

AREAL_DENSITY, SIDE, CELL = 0.4, 0.2, 0.03
BAR = Attachment(name="bar", object="sheet", region=Region(lower=(-0.1, -0.2, 0.179), upper=(0.1, 0.2, 0.181)))
HANGING = Sheet(corner=(0.0, -0.1, 0.18), edge_u=(0.0, SIDE, 0.0), edge_v=(0.0, 0.0, -0.15), divisions=(8, 6))
ABOVE = Sheet(corner=(-0.1, -0.1, 0.3), edge_u=(SIDE, 0.0, 0.0), edge_v=(0.0, SIDE, 0.0), divisions=(8, 8))


def _run(
    geometry: Sheet, thickness: float, duration: float, *attachments: Attachment
) -> tuple[Array, Array, Array, Array]:
    """Every 40 ms: points and velocities (T, k, 3) of the sheet, kinetic energy and that of height of both (T,)."""
    sheet = Cloth(
        name="sheet",
        geometry=geometry,
        areal_density=AREAL_DENSITY,
        stretch_stiffness=800.0,
        bending_stiffness=1e-4,
        stretch_damping=0.01,
        thickness=thickness,
    )
    volume = FluidVolume(shape=Box(half_extents=(0.15, 0.15, 0.105)), position=(0.0, 0.0, 0.105))
    world = World(
        deformables=(sheet, Fluid(name="water", volumes=(volume,))),
        attachments=attachments,
        fluid_grid=FluidGrid(lower=(-0.15, -0.15, 0.0), upper=(0.15, 0.15, 0.42), cell=CELL),
    )
    times = np.arange(0.0, duration + 1e-9, 0.04)
    rollout = simulator(world, times, n_worlds=1).run()
    assert not rollout.diverged.any()
    kinetic, height = np.zeros(len(times)), np.zeros(len(times))
    masses = {"water": 1000.0 * (CELL / 2) ** 3, "sheet": AREAL_DENSITY * mesh_of(world, sheet).measure}
    for name, mass in masses.items():
        motion = rollout.deformables[name]
        kinetic += 0.5 * (mass * (motion.velocities[0] ** 2).sum(axis=-1)).sum(axis=-1)
        height += GRAVITY * (mass * motion.points[0, ..., 2]).sum(axis=-1)
    own = rollout.deformables["sheet"]
    return own.points[0], own.velocities[0], kinetic, height


@pytest.mark.benchmark
@pytest.mark.parametrize(
    ("thickness", "fastest"), [pytest.param(0.0004, 0.04, marks=pytest.mark.benchmark), (0.004, 0.15)]
)
def test_light_sheet_hung_in_still_water_comes_to_rest(thickness: float, fastest: float) -> None:
    """One as heavy as water hangs still; one of foam, a tenth as heavy, rises and then lies still on the surface."""
    points, velocities, _, _ = _run(HANGING, thickness, 2.0, BAR)
    assert np.sqrt((velocities[-10:] ** 2).sum(axis=-1)).max() < fastest
    if thickness > 0.001:
        assert points[-1, :, 2].min() > 0.15
    else:
        assert points[-1, :, 2].min() < 0.06


def test_light_sheet_that_falls_on_water_gains_no_energy() -> None:
    """It brings its height, 9 cm: never more than that moves, a twentieth of it in the end, and little is stored in
    the water's height (1e-4 of it: particles of still water settle by so much)."""
    points, velocities, kinetic, height = _run(ABOVE, 0.0004, 1.2)
    brought = AREAL_DENSITY * SIDE**2 * GRAVITY * 0.09
    assert kinetic.max() < brought
    assert kinetic[-5:].max() < 0.05 * brought
    total = kinetic + height
    assert (total - total[0]).max() < 3e-4 * total[0]
    assert np.sqrt((velocities[-5:] ** 2).sum(axis=-1)).max() < 0.3
    assert np.abs(points[-1, :, 2] - 0.2).max() < 0.1
