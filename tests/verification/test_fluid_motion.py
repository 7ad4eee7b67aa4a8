"""Fluids in motion against closed forms and measurements. Planar, per metre of thickness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from polyworld.world import StaticObject
from polyworld.world.representations.fluid import FluidVolume
from polyworld.world.shapes import Box, ConvexMesh
from tests.polyworld.solver.fluid.scenes import GRAVITY, Run, plane_world, pool

MARTIN_MOYCE = Path(__file__).parents[2].parent / "shared/data/dam_break/martin_moyce_1952_a2.25in.csv"


@pytest.mark.skipif(not MARTIN_MOYCE.exists(), reason="../shared/data/dam_break is absent")
@pytest.mark.parametrize(("cells", "tolerance"), [(16, 0.05), (8, 0.10)])
def test_dam_break_front_follows_martin_and_moyce(cells: int, tolerance: float) -> None:
    """Front of a column of width a = 2.25 in, height 2 a (Martin & Moyce 1952, fig. 3); rms of relative deviation.

    The measured clock starts when the diaphragm goes, a computed column falls at once: one offset of the time, at
    most 0.5 in T = t sqrt(2 g / a), is taken out. The column is `cells` wide and sticks to the bed.
    """
    a = 0.05715
    cell = a / cells
    water = pool("water", (0, 0), (a, 2 * a), slip=False)
    run = Run(plane_world(water, size=(16 * a, 2.5 * a), cell=cell))
    times, fronts = [0.0], [1.0]
    for time in run.advance(0.53):
        times.append(time * np.sqrt(2 * GRAVITY / a))
        fronts.append((run.present()[0][:, 0].max() + cell / 4) / a)
    measured_time, measured = np.loadtxt(MARTIN_MOYCE, delimiter=",", skiprows=2).T

    def deviation(offset: float) -> float:
        computed = np.interp(measured_time - offset, times, fronts)
        return float(np.sqrt(np.mean((computed / measured - 1) ** 2)))

    assert minimize_scalar(deviation, bounds=(0.0, 0.5), method="bounded").fun < tolerance


@pytest.mark.parametrize(("cell", "tolerance"), [pytest.param(0.02, 0.02, marks=pytest.mark.benchmark), (0.04, 0.04)])
def test_sloshing_has_the_frequency_of_a_standing_wave(cell: float, tolerance: float) -> None:
    """omega^2 = g k tanh(k h), k = pi / L, first mode of a box (Lamb 1932, art. 228)."""
    length, depth, amplitude = 0.96, 0.32, 0.02
    x = np.linspace(0.0, length, 33)
    top = depth + amplitude * np.cos(np.pi * x / length)
    base = pool("water", (0, 0), (length, depth - 2 * amplitude))
    strips = [
        FluidVolume(
            shape=ConvexMesh(vertices=[(px, y, pz) for px, pz in corners for y in (-1.0, 1.0)]),
            position=(float(np.mean(x[i : i + 2])), 0.0, 0.0),
        )
        for i, corners in enumerate(_strips(x, top))
    ]
    placed = [s.model_copy(update={"position": _centre(x, top, i)}) for i, s in enumerate(strips)]
    water = base.model_copy(update={"volumes": tuple(placed)})
    run = Run(plane_world(water, size=(length, 0.48), cell=cell), step=0.004)
    times, tilt = [], []
    for time in run.advance(3.2):
        times.append(time)
        tilt.append(run.present()[0][:, 0].mean() - length / 2)
    zeros = _zeros(np.array(times), np.array(tilt))
    k = np.pi / length
    period = 2 * np.pi / np.sqrt(GRAVITY * k * np.tanh(k * depth))
    assert 2 * np.diff(zeros).mean() == pytest.approx(period, rel=tolerance)


def _strips(x: np.ndarray, top: np.ndarray) -> list[list[tuple[float, float]]]:
    return [
        [(float(x[i]), 0.0), (float(x[i + 1]), 0.0), (float(x[i]), float(top[i])), (float(x[i + 1]), float(top[i + 1]))]
        for i in range(len(x) - 1)
    ]


def _centre(x: np.ndarray, top: np.ndarray, i: int) -> tuple[float, float, float]:
    """Centre of mass of a strip, where a convex mesh has its origin."""
    a, b, w = top[i], top[i + 1], x[i + 1] - x[i]
    return float(x[i] + w * (a + 2 * b) / (3 * (a + b))), 0.0, float((a * a + a * b + b * b) / (3 * (a + b)))


def _zeros(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Times at which a series passes zero, linear between its points."""
    i = np.flatnonzero(np.diff(np.sign(values)) != 0)
    zeros: np.ndarray = times[i] - values[i] * (times[i + 1] - times[i]) / (values[i + 1] - values[i])
    return zeros


def test_drop_in_free_fall_falls_exactly() -> None:
    """All of it falls alike: velocity g t, fall g h^2 n (n + 1) / 2 of the discrete sum, nothing else."""
    run = Run(plane_world(pool("drop", (0.2, 0.7), (0.3, 0.8)), size=(0.5, 1.0), cell=0.02))
    start = run.present()[0]
    run.run(0.3)
    x, v = run.present()
    n = round(0.3 / run.step)
    fall = GRAVITY * run.step**2 * n * (n + 1) / 2
    assert v[:, 2] == pytest.approx(np.full(len(v), -GRAVITY * 0.3), rel=1e-4)
    assert start[:, 2] - x[:, 2] == pytest.approx(np.full(len(x), fall), rel=1e-3)
    assert x[:, 0] == pytest.approx(start[:, 0], abs=1e-4)


