"""Ropes in motion: vibration, waves, damping, conservation. Half the resolution within twice the tolerance."""

import numpy as np
import pytest
from scipy.optimize import curve_fit

from tests.verification.rope_world import Array, G, ball, frequency, held, rope, run, world


def bounce(stiffness: float, damping: float, segments: int = 20) -> tuple[float, float, float]:
    """A load on a stretchy rope: fitted angular frequency and decay rate over the exact ones' unit, and the exact
    angular frequency. The load begins 0.4 of its static stretch away from rest, so that the rope stays taut.
    """
    mass, density, length = 1.0, 0.01, 1.0
    rest = length / (1.0 + 0.6 * mass * G / stiffness)
    hanging = rope(
        [[0, 0, 0], [0, 0, -length]],
        segments,
        length=rest,
        linear_density=density,
        stretch_stiffness=stiffness,
        stretch_damping=damping,
    )
    # Rayleigh: a light spring counts with a third of its mass.
    omega = np.sqrt(stiffness / rest / (mass + density * rest / 3.0))
    scene = world(
        hanging, objects=[ball("load", [0, 0, -length], mass)], attachments=[held("start"), held("end", "load")]
    )
    trajectory, _ = run(scene, 10 * 2 * np.pi / omega, 0.05 * 2 * np.pi / omega)

    def decaying(t: Array, c: float, a: float, d: float, w: float, p: float) -> Array:
        return c + a * np.exp(-d * t) * np.cos(w * t + p)

    z = trajectory.positions[:, 0, 2]
    guess = [z.mean(), 0.4 * mass * G / stiffness, 0.5 * omega**2 * damping, omega, 0.0]
    (_, _, decay, fitted, _), _ = curve_fit(decaying, trajectory.times, z, p0=guess)
    return float(fitted), float(decay), float(omega)


@pytest.mark.parametrize("stiffness", [100.0, 1e4])
def test_load_bounces_on_a_rope_without_losing_energy(stiffness: float) -> None:
    """omega^2 = EA/(L (M + rho L/3)) to 0.5%; less than 1% of the amplitude is lost in a period where nothing damps."""
    fitted, decay, omega = bounce(stiffness, 0.0)
    assert fitted == pytest.approx(omega, rel=5e-3)
    assert abs(decay) * 2 * np.pi / omega < 0.01


def test_load_on_a_damped_rope_decays_as_given() -> None:
    """T = EA (strain + tau strain rate): amplitude exp(-omega^2 tau t/2), to 3%."""
    tau = 0.002
    _, decay, omega = bounce(1e3, tau)
    assert decay == pytest.approx(0.5 * omega**2 * tau, rel=0.03)


