"""Soft bodies under any deformation: finite, momentum conserved, and back to their shape."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.model.soft_elements import QuadraticMesh
from polyworld.solver.soft.spectrum import shape_gradients
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Sphere
from tests.polyworld.solver.soft.stepping import Bench

Array = NDArray[np.float64]

RADIUS, E, DENSITY = 0.1, 1e5, 1000.0
SPEED = np.sqrt(E / DENSITY)


def ball(nu: float = 0.4, damping: float = 0.0, limit: float | None = None) -> Bench:
    item = Soft(
        name="ball",
        shape=Sphere(radius=RADIUS),
        position=(0, 0, 0),
        youngs_modulus=E,
        poisson_ratio=nu,
        density=DENSITY,
        damping=damping,
        yield_stress=limit,
    )
    return Bench(item)


def momenta(bench: Bench) -> tuple[Array, Array]:
    m = bench.mass[0][:, None]
    return (m * bench.v[0]).sum(axis=0), (m * np.cross(bench.x[0], bench.v[0])).sum(axis=0)


def departure(bench: Bench) -> float:
    """Largest distance of a node from where it is in the undeformed body, laid over this one [m]."""
    mass = bench.mass[0]
    x, r = (a - np.average(a, axis=0, weights=mass) for a in (bench.x[0], bench.rest[0]))
    u, _, vt = np.linalg.svd((mass[:, None] * x).T @ r)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return float(np.abs(x - r @ rotation.T).max())


def scattered(x: Array) -> Array:
    return RADIUS * np.random.default_rng(5).normal(size=x.shape)


SPOILED: dict[str, Callable[[Array], Array]] = {
    "crushed flat": lambda x: x * [1.0, 1.0, 0.0],
    "turned inside out": lambda x: x * [1.0, 1.0, -1.0],
    "scattered": scattered,
    "shrunk to a point": lambda x: 1e-3 * x,
}


@pytest.mark.parametrize(
    ("how", "nu"),
    [
        ("crushed flat", 0.0),
        ("crushed flat", 0.45),
        ("turned inside out", 0.0),
        ("turned inside out", 0.45),
        ("scattered", 0.3),
        ("shrunk to a point", 0.3),
    ],
)
def test_spoiled_body_recovers_its_shape_and_keeps_its_momentum(how: str, nu: float) -> None:
    bench = ball(nu, damping=0.003)
    bench.x[0] = SPOILED[how](bench.x[0])
    before = momenta(bench)
    bench.run(int(1.0 / bench.dt[0]))
    assert departure(bench) < 1e-4 * RADIUS
    for now, then in zip(momenta(bench), before, strict=True):
        assert np.abs(now - then).max() < 1e-12


@pytest.mark.parametrize("limit", [None, 5e3])
def test_velocities_far_above_the_speed_of_sound_do_no_harm(limit: float | None) -> None:
    """Torn to a disc at three times the speed of sound, it comes to rest; where it yields, in another shape."""
    bench = ball(damping=0.003, limit=limit)
    bench.v[0] = bench.x[0] / RADIUS * SPEED * np.array([1.5, 1.5, -3.0])
    bench.run(int(1.0 / bench.dt[0]))
    assert np.abs(bench.v).max() < 1e-3 * SPEED
    assert bench.stage.quantities(bench.nodes)["ball"]["volume"][0, 0] == pytest.approx(
        4 / 3 * np.pi * RADIUS**3, rel=0.01
    )
    assert departure(bench) < 1e-4 * RADIUS if limit is None else departure(bench) > 0.1 * RADIUS


def test_free_motion_conserves_linear_and_angular_momentum_to_rounding() -> None:
    bench = ball(damping=0.001)
    bench.v[0] = 0.2 * SPEED * np.random.default_rng(1).normal(size=bench.v[0].shape)
    linear, angular = momenta(bench)
    bench.run(2000)
    now = momenta(bench)
    scale = (bench.mass[0] * 0.2 * SPEED).sum()
    assert np.abs(now[0] - linear).max() < 1e-12 * scale
    assert np.abs(now[1] - angular).max() < 1e-12 * scale * RADIUS


def energy(bench: Bench, form: QuadraticMesh, nu: float) -> float:
    """Kinetic and elastic energy [J], from the published energy with its volume part averaged over elements."""
    gradient, weight = shape_gradients(form)
    f = np.einsum("qmi,qpmj->qpij", bench.x[0][form.elements], gradient)
    shear, first = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    lam, mu = first + 5 / 6 * shear, 4 / 3 * shear
    point = min(lam, 2.25 * shear)
    alpha = 1 + shear / lam
    square, j = (f**2).sum(axis=(2, 3)), np.linalg.det(f)
    mean = (weight * j).sum(axis=1) / weight.sum(axis=1)
    density = mu / 2 * (square - 3 - np.log((square + 1) / 4)) + point / 2 * ((j - alpha) ** 2 - (1 - alpha) ** 2)
    elastic = (weight * density).sum()
    elastic += ((lam - point) / 2 * ((mean - alpha) ** 2 - (1 - alpha) ** 2) * weight.sum(axis=1)).sum()
    return float(elastic + 0.5 * (bench.mass[0] * (bench.v[0] ** 2).sum(axis=1)).sum())


def test_undamped_body_keeps_its_energy() -> None:
    """A ball that swings between flat and long by a tenth, for forty periods: no drift beyond the ripple of a step."""
    nu = 0.4
    bench = ball(nu)
    bench.v[0] = bench.x[0] / RADIUS * SPEED * np.array([0.1, 0.1, -0.2])
    seen: list[float] = []
    bench.run(
        int(40 * 2 * RADIUS / SPEED / bench.dt[0]), lambda _: seen.append(energy(bench, bench.forms["ball"], nu)), 3
    )
    third = len(seen) // 3
    early, late = np.mean(seen[:third]), np.mean(seen[-third:])
    assert late / early == pytest.approx(1.0, abs=0.005)
    assert np.ptp(seen) < 0.2 * early


def test_rigid_motion_makes_no_forces_and_damping_leaves_it_alone() -> None:
    """Turned and moved anyhow, an undeformed body is without stress; spinning about its axis it keeps its spin."""
    bench = ball(damping=0.002)
    angle = 2.0
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    bench.x[0] = bench.rest[0] @ turn.T + 3.0
    bench.v[0] = np.cross([0.0, 0.0, 0.5], bench.x[0] - 3.0)
    start = momenta(bench)[1]
    bench.stage.launch_forces(bench.nodes, bench.clock)
    assert np.abs(bench.nodes.f.numpy()).max() < 1e-9
    bench.run(1000)
    spin = np.cross(bench.x[0] - bench.x[0].mean(axis=0), bench.v[0])[:, 2].sum()
    radius = ((bench.x[0] - bench.x[0].mean(axis=0))[:, :2] ** 2).sum()
    assert spin / radius == pytest.approx(0.5, rel=1e-4)
    assert momenta(bench)[1] == pytest.approx(start, abs=1e-12)
