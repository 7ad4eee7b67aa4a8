"""Check the water of scenes against measurements and closed forms."""

import math

import numpy as np
import pytest

from tests.benchmarks.examination_scenes.solids import Solid
from tests.benchmarks.examination_scenes.water import DENSITY, GRAVITY, Tank


def run(tank: Tank, duration: float) -> None:
    """Step a tank for a duration [s]."""
    step = tank.cell / 5
    for _ in range(round(duration / step)):
        tank.step(step)


def test_front_of_a_column_advances_as_martin_and_moyce_measured() -> None:
    """Phil. Trans. R. Soc. A 244 (1952), column twice as high as wide, a = 2.25 inches.

    Time is t sqrt(2 g / a), place x / a. The measured column starts later, as its membrane does not vanish at once, so
    the time between two places is compared, and the start to 0.25 only.
    """
    width = 0.057
    tank = Tank((4.5 * width, 2.5 * width), width / 16, ((0, 0, width, 2 * width),))
    times, fronts = [0.0], [1.0]
    while fronts[-1] < 3.6:
        run(tank, tank.cell / 5)
        times.append(times[-1] + tank.cell / 5 * math.sqrt(2 * GRAVITY / width))
        fronts.append(float(np.sort(tank.at[:, 0])[-4]) / width)
    measured = {1.44: 1.19, 1.89: 1.63, 2.33: 1.98, 2.78: 2.32, 3.22: 2.65, 3.44: 2.83}
    seen = np.interp(list(measured), fronts, times)
    np.testing.assert_allclose(seen, list(measured.values()), atol=0.25)
    assert seen[-1] - seen[0] == pytest.approx(2.83 - 1.19, rel=0.05)


def test_water_at_rest_has_hydrostatic_pressure_and_stays() -> None:
    tank = Tank((0.5, 0.3), 0.02, ((0, 0, 0.5, 0.2),))
    run(tank, 1.0)
    depth = 0.2 - (np.arange(10) + 0.5) * 0.02
    np.testing.assert_allclose(tank.pressure[12, :10], DENSITY * GRAVITY * depth, atol=0.1 * DENSITY * GRAVITY * 0.02)
    assert np.abs(tank.velocities).max() < 0.01


@pytest.mark.parametrize("density", [pytest.param(0.3, marks=pytest.mark.benchmark), 0.6])
def test_plank_floats_as_deep_as_archimedes_says(density: float) -> None:
    half = 0.1, 0.04
    plank = Solid(half, 4 * half[0] * half[1] * DENSITY * density, np.array([0.4, 0.25]), np.zeros(3), 0.3)
    tank = Tank((0.8, 0.4), 0.02, ((0, 0, 0.8, 0.2),), [plank])
    before = tank.energy
    places = []
    for _ in range(9):
        run(tank, 0.25)
        places.append(plank.place[1])
    level = (0.8 * 0.2 + 4 * half[0] * half[1] * density) / 0.8
    assert np.mean(places[-5:]) - half[1] == pytest.approx(level - 2 * half[1] * density, abs=0.01)  # half a cell
    assert tank.energy < before


def test_disc_in_deep_water_falls_with_its_added_mass() -> None:
    """Lamb, Hydrodynamics: a cylinder carries along as much mass as it displaces; the walls are ten radii away."""
    radius, heavy = 0.05, 2.0
    disc = Solid((radius,), math.pi * radius**2 * DENSITY * heavy, np.array([0.5, 0.5]), np.zeros(3), 0.3)
    tank = Tank((1.0, 1.0), 0.0125, ((0, 0, 1.0, 0.95),), [disc])
    run(tank, 0.1)
    assert -disc.motion[1] / 0.1 == pytest.approx(GRAVITY * (heavy - 1) / (heavy + 1), rel=0.05)


def test_box_on_the_dry_floor_slides_to_where_friction_stops_it() -> None:
    box = Solid((0.05, 0.05), 5.0, np.array([0.2, 0.05]), np.array([1.0, 0.0, 0.0]), 0.25)
    run(Tank((0.6, 0.2), 0.01, (), [box]), 0.5)
    assert box.place[0] - 0.2 == pytest.approx(1 / (2 * 0.25 * GRAVITY), rel=0.05)


def test_disc_bounces_off_a_box_and_keeps_the_momentum() -> None:
    box = Solid((0.05, 0.05), 5.0, np.array([0.5, 0.05]), np.zeros(3), 0.0)
    disc = Solid((0.05,), 5.0, np.array([0.3, 0.05]), np.array([1.0, 0.0, 0.0]), 0.0)
    run(Tank((1.0, 0.4), 0.01, (), [box, disc], restitution=0.4), 0.2)
    assert (disc.motion[0], box.motion[0]) == pytest.approx((0.3, 0.7), abs=0.01)


def test_light_box_that_stands_on_the_floor_rises() -> None:
    box = Solid((0.05, 0.05), 3.0, np.array([0.4, 0.05]), np.zeros(3), 0.3)
    run(Tank((0.8, 0.4), 0.02, ((0, 0, 0.8, 0.2),), [box]), 1.0)
    assert box.place[1] > 0.15