def string(segments: int) -> float:
    """Fundamental frequency of a taut string over sqrt(T/mu)/(2 L)."""
    tension, density, length, strain = 20.0, 0.02, 1.0, 0.002
    x = np.linspace(0.0, length, 41)
    points = np.stack([x, np.zeros_like(x), 1e-3 * np.sin(np.pi * x / length)], axis=1)
    strung = rope(
        points.tolist(),
        segments,
        length=length / (1 + strain),
        linear_density=density * (1 + strain),
        stretch_stiffness=tension / strain,
    )
    scene = world(strung, attachments=[held("start"), held("end")], gravity=(0.0, 0.0, 0.0))
    exact = np.sqrt(tension / density) / (2 * length)
    trajectory, motion = run(scene, 5.6 / exact, 0.02 / exact)
    return frequency(trajectory.times, motion.points[:, segments // 2, 2]) / exact


@pytest.mark.parametrize(("segments", "tolerance"), [(40, 0.003), (20, 0.006)])
def test_string_sounds_its_note(segments: int, tolerance: float) -> None:
    """f = sqrt(T/mu)/(2 L) (Mersenne), to 0.3% at 40 segments; a bead string is low by (pi/N)^2/24."""
    assert string(segments) == pytest.approx(1.0, rel=tolerance)


def chain(segments: int) -> float:
    """Fundamental frequency of a hanging chain over that of the continuum."""
    length = 1.0
    # J0(2.4048 sqrt(s/L)), s from the free end: the first mode.
    from scipy.special import j0

    s = np.linspace(length, 0.0, 41)
    points = np.stack([0.01 * j0(2.404826 * np.sqrt(s / length)), np.zeros_like(s), s - length], axis=1)
    hanging = rope(points.tolist(), segments, linear_density=0.1, stretch_stiffness=1e4)
    exact = 1.202413 * np.sqrt(G / length) / (2 * np.pi)
    trajectory, motion = run(world(hanging, attachments=[held("start")]), 4.2 / exact, 0.02 / exact)
    return frequency(trajectory.times, motion.points[:, -1, 0]) / exact


@pytest.mark.parametrize(("segments", "tolerance"), [(40, 0.005), (20, 0.01)])
def test_hanging_chain_swings_with_bernoullis_frequency(segments: int, tolerance: float) -> None:
    """omega = (2.4048/2) sqrt(g/L) = 1.2024 sqrt(g/L) (Bernoulli 1732: first root of J0), to 0.5% at 40 segments."""
    assert chain(segments) == pytest.approx(1.0, rel=tolerance)


def test_pulse_runs_along_a_string_with_the_wave_speed() -> None:
    """c = sqrt(T/mu): a pulse on a long string splits in two, whose crests are c t from where it was, to 1%."""
    tension, density, strain = 20.0, 0.02, 0.002
    x = np.linspace(0.0, 4.0, 401)
    points = np.stack([x, np.zeros_like(x), 2e-3 * np.exp(-(((x - 2.0) / 0.1) ** 2))], axis=1)
    strung = rope(
        points.tolist(),
        200,
        length=4.0 / (1 + strain),
        linear_density=density * (1 + strain),
        stretch_stiffness=tension / strain,
    )
    scene = world(strung, attachments=[held("start"), held("end")], gravity=(0.0, 0.0, 0.0))
    _, motion = run(scene, 0.04)
    place, height = motion.points[-1, :, 0], motion.points[-1, :, 2]
    right = np.flatnonzero(place > 2.2)
    peak = right[np.argmax(height[right])]
    a, b, c = height[peak - 1 : peak + 2]
    crest = place[peak] + 0.5 * (a - c) / (a - 2 * b + c) * (place[peak + 1] - place[peak])
    assert crest - 2.0 == pytest.approx(0.04 * np.sqrt(tension / density), rel=0.01)


def rod_frequency(segments: int) -> float:
    """First frequency of a cantilever rod over (1.8751^2/2 pi) sqrt(EI/(mu L^4))."""
    bending, density, length = 0.5, 0.1, 1.0
    beta = 1.875104
    s = np.linspace(0.0, 1.0, 81)
    ratio = (np.cosh(beta) + np.cos(beta)) / (np.sinh(beta) + np.sin(beta))
    mode = np.cosh(beta * s) - np.cos(beta * s) - ratio * (np.sinh(beta * s) - np.sin(beta * s))
    # The clamp holds the direction of the first segment, which the mode leaves along x.
    points = np.stack([length * s, np.zeros_like(s), 1e-3 * mode * (s > 0.013)], axis=1)
    rod = rope(points.tolist(), segments, linear_density=density, stretch_stiffness=1e5, bending_stiffness=bending)
    scene = world(rod, attachments=[held("start", clamped=True)], gravity=(0.0, 0.0, 0.0))
    exact = beta**2 * np.sqrt(bending / density) / (2 * np.pi)
    trajectory, motion = run(scene, 4.2 / exact, 0.02 / exact)
    return frequency(trajectory.times, motion.points[:, -1, 2]) / exact


@pytest.mark.parametrize(("segments", "tolerance"), [(20, 0.01), (10, 0.02)])
def test_cantilever_rod_vibrates_with_its_frequency(segments: int, tolerance: float) -> None:
    """(1.8751^2/2 pi) sqrt(EI/(mu L^4)) (Euler-Bernoulli), to 1% at 20 segments."""
    assert rod_frequency(segments) == pytest.approx(1.0, rel=tolerance)


def test_flung_rope_keeps_its_momenta() -> None:
    """A bent, turning rod tied to a turning ball, without gravity: linear and angular momentum stay, to 1e-6 and 1e-4.

    It bends with bending and stretch damping, which are inner forces.
    """
    angle = np.linspace(0.0, 2.0, 31)
    points = np.stack([np.cos(angle), np.sin(angle), 0.1 * angle], axis=1)
    rod = rope(
        points.tolist(),
        30,
        linear_density=0.2,
        stretch_stiffness=500.0,
        stretch_damping=1e-3,
        bending_stiffness=0.02,
        bending_damping=0.01,
        velocity=[0.3, 0.0, 0.5],
    )
    mass, radius = 0.3, 0.02
    thrown = ball("ball", points[-1].tolist(), mass, velocity=[-1.0, 2.0, 1.0], angular_velocity=[5.0, 0.0, 10.0])
    scene = world(rod, objects=[thrown], attachments=[held("end", "ball")], gravity=(0.0, 0.0, 0.0))
    trajectory, motion = run(scene, 1.0, 0.25)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    masses = np.full(31, 0.2 * length / 30)
    masses[[0, -1]] *= 0.5
    x, v = trajectory.positions[:, 0], trajectory.velocities[:, 0]
    linear = (masses[:, None] * motion.velocities).sum(axis=1) + mass * v
    inertia = 0.4 * mass * radius**2
    spin = (
        (masses[:, None] * np.cross(motion.points, motion.velocities)).sum(axis=1)
        + mass * np.cross(x, v)
        + inertia * trajectory.angular_velocities[:, 0]
    )
    np.testing.assert_allclose(linear - linear[0], 0.0, atol=1e-6 * np.linalg.norm(linear[0]))
    np.testing.assert_allclose(spin - spin[0], 0.0, atol=1e-4 * np.linalg.norm(spin[0]))


def test_conical_load_keeps_its_tension() -> None:
    """A load swung in a level circle by a light cord: T = M omega^2 L, to 0.5%; its speed stays to 0.1% in 10 turns."""
    mass, length, speed = 0.5, 1.0, 4.0
    strain = mass * speed**2 / length / 1e4
    cord = rope(
        [[0, 0, 0], [length, 0, 0]],
        10,
        linear_density=0.001,
        stretch_stiffness=1e4,
        stretch_damping=1e-3,
        length=length / (1 + strain),
    )
    load = ball("load", [length, 0, 0], mass, velocity=[0.0, speed, 0.0])
    scene = world(cord, objects=[load], attachments=[held("start"), held("end", "load")], gravity=(0.0, 0.0, 0.0))
    trajectory, motion = run(scene, 10 * 2 * np.pi * length / speed)
    assert motion.quantities["tension"][-1].mean() == pytest.approx(mass * speed**2 / length, rel=5e-3)
    assert np.linalg.norm(trajectory.velocities[-1, 0]) == pytest.approx(speed, rel=1e-3)
