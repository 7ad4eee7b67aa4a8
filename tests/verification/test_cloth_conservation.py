"""Momentum and energy of free cloth, and forces against the slope of the energy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.polyworld.solver.cloth.cloth_loop import ClothLoop
from tests.verification.cloth_meshes import scattered, sheet

CLOTH = {
    "areal_density": 0.3,
    "stretch_stiffness": 100.0,
    "poisson_ratio": 0.3,
    "shear_stiffness": 20.0,
    "bending_stiffness": 0.02,
}


def shaken(seed: int, **extra: object) -> ClothLoop:
    """A cloth crumpled at random, with random velocities."""
    loop = ClothLoop({"geometry": scattered((1.0, 0.6), (10, 6), 0.0, seed), **CLOTH, **extra})
    rng = np.random.default_rng(seed)
    loop.x += rng.normal(0.0, 0.01, loop.x.shape)
    loop.v += rng.normal((1.0, 2.0, 0.5), 0.3, loop.v.shape)
    return loop


@pytest.mark.parametrize("damping", [0.0, 0.002])
def test_momentum_and_angular_momentum_stay_to_rounding(damping: float) -> None:
    loop = shaken(1, stretch_damping=damping, bending_damping=damping)
    p0, l0 = loop.momentum()
    loop.run(400)
    p1, l1 = loop.momentum()
    assert np.abs(p1 - p0).max() < 1e-12 * np.linalg.norm(p0) * 400
    # Symplectic Euler keeps angular momentum to rounding as well: x and dx are parallel to v.
    assert np.abs(l1 - l0).max() < 1e-12 * np.linalg.norm(p0) * 400


def test_energy_of_undamped_sheet_stays() -> None:
    """Of a sheet crumpled at random, so that all its frequencies swing: velocities are half a step behind, so the sum
    swings by 1%, and its mean over 500 steps stays within 1% for 5000 steps.
    """
    loop = shaken(2)
    means = []
    for _ in range(10):
        total = 0.0
        for _ in range(50):
            loop.run(10)
            total += loop.kinetic_energy() + float(loop.quantity("elastic_energy")[0])
        means.append(total / 50)
    assert max(means[1:]) / min(means[1:]) - 1.0 < 0.01


def test_damping_only_takes_energy() -> None:
    """Both dampings: the internal energy falls, and a rigid rotation and translation is left alone."""
    loop = shaken(3, stretch_damping=0.005, bending_damping=0.01)
    loop.v += np.cross((0.0, 0.0, 2.0), loop.x)
    energies = []
    for _ in range(20):
        loop.run(50)
        energies.append(loop.kinetic_energy() + float(loop.quantity("elastic_energy")[0]))
    assert all(b < a * (1.0 + 1e-9) for a, b in itertools.pairwise(energies))
    p, angular = loop.momentum()
    mass = loop.mass.sum()
    centre = (loop.mass[:, None] * loop.x).sum(axis=0) / mass
    about = angular - np.cross(centre, p)
    arm = loop.x - centre
    inertia = np.einsum(
        "k,kij->ij", loop.mass, (arm**2).sum(1)[:, None, None] * np.eye(3) - arm[:, :, None] * arm[:, None]
    )
    rigid = 0.5 * p @ p / mass + 0.5 * about @ np.linalg.solve(inertia, about)
    loop.run(4000)
    left = loop.kinetic_energy() + float(loop.quantity("elastic_energy")[0])
    assert left == pytest.approx(rigid, rel=0.1)


def test_forces_are_the_slope_of_the_energy() -> None:
    """Central differences of the elastic energy, which NumPy computes on its own, at random places of random nodes."""
    loop = shaken(4)
    loop.v[:] = 0.0
    rng = np.random.default_rng(0)
    angle = loop.stage._bending.angle.numpy()
    angle[:] = rng.normal(0.0, 0.02, angle.shape)
    kept = angle.copy()
    forces = loop.forces()
    angle[:] = kept
    scale = np.abs(forces).max()
    for node in rng.integers(0, len(loop.x), 12):
        for axis in range(3):
            energy = []
            for side in (1e-6, -2e-6):
                loop.x[node, axis] += side
                energy.append(float(loop.quantity("elastic_energy")[0]))
            loop.x[node, axis] += 1e-6
            assert forces[node, axis] == pytest.approx(-(energy[0] - energy[1]) / 2e-6, abs=1e-5 * scale)


def test_bent_rest_shape_has_no_forces_and_flat_one_has() -> None:
    """A quarter of a cylinder rests as it is, unless it is flat at rest; its energy then is D A / (2 R^2)."""
    turn = np.linspace(0.0, np.pi / 2, 17)
    vertices = [(np.sin(a), y, np.cos(a)) for a in turn for y in (0.0, 0.1, 0.2)]
    faces = []
    for i in range(16):
        for j in range(2):
            a = 3 * i + j
            faces += [(a, a + 3, a + 4), (a, a + 4, a + 1)]
    geometry = {"kind": "mesh", "vertices": vertices, "faces": faces}
    assert np.abs(ClothLoop({"geometry": geometry, **CLOTH}).forces()).max() < 1e-12
    flat = ClothLoop({"geometry": geometry, **CLOTH, "flat_at_rest": True})
    assert np.abs(flat.forces()).max() > 1e-3
    area = np.pi / 2 * 0.2
    # The strip next to each end is straight in the discrete shape: one element of 16 is missing.
    assert float(flat.quantity("elastic_energy")[0]) == pytest.approx(0.5 * 0.02 * area * 15 / 16, rel=0.02)


def test_cloth_squeezed_to_nothing_pushes_back_without_blowing_up() -> None:
    """Triangles without area, even points, give finite forces no larger than E t times the sheet's width."""
    loop = ClothLoop({"geometry": sheet((1.0, 1.0), (3, 3)), **CLOTH})
    start = loop.x.copy()
    for scale in ((0.0, 1.0, 1.0), (1e-5, 1e-5, 1.0), (0.0, 0.0, 0.0)):
        loop.x[:] = start * scale
        assert np.isfinite(loop.forces()).all()
        assert np.abs(loop.forces()).max() < 100.0 / (1.0 - 0.3**2) * 2.0
