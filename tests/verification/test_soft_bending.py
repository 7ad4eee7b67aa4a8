"""Soft beams against beam theory. Resolution: two layers of elements, and one layer at twice the tolerance."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from polyworld.world import Environment, MotionPlane
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box
from tests.polyworld.solver.soft.stepping import Bench

LENGTH, DEPTH, E, DENSITY = 1.0, 0.1, 1e5, 1000.0
INERTIA = DEPTH**4 / 12.0
FIRST = 1.8751**2 * np.sqrt(E * INERTIA / (DENSITY * DEPTH**2 * LENGTH**4))  # angular frequency of the first mode
SIDE_VIEW = Environment(motion_plane=MotionPlane(normal=(0.0, -1.0, 0.0), supports=False))


def beam(layers: int, nu: float, *, planar: bool = False, depth: float = DEPTH, damping: float = 0.0) -> Bench:
    """A cantilever along x, clamped at its left end, `depth` high and wide."""
    item = Soft(
        name="beam",
        representation="soft_planar" if planar else "soft",
        shape=Box(half_extents=(LENGTH / 2, depth / 2, depth / 2)),
        position=(LENGTH / 2, 0.0, 0.0),
        thickness=depth,
        resolution=depth / layers,
        youngs_modulus=E,
        poisson_ratio=nu,
        density=DENSITY,
        damping=damping,
    )
    bench = Bench(item, environment=SIDE_VIEW)
    bench.hold(bench.rest[0, :, 0] < 1e-9)
    return bench


def tip(bench: Bench) -> NDArray[np.float64]:
    """Mean displacement of the free end (3,)."""
    end = bench.rest[0, :, 0] > LENGTH - 1e-9
    mean: NDArray[np.float64] = (bench.x - bench.rest)[0, end].mean(axis=0)
    return mean


def load_tip(bench: Bench, force: float, depth: float = DEPTH) -> None:
    pull = np.array([0.0, 0.0, force / depth**2])
    bench.press(lambda centre, _: np.where(centre[:, :1] > LENGTH - 1e-9, pull, 0.0))


@pytest.mark.parametrize(
    ("layers", "nu", "planar", "tolerance"),
    [
        (2, 0.3, False, 0.02),
        pytest.param(1, 0.3, False, 0.04, marks=pytest.mark.benchmark),
        pytest.param(2, 0.45, False, 0.02, marks=pytest.mark.benchmark),
        (1, 0.45, False, 0.04),
        (2, 0.3, True, 0.02),
        pytest.param(1, 0.3, True, 0.04, marks=pytest.mark.benchmark),
        (2, 0.49, True, 0.02),
    ],
)
def test_cantilever_sags_as_beam_theory_says(layers: int, nu: float, planar: bool, tolerance: float) -> None:
    """F L^3 / 3 E I + F L / (k G A), k = 10 (1 + nu) / (12 + 11 nu) (Cowper 1966): a sag of 1% of the length."""
    bench = beam(layers, nu, planar=planar)
    force = 3.0 * E * INERTIA * 0.01 / LENGTH**2
    load_tip(bench, force)
    bench.damp(2.0 * FIRST)
    bench.run(int(8.0 / FIRST / bench.dt[0]))
    shear = force * LENGTH / (10.0 * (1.0 + nu) / (12.0 + 11.0 * nu) * E / (2.0 * (1.0 + nu)) * DEPTH**2)
    assert tip(bench)[2] == pytest.approx(0.01 + shear, rel=tolerance)


@pytest.mark.parametrize(("layers", "planar", "tolerance"), [(1, False, 0.02), (2, True, 0.02), (1, True, 0.04)])
def test_cantilever_swings_at_its_first_natural_frequency(layers: int, planar: bool, tolerance: float) -> None:
    """(1.8751^2 / 2 pi) sqrt(E I / (rho A L^4)), from half a swing: the time between two passages of rest."""
    bench = beam(layers, 0.3, planar=planar)
    k = 1.8751 / LENGTH
    x = bench.rest[0, :, 0]
    ratio = (np.cosh(1.8751) + np.cos(1.8751)) / (np.sinh(1.8751) + np.sin(1.8751))
    shape = np.cosh(k * x) - np.cos(k * x) - ratio * (np.sinh(k * x) - np.sin(k * x))
    bench.v[0, :, 2] = 0.01 * FIRST * LENGTH * shape / shape.max()
    heights: list[float] = [0.0]
    bench.run(int(1.15 * np.pi / FIRST / bench.dt[0]), lambda _: heights.append(tip(bench)[2]))
    z = np.array(heights)
    down = int(np.flatnonzero((z[1:-1] > 0) & (z[2:] <= 0))[0]) + 1
    half = (down + z[down] / (z[down] - z[down + 1])) * bench.dt[0]
    assert np.pi / half == pytest.approx(FIRST, rel=tolerance)


@pytest.mark.parametrize("load", [1.0, 2.0, 5.0, 10.0])
def test_large_deflection_follows_the_elastica(load: float) -> None:
    """Tip heights of Bisshopp & Drucker (1945) at P L^2 / E I = `load`, from their equation solved here; slenderness
    20, so that stretching and shear matter little."""
    depth = LENGTH / 20.0
    bench = beam(1, 0.3, planar=True, depth=depth)
    inertia = depth**4 / 12.0
    force = load * E * inertia / LENGTH**2
    load_tip(bench, force, depth)
    rate = 1.8751**2 * np.sqrt(E * inertia / (DENSITY * depth**2 * LENGTH**4))
    bench.damp(2.0 * rate)
    bench.run(int(8.0 / rate / bench.dt[0]))

    def slope(_: object, y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([y[1], -load * np.cos(y[0]), np.sin(y[0])])

    s = np.linspace(0.0, 1.0, 50)
    start = np.stack([0.5 * s, 0.5 * np.ones(50), 0.2 * s])
    solved = solve_bvp(slope, lambda a, b: np.array([a[0], b[1], a[2]]), s, start, tol=1e-8)
    assert solved.success
    assert tip(bench)[2] == pytest.approx(float(solved.y[2, -1]) * LENGTH, rel=0.02)
    published = {1.0: 0.30172, 2.0: 0.49346, 5.0: 0.71379, 10.0: 0.81061}
    assert solved.y[2, -1] == pytest.approx(published[load], abs=2e-4)
