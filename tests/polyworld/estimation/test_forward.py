"""The forward model: runs that are seen to turn late, and planar motion in any plane."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.unknown import Unknown
from polyworld.solver.rollout import simulator
from polyworld.world import Environment, MotionPlane, World
from polyworld.world.geometry import plane_axes
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from tests.polyworld.gap_scenes import Bouncing, ball_recording, ball_world, launches


def test_turns_that_are_seen_late_are_none_before() -> None:
    rng = np.random.default_rng(8)
    late = []
    for run in ball_recording(Bouncing(), launches(rng, 4), rng, 0.001).runs:
        turns = np.full_like(run.orientations, np.nan)
        turns[len(run.times) // 2 :] = (1.0, 0.0, 0.0, 0.0)
        late.append(replace(run, orientations=turns))
    plan = design(ball_world(), Recording(tuple(late)))
    settings = [Settings(r.index, np.zeros((3, 0)), np.repeat(r.start[None], 3, axis=0)) for r in plan.runs]
    forward = Forward(plan, plan.world, ())
    for early, whole in zip(forward.residuals(settings, 0.35), forward.residuals(settings), strict=True):
        assert early.shape == whole.shape
        assert np.isfinite(early).all()


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
    times = np.arange(31) / 30.0
    moved = simulator(world, times).run()
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
    run = Run("r", ("a", "b"), times, places, orientations, symmetry=(1, 3), angular_velocities=spins)
    plan = design(world, Recording((run,)), initial="given")
    shared = np.array([[1.0], [1.002]])
    unknown = Unknown("mass", ("objects.a.mass",), "kg", 1.0, 0.1, 10.0, 0.1)
    forward = Forward(plan, world, (unknown,))
    for horizon in (1.0, 0.5):
        (found,) = forward.residuals([Settings(0, shared, np.zeros((2, 0)))], horizon)
        batch = simulator(world, times, n_worlds=2).run({"objects.a.mass": shared[:, 0]})
        rows = times <= horizon * (1.0 + 1e-9)
        for s in plan.runs[0].series:
            column, keep = run.names.index(s.name), rows[s.rows]
            if s.kind == "spin":
                expected = batch.angular_velocities[:, s.rows, column, s.axis] - spins[s.rows, column, s.axis]
            elif s.kind == "position":
                expected = batch.positions[:, s.rows, column, s.axis] - places[s.rows, column, s.axis]
            else:
                turned = Rotation.from_quat(batch.orientations[:, s.rows, column].reshape(-1, 4), scalar_first=True)
                was = Rotation.from_quat(np.tile(orientations[s.rows, column], (2, 1)), scalar_first=True)
                angle = ((turned * was.inv()).as_rotvec() @ n).reshape(2, -1)
                period = 2.0 * np.pi / run.symmetry[column]
                expected = angle - period * np.round(angle / period)
            np.testing.assert_allclose(found[:, s.where][:, keep], expected[:, keep], atol=1e-12)
            assert np.all(found[:, s.where][:, ~keep] == 0.0)
        measured = {(s.name, s.axis) for s in plan.runs[0].series if s.kind == "spin"}
        assert measured == {(name, axis) for name in "ab" for axis in np.flatnonzero(n)}


def test_spins_are_compared_as_an_observer_with_a_tilt_and_a_fast_clock_reports_them() -> None:
    """A top in free flight, seen by a camera that is turned and counts 1.1 s a second: against SciPy's rotation."""
    spin, tilt, clock = np.array([3.0, -20.0, 7.0]), np.array([0.2, -0.4, 0.1]), 1.1
    observer = {"tilt": tuple(tilt), "clock": clock}
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0.0, 0.0, 1.0]}
    world = World.model_validate({"objects": [ball | {"angular_velocity": tuple(spin)}], "observer": observer})
    times = np.arange(20) / 30.0
    seen = np.tile(Rotation.from_rotvec(tilt).inv().apply(spin) / clock, (20, 1, 1))
    seen[4, 0, 1] = np.nan
    nothing = np.full((20, 1, 3), np.nan), np.full((20, 1, 4), np.nan)
    plan = design(world, Recording((Run("r", ("ball",), times, *nothing, angular_velocities=seen),)), initial="given")
    (found,) = Forward(plan, world, ()).residuals([Settings(0, np.zeros((1, 0)), np.zeros((1, 0)))])
    assert found.shape == (1, 59)
    np.testing.assert_allclose(found, 0.0, atol=1e-9)
