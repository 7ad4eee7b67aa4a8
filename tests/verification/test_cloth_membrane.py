"""Stretch, shear and waves of cloth against linear elasticity."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld import World, rollout
from tests.polyworld.solver.cloth.cloth_loop import ClothLoop
from tests.verification.cloth_meshes import held_strip, scattered, sheet


def test_loaded_strip_extends_by_stress_over_stiffness_and_narrows_by_poisson() -> None:
    """A 0.5 kg weight on a strip 0.1 m wide, E t = 500 N/m: strain m g / (b E t) = 0.0981 (far from the ends), and
    nu times that across; within 1%. A real cloth's strain: force per width is proportional to extension.
    """
    top, bottom = {"lower": (-1, -1, 0.999), "upper": (2, 1, 2)}, {"lower": (-1, -1, -1), "upper": (2, 1, 1e-6)}
    world = World.model_validate(
        {
            "objects": [
                {
                    "name": "weight",
                    "shape": {"kind": "box", "half_extents": (0.05, 0.01, 0.01)},
                    "mass": 0.5,
                    "position": (0.05, 0.0, -0.012),
                    "linear_damping": 5.0,
                    "representation": "rigid_spatial",
                }
            ],
            "deformables": [
                {
                    "name": "strip",
                    "representation": "cloth",
                    "geometry": {
                        "kind": "sheet",
                        "corner": (0.0, 0.0, 0.0),
                        "edge_u": (0.0, 0.0, 1.0),
                        "edge_v": (0.1, 0.0, 0.0),
                        "divisions": (20, 4),
                    },
                    "areal_density": 0.01,
                    "stretch_stiffness": 500.0,
                    "poisson_ratio": 0.3,
                    "linear_damping": 5.0,
                    "self_contact": False,
                }
            ],
            "attachments": [
                {"name": "top", "object": "strip", "region": top},
                {"name": "bottom", "object": "strip", "region": bottom, "to": "weight"},
            ],
            "environment": {"air_density": 0.0},
        }
    )
    run = rollout(world, 3.0, sample_interval=1.5)
    assert run.status == "completed"
    points = run.trajectory.deformables["strip"].points[-1].reshape(21, 5, 3)
    middle = points[5:16]
    along = (middle[-1, 2, 2] - middle[0, 2, 2]) / 0.5 - 1.0
    across = np.mean(middle[:, -1, 0] - middle[:, 0, 0]) / 0.1 - 1.0
    strain = 0.5 * 9.81 / (0.1 * 500.0)
    assert along == pytest.approx(strain, rel=0.01)
    assert across == pytest.approx(-0.3 * strain, rel=0.02)
    assert run.trajectory.deformables["strip"].quantities["strain"][-1].max() == pytest.approx(strain, rel=0.1)


def test_hanging_strip_extends_under_its_own_weight() -> None:
    """Tip extension rho g L^2 / (2 E t) = 0.0981 for rho = 1, E t = 50, L = 1 and nu = 0; within 1%, irregular mesh."""
    geometry = scattered((1.0, 0.2), (20, 4), 0.0, seed=5)
    world = held_strip(
        geometry, gravity=(9.81, 0.0, 0.0), areal_density=1.0, stretch_stiffness=50.0, linear_damping=10.0
    )
    motion = rollout(world, 3.0, sample_interval=1.5).trajectory.deformables["strip"]
    tip = np.isclose(motion.points[0, :, 0], 1.0)
    assert motion.points[-1, tip, 0].mean() - 1.0 == pytest.approx(9.81 / (2 * 50.0), rel=0.01)


def deformed(cloth: dict[str, Any], gradient: list[list[float]]) -> tuple[ClothLoop, np.ndarray]:
    """A unit square with homogeneous deformation x = F X, and the forces on its nodes."""
    loop = ClothLoop({"geometry": sheet((1.0, 1.0), (4, 4)), "bending_stiffness": 0.0, **cloth})
    loop.x[:, :2] = loop.mesh.nodes[:, :2] @ np.array(gradient).T
    return loop, loop.forces()


def side_force(loop: ClothLoop, forces: np.ndarray, axis: int) -> np.ndarray:
    """Force per width that the sheet takes on its side at X_axis = 1: against what it exerts there."""
    return -forces[np.isclose(loop.mesh.nodes[:, axis], 1.0)].sum(axis=0)


@pytest.mark.parametrize("stretch", [0.3, 0.9, 1.001, 1.5, 3.0])
def test_uniaxial_force_is_proportional_to_extension_at_any_stretch(stretch: float) -> None:
    """E t (lambda - 1) per width with free sides, also far in compression. Exact."""
    cloth = {"stretch_stiffness": 200.0, "poisson_ratio": 0.25}
    across = 1.0 - 0.25 * (stretch - 1.0)
    loop, forces = deformed(cloth, [[stretch, 0.0], [0.0, across]])
    assert side_force(loop, forces, 0)[0] == pytest.approx(200.0 * (stretch - 1.0), rel=1e-9)
    assert np.abs(side_force(loop, forces, 1)[:2]).max() < 1e-9


def test_stretch_of_both_axes_at_once() -> None:
    """E t / (1 - nu) times the strain per width. Exact."""
    loop, forces = deformed({"stretch_stiffness": 200.0, "poisson_ratio": 0.25}, [[1.1, 0.0], [0.0, 1.1]])
    for axis in (0, 1):
        assert side_force(loop, forces, axis)[axis] == pytest.approx(200.0 / 0.75 * 0.1, rel=1e-9)


@pytest.mark.parametrize(("shear", "expected"), [(None, 80.0), (7.0, 7.0)])
def test_shear_force_is_the_shear_stiffness_times_the_angle(shear: float | None, expected: float) -> None:
    """G t gamma per width, with G t = E t / (2 (1 + nu)) where it is not given; 0.1% at gamma = 0.001."""
    cloth = {"stretch_stiffness": 200.0, "poisson_ratio": 0.25, "shear_stiffness": shear}
    loop, forces = deformed(cloth, [[1.0, 1e-3], [0.0, 1.0]])
    assert side_force(loop, forces, 1)[0] == pytest.approx(expected * 1e-3, rel=1e-3)
    assert side_force(loop, forces, 0)[1] == pytest.approx(expected * 1e-3, rel=1e-3)


def test_turned_cloth_has_no_forces() -> None:
    """Turns cost nothing, however large, with orthotropic shear as well."""
    c, s = np.cos(2.0), np.sin(2.0)
    _, forces = deformed({"shear_stiffness": 3.0}, [[c, -s], [s, c]])
    assert np.abs(forces).max() < 1e-10


def test_longitudinal_wave_runs_at_the_speed_of_sound() -> None:
    """A strip that is stopped at one end while it moves: its tip swings with period 4 L / c, c = sqrt(E t / rho).

    20 elements: within 1% over three periods, and undamped.
    """
    world = held_strip(sheet((1.0, 0.1), (20, 2)), areal_density=0.5, stretch_stiffness=50.0, velocity=(0.1, 0.0, 0.0))
    period = 4.0 / 10.0
    run = rollout(world, 3.2 * period, sample_interval=period / 200)
    motion = run.trajectory.deformables["strip"]
    tip = motion.points[:, np.isclose(motion.points[0, :, 0], 1.0), 0].mean(axis=1) - 1.0
    t = run.trajectory.times
    falling = np.flatnonzero((tip[:-1] > 0) & (tip[1:] <= 0))
    crossing = t[falling] + tip[falling] / (tip[falling] - tip[falling + 1]) * (t[1] - t[0])
    assert len(crossing) == 3
    assert (crossing[2] - crossing[0]) / 2.0 == pytest.approx(period, rel=0.01)
    sine = np.sin(2 * np.pi * t / (crossing[2] - crossing[0]) * 2.0)
    first, last = (2.0 * float(np.mean((tip * sine)[k : k + 200])) for k in (0, 400))
    assert first == pytest.approx(8.0 / np.pi**2 * 0.1 * period / 4.0, rel=0.01)  # of a triangle wave of height v L / c
    assert last == pytest.approx(first, rel=0.01)


def test_stretch_damping_takes_energy_at_its_rate() -> None:
    """First longitudinal mode of a strip held at one end, 5% of critical damping: amplitude exp(-zeta omega t); 3%."""
    omega = 0.5 * np.pi * 10.0
    tau = 2.0 * 0.05 / omega
    world = held_strip(
        sheet((1.0, 0.1), (20, 2)),
        areal_density=0.5,
        stretch_stiffness=50.0,
        stretch_damping=tau,
        velocity=(0.1, 0.0, 0.0),
    )
    period = 2.0 * np.pi / omega / np.sqrt(1.0 - 0.05**2)
    run = rollout(world, 5 * period, sample_interval=period / 100)
    motion = run.trajectory.deformables["strip"]
    tip = motion.points[:, np.isclose(motion.points[0, :, 0], 1.0), 0].mean(axis=1) - 1.0
    # From the second period on: the higher modes are gone by then.
    peaks = [float(np.abs(tip[k * 100 : (k + 1) * 100]).max()) for k in (1, 4)]
    assert peaks[1] / peaks[0] == pytest.approx(np.exp(-3 * 2 * np.pi * 0.05 / np.sqrt(1 - 0.05**2)), rel=0.03)


@pytest.mark.parametrize("delay", [0.1, 2.0])
def test_strongly_damped_strip_creeps_to_its_length_with_the_damping_time(delay: float) -> None:
    """Without inertia a Kelvin-Voigt solid reaches its strain as 1 - exp(-t / tau), whatever its shape; within 2% of
    the last extension at all times. At tau = 2 s explicit damping would need steps of 0.1 us.
    """
    world = held_strip(
        scattered((1.0, 0.2), (10, 2), 0.0, seed=5),
        gravity=(50.0, 0.0, 0.0),
        areal_density=0.02,
        stretch_stiffness=500.0,
        bending_stiffness=0.0,
        stretch_damping=delay,
    )
    seconds = min(4.0 * delay, 0.4)
    run = rollout(world, seconds, sample_interval=seconds / 20)
    motion = run.trajectory.deformables["strip"]
    tip = motion.points[:, np.isclose(motion.points[0, :, 0], 1.0), 0].mean(axis=1) - 1.0
    final = 0.02 * 50.0 / (2 * 500.0)
    exact = final * (1.0 - np.exp(-run.trajectory.times / delay))
    assert np.abs(tip - exact).max() < 0.02 * exact[-1]


def test_holding_force_includes_what_damping_passes_on() -> None:
    """The forces on free and held nodes together are no net force: momentum gained is what the held end takes."""
    loop = ClothLoop({"geometry": sheet((1.0, 0.2), (8, 2)), "bending_stiffness": 0.0, "stretch_damping": 0.1})
    held = np.isclose(loop.mesh.nodes[:, 0], 0.0)
    loop.nodes.inverse_mass.numpy()[0, held] = 0.0
    loop.v[:] = np.random.default_rng(0).normal(0.0, 1.0, loop.v.shape) * (~held)[:, None]
    before = (loop.mass[:, None] * loop.v).sum(axis=0)
    f = loop.forces()
    loop.v[~held] += loop.dt * f[~held] / loop.mass[~held, None]
    loop.stage.launch_velocities(loop.nodes, loop.clock)
    taken = loop.nodes.f.numpy()[0, held].sum(axis=0) * loop.dt
    after = (loop.mass[:, None] * loop.v).sum(axis=0)
    assert after - before == pytest.approx(-taken, rel=1e-9)
    assert np.linalg.norm(taken) > 1e-4
