"""Soft bodies that yield: perfect von Mises plasticity."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.world import Environment, MotionPlane
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box
from tests.polyworld.solver.soft.stepping import Bench

E, NU, YIELD = 1e6, 0.3, 1e4
SIDE_VIEW = Environment(motion_plane=MotionPlane(normal=(0.0, -1.0, 0.0), supports=False))


def cube(limit: float | None = YIELD, *, planar: bool = False, half: float = 0.05) -> Bench:
    item = Soft(
        name="cube",
        representation="soft_planar" if planar else "soft",
        shape=Box(half_extents=(half, half, half)),
        position=(0, 0, 0),
        resolution=half,
        youngs_modulus=E,
        poisson_ratio=NU,
        yield_stress=limit,
    )
    return Bench(item, environment=SIDE_VIEW)


def stretch(bench: Bench, factor: float) -> None:
    """A uniform stretch along x at constant volume."""
    bench.x[:] = bench.rest * np.array([factor, factor**-0.5, factor**-0.5])


def release(bench: Bench) -> float:
    """Logarithmic strain along x that stays without load."""
    bench.damp(200.0)
    bench.run(int(0.3 / bench.dt[0]))
    return float(np.log(np.polyfit(bench.rest[0, :, 0], bench.x[0, :, 0], 1)[0]))


@pytest.mark.parametrize("strain", [0.02, 0.1, 0.4])
def test_stretched_beyond_yield_it_keeps_all_but_the_elastic_strain(strain: float) -> None:
    """At constant volume the von Mises stress is 3 G times the axial strain: what exceeds YIELD / 3 G stays."""
    bench = cube()
    stretch(bench, np.exp(strain))
    bench.stage.launch_forces(bench.nodes, bench.clock)
    elastic = YIELD / (3.0 * E / (2.0 * (1.0 + NU)))
    quantities = bench.stage.quantities(bench.nodes)["cube"]
    assert quantities["von_mises"] == pytest.approx(YIELD, rel=0.02)
    assert quantities["plastic_strain"] == pytest.approx(strain - elastic, rel=0.05)
    assert release(bench) == pytest.approx(strain - elastic, rel=0.02)
    assert bench.stage.quantities(bench.nodes)["cube"]["volume"] == pytest.approx(0.1**3, rel=2e-3)


@pytest.mark.parametrize("planar", [False, True])
def test_below_yield_it_springs_back_wholly(planar: bool) -> None:
    bench = cube(planar=planar)
    stretch(bench, 1.008)  # a von Mises stress of 0.92 times the yield stress
    bench.run(1)
    assert abs(release(bench)) < 1e-7
    assert bench.stage.quantities(bench.nodes)["cube"]["plastic_strain"].max() == 0.0


def pulled(bench: Bench, strain: float, seconds: float) -> float:
    """Lead both ends of a bar apart along x; the axial force divided by the cross section at rest, at the end."""
    x = bench.rest[0, :, 0]
    ends = np.abs(x) > np.abs(x).max() - 1e-9
    bench.hold(ends)
    steps = int(seconds / bench.dt[0])
    for _ in range(steps):
        bench.x[0, ends, 0] += x[ends] * strain / steps
        bench.run(1)
    return float(bench.nodes.f.numpy()[0, ends & (x > 0), 0].sum())


@pytest.mark.parametrize("planar", [False, True])
def test_pulled_bar_carries_its_yield_stress_and_unloads_elastically(planar: bool) -> None:
    """A force of the yield stress times the cross section, narrowed by the stretch, and on the way back a drop of E A
    times the strain that is taken back."""
    item = Soft(
        name="bar",
        representation="soft_planar" if planar else "soft",
        shape=Box(half_extents=(0.2, 0.05, 0.05)),
        position=(0, 0, 0),
        thickness=0.1,
        resolution=0.1,
        youngs_modulus=E,
        poisson_ratio=0.0,
        density=100.0,
        yield_stress=YIELD,
    )
    bench = Bench(item, environment=SIDE_VIEW)
    bench.damp(40.0)
    plateau = -pulled(bench, 0.03, 0.3)
    assert plateau / 0.01 == pytest.approx(YIELD / 1.03, rel=0.03)
    back = -pulled(bench, -0.005, 0.1)
    assert (plateau - back) / 0.01 == pytest.approx(0.005 * E, rel=0.05)


def test_yield_stress_may_differ_by_world_and_be_taken_back() -> None:
    """A batch: one world flows, the other's limit is out of reach. Reset, both are as new."""
    item = Soft(name="cube", shape=Box(half_extents=(0.05, 0.05, 0.05)), position=(0, 0, 0), youngs_modulus=E)
    bench = Bench(item, worlds=2, parameters={"cube": {"yield_stress": np.array([YIELD, 1e9])}})
    stretch(bench, 1.1)
    bench.run(1)
    flowed = bench.stage.quantities(bench.nodes)["cube"]["plastic_strain"].max(axis=1)
    assert flowed[0] > 0.05
    assert flowed[1] == 0.0
    bench.stage.reset()
    assert bench.stage.quantities(bench.nodes)["cube"]["plastic_strain"].max() == 0.0
