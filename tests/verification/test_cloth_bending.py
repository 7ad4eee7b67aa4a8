"""Bending of cloth against the elastica, plate theory and beam theory, on meshes of every kind."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from polyworld import World, rollout
from tests.verification.cloth_meshes import held_strip, scattered, sheet, slanted

# Heavy horizontal strip clamped at one end: tip drop over length by w L^3 / EI.
DROPS = {5.0: 0.4959, 10.0: 0.7002, 50.0: 0.9079}
CUTS = {
    "regular": lambda n: sheet((1.0 + 1.0 / n, 0.2), (n + 1, max(2, n // 5)), -1.0 / n),
    "scattered": lambda n: scattered((1.0 + 1.0 / n, 0.2), (n + 1, max(2, n // 5)), -1.0 / n, seed=n),
    "slanted": lambda n: slanted((1.0 + 1.0 / n, 0.2), (n + 1, max(2, n // 5)), -1.0 / n, angle=0.4),
}


def settled(cloth: dict[str, Any], attachments: list[dict[str, Any]], seconds: float, gravity: float) -> np.ndarray:
    """Where the nodes of a cloth come to rest in still, empty space."""
    world = World.model_validate(
        {
            "deformables": [{"name": "strip", "representation": "cloth", "self_contact": False, **cloth}],
            "attachments": attachments,
            "environment": {"gravity": (0.0, 0.0, -gravity), "air_density": 0.0},
        }
    )
    run = rollout(world, seconds, sample_interval=seconds / 4)
    assert run.status == "completed"
    motion = run.trajectory.deformables["strip"]
    assert np.abs(motion.points[-1] - motion.points[-2]).max() < 1e-3  # it is at rest
    return motion.points[-1]


@cache
def clamped(n: int, cut: str, load: float, poisson: float = 0.0, gravity: float = 10.0) -> float:
    """Tip drop over length of a strip of unit length and weight 10 N/m^2, n elements long, held by two rows."""
    cloth = {
        "geometry": CUTS[cut](n),
        "areal_density": 1.0,
        "stretch_stiffness": 1e4,
        "poisson_ratio": poisson,
        "bending_stiffness": 10.0 / load,
        "linear_damping": 2.5 + 20.0 / load,  # some twice the lowest frequency
    }
    wall = {"lower": (-1.0, -1.0, -1.0), "upper": (1e-6, 1.0, 1.0)}
    points = settled(cloth, [{"name": "wall", "object": "strip", "region": wall}], 6.0, gravity)
    geometry = cloth["geometry"]
    tip = np.isclose(points_at_start(geometry)[:, 0], 1.0)
    return float(-points[tip, 2].mean())


def points_at_start(geometry: dict[str, Any]) -> np.ndarray:
    if geometry["kind"] == "mesh":
        return np.asarray(geometry["vertices"])
    (nu, nv), corner = geometry["divisions"], np.asarray(geometry["corner"])
    i, j = np.meshgrid(np.arange(nu + 1) / nu, np.arange(nv + 1) / nv, indexing="ij")
    points = corner + i[..., None] * np.asarray(geometry["edge_u"]) + j[..., None] * np.asarray(geometry["edge_v"])
    return points.reshape(-1, 3)


@pytest.mark.parametrize(
    ("load", "cut"), [*((load, "regular") for load in DROPS), (50.0, "scattered"), (50.0, "slanted")]
)
def test_heavy_strip_drops_as_the_elastica_however_it_is_cut(load: float, cut: str) -> None:
    """Elastica under its own weight (ODE solution tabulated for w L^3 / EI). 20 elements: within 1%."""
    assert clamped(20, cut, load) == pytest.approx(DROPS[load], rel=0.01)


def test_heavy_strip_converges_with_the_square_of_the_element() -> None:
    """10 elements are within 2%, and halving them divides the error by 3 at least (4 in theory)."""
    coarse = clamped(10, "regular", 10.0) / DROPS[10.0] - 1.0
    fine = clamped(20, "regular", 10.0) / DROPS[10.0] - 1.0
    assert abs(coarse) < 0.02
    assert abs(fine) < abs(coarse) / 3.0


def test_narrow_strip_bends_with_the_plate_stiffness_times_one_minus_nu_squared() -> None:
    """EI = D (1 - nu^2) b where the strip is free to bend across (anticlastic), so nu = 0.45 at load 5 drops as 0.0 at
    6.27. The clamp hinders the bending across over about one width, of five: within 3% of the beam.
    """
    free = clamped(10, "scattered", 5.0 / (1.0 - 0.45**2))
    assert clamped(10, "scattered", 5.0, poisson=0.45) == pytest.approx(free, rel=0.03)
    assert free > 1.08 * clamped(10, "scattered", 5.0)  # the effect is larger than the tolerance


@pytest.mark.parametrize("cut", ["regular", "scattered", "slanted"])
def test_simply_supported_plate_deflects_as_kirchhoff_plate(cut: str) -> None:
    """Centre of a square plate under its weight q: 0.00406 q a^4 / D (Timoshenko & Woinowsky-Krieger, table 8).

    16 elements a side: within 3%.
    """
    n = 16
    geometry = {
        "regular": sheet((1.0, 1.0), (n, n)),
        "scattered": scattered((1.0, 1.0), (n, n), 0.0, seed=3),
        "slanted": slanted((1.0, 1.0), (n, n), 0.0, angle=0.4),
    }[cut]
    start = points_at_start(geometry)
    border = np.flatnonzero((np.abs(start[:, :2] - 0.5) > 0.5 - 1e-9).any(axis=1))
    cloth = {
        "geometry": geometry,
        "areal_density": 1.0,
        "stretch_stiffness": 1.0,  # so soft that the deflection does not stretch it
        "poisson_ratio": 0.3,
        "bending_stiffness": 1.0,
        "linear_damping": 30.0,
    }
    held = [{"name": "frame", "object": "strip", "nodes": border.tolist()}]
    points = settled(cloth, held, 1.5, gravity=1.0)
    near = np.linalg.norm(start[:, :2] - 0.5, axis=1) < 0.2
    # A paraboloid about the centre: the scattered mesh has no node there.
    x, y = (start[near, :2] - 0.5).T
    terms = np.stack([np.ones_like(x), x, y, x * x, y * y, x * y], axis=1)
    centre = np.linalg.lstsq(terms, -points[near, 2], rcond=None)[0][0]
    exact = fitted_centre(x, y, terms)
    assert centre == pytest.approx(exact, rel=0.03)


def fitted_centre(x: np.ndarray, y: np.ndarray, terms: np.ndarray) -> float:
    """The same paraboloid fitted to the exact deflection (Navier's double series) for q = D = a = 1."""
    odd = np.arange(1, 40, 2)
    m, n = np.meshgrid(odd, odd, indexing="ij")
    factor = 16.0 / (np.pi**6 * m * n * (m * m + n * n) ** 2)
    sine_x = np.sin(np.pi * np.outer(x + 0.5, odd))
    sine_y = np.sin(np.pi * np.outer(y + 0.5, odd))
    w = np.einsum("ki,ij,kj->k", sine_x, factor, sine_y)
    return float(np.linalg.lstsq(terms, w, rcond=None)[0][0])


def test_first_frequency_of_a_clamped_strip_and_no_damping() -> None:
    """f = 1.8751^2 / (2 pi) sqrt(D / (rho L^4)), within 1.5% at 16 elements; the amplitude stays over ten periods."""
    n = 16
    world = held_strip(
        CUTS["regular"](n), areal_density=1.0, stretch_stiffness=2e3, bending_stiffness=1.0, velocity=(0.0, 0.0, 0.01)
    )
    period = 2.0 * np.pi / 1.87510407**2
    run = rollout(world, 10.5 * period, sample_interval=period / 64)
    motion = run.trajectory.deformables["strip"]
    tip = motion.points[:, np.isclose(motion.points[0, :, 0], 1.0), 2].mean(axis=1)
    t = run.trajectory.times

    def fit(f: float, part: slice) -> tuple[float, float]:
        basis = np.stack([np.sin(2 * np.pi * f * t[part]), np.cos(2 * np.pi * f * t[part])], axis=1)
        c, residual, *_ = np.linalg.lstsq(basis, tip[part], rcond=None)
        return float(residual[0]), float(np.hypot(*c))

    frequencies = np.linspace(0.95, 1.05, 401) / period
    best = min(frequencies, key=lambda f: fit(f, slice(None))[0])
    assert best * period == pytest.approx(1.0, rel=0.015)
    early, late = fit(best, slice(0, 4 * 64))[1], fit(best, slice(6 * 64, 10 * 64))[1]
    assert late == pytest.approx(early, rel=0.02)


def test_bending_damping_takes_energy_at_its_rate() -> None:
    """Kelvin-Voigt damping of time tau: amplitude exp(-tau omega^2 t / 2), 0.685 after three periods; within 2%."""
    n = 10
    omega = 1.87510407**2
    tau = 2.0 * 0.02 / omega  # 2% of critical
    world = held_strip(
        CUTS["scattered"](n),
        areal_density=1.0,
        stretch_stiffness=500.0,
        bending_stiffness=1.0,
        bending_damping=tau,
        velocity=(0.0, 0.0, 0.01),
    )
    period = 2.0 * np.pi / omega / np.sqrt(1.0 - 0.02**2)
    run = rollout(world, 4 * period, sample_interval=period / 100)
    motion = run.trajectory.deformables["strip"]
    tip = motion.points[:, np.isclose(motion.points[0, :, 0], 1.0), 2].mean(axis=1)
    peaks = [float(np.abs(tip[k * 100 : (k + 1) * 100]).max()) for k in (0, 3)]
    assert peaks[1] / peaks[0] == pytest.approx(np.exp(-3 * 2 * np.pi * 0.02 / np.sqrt(1 - 0.02**2)), rel=0.02)