def test_momentum_of_a_drop_without_gravity_is_kept() -> None:
    """Pressure is internal: a rotating and stretching drop keeps its momentum to 1e-4."""
    drop = pool("drop", (0.1, 0.1), (0.2, 0.15), velocity=(0.3, 0.0, 0.1))
    run = Run(plane_world(drop, size=(0.6, 0.4), cell=0.01, gravity=0.0))
    run.run(0.5)
    assert run.present()[1].mean(axis=0) == pytest.approx([0.3, 0.0, 0.1], abs=3e-5)


@pytest.mark.parametrize(("cells", "shift"), [(10, 0.0), (10, 0.3), (20, 0.0)])
def test_flow_between_plates_that_it_sticks_to_is_parabolic(cells: int, shift: float) -> None:
    """Plane Poiseuille flow: u = G x (L - x) / (2 nu); 2%. A column falls between plates, open above and below.

    G is gravity plus the pressure gradient that the column's ends leave in its middle. The plates lie on the grid's
    lines or `shift` of a cell beside them.
    """
    width, nu = 0.1, 0.05
    cell = width / cells
    left = shift * cell
    plates = tuple(
        StaticObject(name=name, shape=Box(half_extents=(0.05, 1.0, 2.0)), position=(x, 0.0, 0.0))
        for name, x in (("left", left - 0.05), ("right", left + width + 0.05))
    )
    honey = pool("honey", (left, 0.6), (left + width, 1.2), viscosity=1000 * nu, slip=False)
    world = plane_world(honey, size=(0.2, 1.3), cell=cell, closed=False, lower=(-0.05, 0.0), statics=plates)
    run = Run(world)
    run.run(0.12)
    x, v = run.present()
    middle = x[:, 2].mean()
    near = np.abs(x[:, 2] - middle) < 0.1
    ends = np.array([[left + width / 2, 0.0, middle - 0.1], [left + width / 2, 0.0, middle + 0.1]])
    low, high = run.fluid.pressure_at(ends)[0]
    drive = GRAVITY + (high - low) / 0.2 / 1000
    assert abs(drive / GRAVITY - 1) < 0.05
    place = x[near, 0] - left
    exact = drive * place * (width - place) / (2 * nu)
    assert -v[near, 2].mean() == pytest.approx(exact.mean(), rel=0.02)
    assert -v[near, 2] == pytest.approx(exact, abs=0.08 * exact.max())  # the worst is beside a wall across the cells


def test_slippery_plates_do_not_hold_a_viscous_column() -> None:
    """The same column falls freely where it slips."""
    plates = tuple(
        StaticObject(name=name, shape=Box(half_extents=(0.05, 1.0, 2.0)), position=(x, 0.0, 0.0))
        for name, x in (("left", -0.05), ("right", 0.15))
    )
    honey = pool("honey", (0, 0.6), (0.1, 1.2), viscosity=50.0)
    world = plane_world(honey, size=(0.2, 1.3), cell=0.01, closed=False, lower=(-0.05, 0.0), statics=plates)
    run = Run(world)
    run.run(0.12)
    assert run.present()[1][:, 2].mean() == pytest.approx(-GRAVITY * 0.12, rel=0.01)


def _disc(stretch: float, radius: float, **parameters: float) -> object:
    angle = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    ring = np.stack([radius * stretch * np.cos(angle), radius / stretch * np.sin(angle)], axis=1)
    shape = ConvexMesh(vertices=[(float(x), y, float(z)) for x, z in ring for y in (-0.1, 0.1)])
    drop = pool("drop", (0, 0), (1, 1), **parameters)
    return drop.model_copy(update={"volumes": (FluidVolume(shape=shape, position=(0.05, 0.0, 0.05)),)})


def test_pressure_in_a_round_drop_is_laplaces() -> None:
    """p = sigma / R of a cylinder (Laplace, Young); 3% at 8 cells in the radius, and it stays round."""
    run = Run(
        plane_world(_disc(1.0, 0.02, surface_tension=0.07), size=(0.1, 0.1), cell=0.0025, gravity=0.0), step=0.001
    )
    pressures = [run.fluid.pressure_at(np.array([[0.05, 0.0, 0.05]]))[0, 0] for _ in run.advance(0.1)]
    assert np.mean(pressures) == pytest.approx(0.07 / 0.02, rel=0.03)
    assert np.abs(run.present()[1]).max() < 0.01


def test_drop_oscillates_with_rayleighs_frequency() -> None:
    """omega^2 = n (n^2 - 1) sigma / (rho R^3), n = 2, of a cylinder (Rayleigh 1879); first half period, 6%."""
    run = Run(
        plane_world(_disc(1.05, 0.02, surface_tension=0.07), size=(0.1, 0.1), cell=0.0025, gravity=0.0), step=0.002
    )
    times, stretch = [], []
    for time in run.advance(0.75):
        x, _ = run.present()
        spread = ((x - x.mean(axis=0)) ** 2).mean(axis=0)
        times.append(time)
        stretch.append((spread[0] - spread[2]) / (spread[0] + spread[2]))
    zeros = _zeros(np.array(times), np.array(stretch))
    omega = np.sqrt(6 * 0.07 / (1000 * 0.02**3))
    assert zeros[1] - zeros[0] == pytest.approx(np.pi / omega, rel=0.06)
