"""Residuals of simulated motion against a run: planar motion in any plane, and what an observer reports."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polyworld.data.hinge_angles import HingedBody
from polyworld.data.recording import Run
from polyworld.estimation.noise import RunNoise
from polyworld.estimation.readout import CHANNELS, ObservedMotion, RunReadout
from polyworld.solver.rollout import simulator
from polyworld.world import Environment, MotionPlane, World
from polyworld.world.geometry import plane_axes
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

TIMES = np.arange(31) / 30.0


def unit(objects: int) -> RunNoise:
    return RunNoise(*(np.ones((objects, 3)) for _ in range(3)))


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.36, -0.48, 0.8)])
def test_planar_residuals_are_places_turns_and_spins_from_what_was_measured(normal: tuple[float, float, float]) -> None:
    """Two discs that collide in any plane, one of which looks the same after a third of a turn, with gaps in the data:
    against differences of the rollout's own motion, its turns by SciPy."""
    rng = np.random.default_rng(5)
    plane = MotionPlane(normal=normal)
    x, y, n = plane_axes(plane)
    shape, leaning = Sphere(radius=0.1), tuple(Rotation.from_rotvec([0.3, -0.2, 0.5]).as_quat(scalar_first=True))
    discs = tuple(
        RigidObject(
            name=name,
            representation="rigid_planar",
            shape=shape,
            mass=1.0,
            position=tuple(place),
            velocity=tuple(speed),
            angular_velocity=tuple(spin * n),
            orientation=leaning,
        )
        for name, place, speed, spin in (("a", 0.0 * x, 1.0 * x, 2.0), ("b", 0.5 * x + 0.05 * y, -0.5 * x, -9.0))
    )
    world = World(objects=discs, environment=Environment(gravity=(0.0, 0.0, 0.0), motion_plane=plane))
    moved = simulator(world, TIMES).run()
    places = moved.positions[0] + rng.normal(0.0, 0.02, moved.positions[0].shape)
    errors = rng.normal(0.0, 0.1, (31, 2))
    errors[:, 1] += rng.integers(0, 3, 31) * (2.0 * np.pi / 3.0)
    shifts = Rotation.from_rotvec(errors.reshape(-1, 1) * n)
    turned = shifts * Rotation.from_quat(moved.orientations[0].reshape(-1, 4), scalar_first=True)
    orientations = turned.as_quat(scalar_first=True).reshape(31, 2, 4)
    orientations[7:9, 1] = np.nan
    places[3, 0] = np.nan
    spins = moved.angular_velocities[0] + rng.normal(0.0, 0.3, (31, 2, 3))
    spins[12:15, 1] = np.nan
    run = Run("r", ("a", "b"), TIMES, places, orientations, symmetry=(1, 3), angular_velocities=spins)
    readout = RunReadout(world, run, unit(2))
    masses = np.array([1.0, 1.002])
    batch = simulator(world, TIMES, n_worlds=2).run({"objects.a.mass": masses})
    flat, about = np.abs(n) < 1.0 - 1e-9, np.abs(n) > 1e-9  # components that can change
    expected = np.full((2, 31, 2, CHANNELS), np.nan)
    apart = batch.positions - places
    apart = apart - (apart @ n)[..., None] * n  # within the plane
    expected[..., :3] = np.where(flat, apart, np.nan)
    expected[..., 6:] = np.where(about, batch.angular_velocities - spins, np.nan)
    for column, period in enumerate((2.0 * np.pi, 2.0 * np.pi / 3.0)):
        rows = np.flatnonzero(np.isfinite(orientations[:, column, 0]))
        simulated = Rotation.from_quat(batch.orientations[:, rows, column].reshape(-1, 4), scalar_first=True)
        was = Rotation.from_quat(np.tile(orientations[rows, column], (2, 1)), scalar_first=True)
        angle = ((simulated * was.inv()).as_rotvec() @ n).reshape(2, -1)
        expected[:, rows, column, 5] = angle - period * np.round(angle / period)
    for samples in (31, 16):
        for found, right in zip(readout.residuals(batch, samples), expected, strict=True):
            grid = np.where(np.arange(31)[:, None] < samples, right.reshape(31, -1), np.nan)
            np.testing.assert_allclose(readout.grid(found), grid, atol=1e-12)


def test_spins_are_compared_as_an_observer_with_a_tilt_and_a_fast_clock_reports_them() -> None:
    """A top in free flight, seen by a camera that is turned and counts 1.1 s a second: against SciPy's rotation."""
    spin, tilt, clock = np.array([3.0, -20.0, 7.0]), np.array([0.2, -0.4, 0.1]), 1.1
    observer = {"tilt": tuple(tilt), "clock": clock}
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0.0, 0.0, 1.0]}
    world = World.model_validate({"objects": [ball | {"angular_velocity": tuple(spin)}], "observer": observer})
    seen = np.tile(Rotation.from_rotvec(tilt).inv().apply(spin) / clock, (31, 1, 1))
    seen[4, 0, 1] = np.nan
    nothing = np.full((31, 1, 3), np.nan), np.full((31, 1, 4), np.nan)
    run = Run("r", ("ball",), TIMES, *nothing, angular_velocities=seen)
    observed = ObservedMotion(world, run)(simulator(world, TIMES).run(), {})
    found = RunReadout(world, run, unit(1)).residuals(observed, 31)
    assert found.shape == (1, 92)
    np.testing.assert_allclose(found, 0.0, atol=1e-9)


@pytest.mark.parametrize("swing", [0.4, 1.3])
def test_an_angle_counts_once_and_as_accurate_everywhere(swing: float) -> None:
    """Angles of a pendulum with noise of 3 mrad, against those of the rollout: residuals are their differences."""
    shape, anchor, arm = Sphere(radius=0.01), np.array([0.1, 0.0, 0.5]), 0.7
    bob = RigidObject(name="bob", shape=shape, mass=1.0, position=tuple(anchor - np.array([0.0, 0.0, arm])))
    pivot = Hinge(name="pivot", object="bob", anchor=tuple(anchor), axis=(0.0, 1.0, 0.0))
    world = World(objects=(bob,), joints=(pivot,))
    errors = np.random.default_rng(3).normal(0.0, 0.003, len(TIMES))
    angles = swing * np.cos(3.0 * TIMES)
    places, turns = HingedBody.of(world, "bob").measured(angles + errors)
    run = Run("r", ("bob",), TIMES, places[:, None], turns[:, None], arms=(arm,))
    noise = RunNoise(np.full((1, 3), 0.003 * arm), np.ones((1, 3)), np.ones((1, 3)))
    readout = RunReadout(world, run, noise)
    moved = simulator(world, TIMES).run()
    moved.positions[0, :, 0] = HingedBody.of(world, "bob").positions(angles)
    (found,) = readout.residuals(moved, len(TIMES))
    assert readout.size == len(TIMES)
    np.testing.assert_allclose(np.abs(found), np.abs(errors) / 0.003, atol=0.02)
