"""Soft bodies against Hooke's law, wave theory and the Kelvin-Voigt model."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.world import Environment, MotionPlane
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box
from tests.polyworld.solver.soft.stepping import Bench

Array = NDArray[np.float64]

LENGTH, SIDE, E, DENSITY = 1.0, 0.1, 1e5, 1000.0
SPEED = np.sqrt(E / DENSITY)  # of longitudinal waves in a thin bar
SIDE_VIEW = Environment(motion_plane=MotionPlane(normal=(0.0, -1.0, 0.0), supports=False))


def bar(nu: float = 0.3, damping: float = 0.0, *, planar: bool = False, resolution: float = SIDE) -> Bench:
    item = Soft(
        name="bar",
        representation="soft_planar" if planar else "soft",
        shape=Box(half_extents=(LENGTH / 2, SIDE / 2, SIDE / 2)),
        position=(0.0, 0.0, 0.0),
        thickness=SIDE,
        resolution=resolution,
        youngs_modulus=E,
        poisson_ratio=nu,
        density=DENSITY,
        damping=damping,
    )
    return Bench(item, environment=SIDE_VIEW)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
@pytest.mark.parametrize("planar", [False, True])
def test_pulled_bar_stretches_by_stress_over_modulus_and_thins_by_poissons_ratio(nu: float, planar: bool) -> None:
    """A uniform state, exact on any mesh; what is left is the neo-Hookean law's departure from Hooke's at 0.1%."""
    bench = bar(nu, planar=planar)
    stress = 1e-3 * E
    bench.press(lambda _, normal: stress * normal * np.abs(normal[:, :1]))
    bench.damp(2.0 * np.pi * SPEED / LENGTH)
    bench.run(int(10.0 * LENGTH / SPEED / bench.dt[0]))
    rest, moved = bench.rest[0], (bench.x - bench.rest)[0]
    strain = [np.polyfit(rest[:, k], moved[:, k], 1)[0] for k in (0, 2)]
    assert strain[0] == pytest.approx(1e-3, rel=4e-3)
    assert strain[1] == pytest.approx(-nu * 1e-3, abs=4e-6)
    assert bench.stage.quantities(bench.nodes)["bar"]["von_mises"] == pytest.approx(stress, rel=5e-3)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_pressure_on_all_sides_shrinks_a_cube_by_its_bulk_modulus(nu: float) -> None:
    """dV / V = -3 (1 - 2 nu) p / E."""
    cube = Box(half_extents=(0.1, 0.1, 0.1))
    item = Soft(name="cube", shape=cube, position=(0, 0, 0), youngs_modulus=E, poisson_ratio=nu, density=DENSITY)
    bench = Bench(item)
    bulk = E / (3.0 * (1.0 - 2.0 * nu))
    bench.press(lambda _, normal: -1e-3 * bulk * normal)
    bench.damp(np.pi * np.sqrt(bulk / DENSITY) / 0.1)
    bench.run(int(2.0 / np.sqrt(bulk / DENSITY) / bench.dt[0]))
    volume = bench.stage.quantities(bench.nodes)["cube"]["volume"][0, 0]
    assert volume / 0.2**3 - 1.0 == pytest.approx(-1e-3, rel=4e-3)


def swing(bench: Bench, time: float) -> tuple[Array, Array]:
    """Times and amplitudes of the lowest longitudinal mode of a free bar, started with a velocity of 1 mm/s."""
    shape = np.sin(np.pi * bench.rest[0, :, 0] / LENGTH)
    weight = bench.mass[0] * shape / (bench.mass[0] * shape**2).sum()
    bench.v[0, :, 0] = 1e-3 * shape
    amplitude: list[float] = []
    bench.run(int(time / bench.dt[0]), lambda _: amplitude.append(weight @ (bench.x - bench.rest)[0, :, 0]))
    return bench.dt[0] * np.arange(1, len(amplitude) + 1), np.array(amplitude)


@pytest.mark.parametrize("planar", [False, True])
def test_free_bar_rings_at_half_a_wave_to_its_length(planar: bool) -> None:
    """f = sqrt(E / rho) / 2 L, lowered by (nu pi r / L)^2 / 2 for lateral inertia (Rayleigh), r its polar radius."""
    bench = bar(0.3, planar=planar)
    times, amplitude = swing(bench, 0.55 * 2.0 * LENGTH / SPEED)
    crossing = int(np.flatnonzero((amplitude[:-1] > 0) & (amplitude[1:] <= 0))[0])
    half = times[crossing] + bench.dt[0] * amplitude[crossing] / (amplitude[crossing] - amplitude[crossing + 1])
    square = SIDE**2 / (12.0 if planar else 6.0)
    expected = SPEED / (2.0 * LENGTH) * (1.0 - 0.5 * (0.3 * np.pi) ** 2 * square / LENGTH**2)
    assert 0.5 / half == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize(("ratio", "planar"), [(0.005, False), (0.005, True), (0.2, False), (0.2, True)])
def test_ringing_dies_away_at_the_kelvin_voigt_rate(ratio: float, planar: bool) -> None:
    """q'' + tau w^2 q' + w^2 q = 0 for each mode, so that its damping ratio is tau w / 2: amplitudes half a period
    apart differ by exp(-pi z / sqrt(1 - z^2)). Weak damping acts with the other forces, strong damping in stages."""
    w = np.pi * SPEED / LENGTH
    bench = bar(0.0, 2.0 * ratio / w, planar=planar)
    _, amplitude = swing(bench, 2.2 * np.pi / w)
    decrement = np.log(amplitude.max() / -amplitude.min())
    assert decrement == pytest.approx(np.pi * ratio / np.sqrt(1.0 - ratio**2), rel=0.03)


def test_overdamped_bar_creeps_back_as_the_kelvin_voigt_model_says() -> None:
    """Damping ratio 3. Symplectic Euler is of first order in the step times the fast rate, here 0.2."""
    w, ratio = np.pi * SPEED / LENGTH, 3.0
    bench = bar(0.0, 2.0 * ratio / w)
    times, amplitude = swing(bench, 4.0 * np.pi / w)
    root = np.sqrt(ratio**2 - 1.0)
    slow, fast = w * (-ratio + root), w * (-ratio - root)
    exact = 1e-3 * (np.exp(slow * times) - np.exp(fast * times)) / (slow - fast)
    assert np.abs(amplitude - exact).max() < 0.8 * bench.dt[0] * -fast * exact.max()
    assert np.log(amplitude[-1] / amplitude[len(times) // 2]) == pytest.approx(slow * 2.0 * np.pi / w, rel=0.01)
