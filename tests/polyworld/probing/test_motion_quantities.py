"""Energy, momentum, acceleration and period against laws in closed form, simulated and measured."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.track_motion import local_motion
from polyworld.data.tracks import ObservedTracks
from polyworld.probing.motion_quantities import mechanical_quantities, period
from polyworld.solver.rollout import rollout
from polyworld.world import TimeBase, World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere

G = 9.81


def test_a_thrown_spinning_box_keeps_its_energy_and_falls_with_g() -> None:
    box = RigidObject(
        name="box",
        shape=Box(half_extents=(0.1, 0.05, 0.02)),
        position=(0.0, 0.0, 5.0),
        velocity=(1.0, 2.0, 3.0),
        angular_velocity=(3.0, 1.0, -2.0),
        mass=0.5,
    )
    world = World(objects=(box,), time=TimeBase(seconds_per_frame=0.02, frame_count=51))
    trajectory = rollout(world, 1.0).trajectory
    found = mechanical_quantities(world, trajectory, "box")
    energy = found.kinetic_energy + found.potential_energy
    assert energy == pytest.approx(np.full(51, energy[0]), rel=1e-3)
    assert found.potential_energy[0] == pytest.approx(0.5 * G * 5.0)
    assert found.acceleration == pytest.approx(np.tile([0.0, 0.0, -G], (51, 1)), abs=1e-6)
    assert found.momentum[0] == pytest.approx([0.5, 1.0, 1.5])
    a, b, c = 0.1, 0.05, 0.02
    inertia = 0.5 / 3.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    turning = 0.5 * inertia @ np.array([9.0, 1.0, 4.0])
    assert found.kinetic_energy[0] == pytest.approx(0.5 * 0.5 * 14.0 + turning, rel=1e-9)


def test_a_pendulum_swings_with_the_period_of_a_physical_pendulum() -> None:
    """A ball of radius r on a hinge at distance l: T = 2 pi sqrt((l^2 + 2 r^2 / 5) / (g l)) (1 + a^2 / 16)."""
    length, radius, angle = 0.5, 0.05, 0.1
    ball = RigidObject(
        name="bob", shape=Sphere(radius=radius), position=(length * np.sin(angle), 0.0, 1.0 - length * np.cos(angle))
    )
    hinge = Hinge(name="pivot", object="bob", anchor=(0.0, 0.0, 1.0), axis=(0.0, 1.0, 0.0))
    world = World(objects=(ball,), joints=(hinge,), time=TimeBase(seconds_per_frame=0.02, frame_count=2))
    trajectory = rollout(world, 6.0).trajectory
    found = period(trajectory.times, trajectory.positions[:, 0, 0])
    expected = 2.0 * np.pi * np.sqrt((length**2 + 0.4 * radius**2) / (G * length)) * (1.0 + angle**2 / 16.0)
    assert found is not None
    assert found.period == pytest.approx(expected, rel=2e-3)
    assert found.cycles >= 3.5


def test_a_period_of_noisy_values_lies_within_its_errors() -> None:
    rng, times = np.random.default_rng(2), np.arange(100) * 0.04
    scores = []
    for _ in range(200):
        values = 0.1 * np.sin(2.0 * np.pi * times / 1.1 + rng.uniform(0.0, 6.0)) + 0.01 * rng.normal(size=100)
        found = period(times, values, sigma=0.01)
        assert found is not None
        assert found.standard_error is not None
        scores.append((found.period - 1.1) / found.standard_error)
    assert np.mean(np.abs(scores) < 1.645) == pytest.approx(0.9, abs=0.08)


@pytest.mark.parametrize("values", [np.linspace(0.0, 1.0, 50), np.zeros(50), np.linspace(-1.0, 1.0, 50) ** 2])
def test_what_does_not_go_round_has_no_period(values: np.ndarray) -> None:
    assert period(np.arange(50) * 0.04, values) is None


def tracks(places: np.ndarray, sigma: float, rng: np.random.Generator) -> ObservedTracks:
    count = len(places)
    noisy = places + sigma * rng.normal(size=places.shape)
    return ObservedTracks(
        names=("ball",),
        frames=np.arange(count),
        seconds_per_frame=0.02,
        positions=noisy[:, None],
        position_sigma=np.full((count, 1), sigma),
        orientations=np.full((count, 1, 4), np.nan),
        confidence=np.ones((count, 1)),
        orientation_confidence=np.zeros((count, 1)),
        symmetry=(0,),
    )


def test_measured_free_flight_has_g_and_constant_energy_within_its_errors() -> None:
    t, mass, gravity = np.arange(40) * 0.02, 0.2, np.array([0.0, 0.0, -G])
    places = np.stack([1.5 * t, np.zeros(40), 1.0 + 3.0 * t - 0.5 * G * t**2], axis=1)
    within = {"acceleration": [], "momentum": [], "energy": []}
    for seed in range(60):
        found = local_motion(tracks(places, 0.002, np.random.default_rng(seed)), "ball")
        k = 3 + seed % 34
        scores = (found.derivatives[k, 2, 2] + G) / found.standard_errors(2)[k, 2]
        within["acceleration"].append(abs(scores) < 1.645)
        within["momentum"].append(abs(found.derivatives[k, 1, 0] - 1.5) < 1.645 * found.standard_errors(1)[k, 0])
        energy, error = found.energy(mass, gravity)
        expected = 0.5 * mass * (1.5**2 + 3.0**2) + mass * G
        within["energy"].append(abs(energy[k] - expected) < 1.645 * error[k])
    for name, inside in within.items():
        assert 0.75 <= np.mean(inside) <= 1.0, name


def test_an_impact_ends_the_window() -> None:
    """A ball that turns round between two samples: its speed before and after is not averaged."""
    t = np.arange(40) * 0.02
    places = np.stack([np.abs(t - 0.41) * 2.0, np.zeros(40), np.zeros(40)], axis=1)
    found = local_motion(tracks(places, 0.001, np.random.default_rng(0)), "ball")
    assert found.derivatives[:16, 1, 0] == pytest.approx(np.full(16, -2.0), abs=0.2)
    assert found.derivatives[26:, 1, 0] == pytest.approx(np.full(14, 2.0), abs=0.2)
    few = tracks(places[:4], 0.001, np.random.default_rng(0))
    with pytest.raises(ValueError, match="4 measured positions"):
        local_motion(few, "ball")
