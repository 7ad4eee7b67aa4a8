"""The readers of measured data against what is published or can be computed from them by other means."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from polyworld.data.recording_csv import read_recording
from polyworld.data.recording_header import RecordingForm
from polyworld.estimation.noise import run_noise
from polyworld.estimation.readout import RunReadout
from polyworld.estimation.states import state_coordinates
from tests.real_data import CUBE_UNIT, FOLDER, ball_drop, clevrer, cube_toss, needs, pendulum


@needs("ball_drop")
def test_dropped_balls_fall_from_the_first_row_on_and_only_heights_are_known() -> None:
    world, recording = ball_drop()
    assert [o.name for o in world.objects] == ["baseball", "golf_ball", "volleyball", "whiffle_ball_1"]
    assert len(recording.runs) == 8
    for run in recording.runs:
        height = run.positions[:, 0, 2]
        assert np.isnan(run.positions[:, 0, :2]).all()
        assert np.all(np.diff(height) < 0.0)
        # Nothing falls faster than in vacuum: the acceleration over the whole run.
        assert -10.5 < 2.0 * np.polyfit(run.times, height, 2)[0] < -1.0
    golf = world.object("golf_ball")
    assert golf.mass is not None
    assert 0.0450 < golf.mass < 0.0463  # the rules allow up to 45.93 g
    for run, noise in zip(recording.runs, run_noise(recording.runs), strict=True):
        assert RunReadout(world, run, noise).size == len(run.times)


@needs("pendulum")
def test_the_pendulum_begins_as_a_mathematical_pendulum_of_its_length_does() -> None:
    world, recording = pendulum(until=3.0)
    run = recording.runs[0]
    bob = world.objects[0]
    place = run.positions[:, 0]
    arm = np.hypot(place[:, 0], place[:, 2])
    assert np.ptp(arm) < 1e-12
    angle = np.unwrap(np.arctan2(-place[:, 0], -place[:, 2]))
    equivalent = arm[0] + 0.4 * 0.01**2 / arm[0]
    # Against an integration from the state after the first quarter swing; damping takes 2% a swing.
    start, end = 20, 120
    rate = (angle[start + 1] - angle[start - 1]) / 0.02
    solution = solve_ivp(
        lambda _, y: [y[1], -9.81 / equivalent * np.sin(y[0])],
        (0.0, 1.0),
        [angle[start], rate],
        t_eval=np.arange(end - start) * 0.01,
        rtol=1e-9,
    )
    assert np.abs(solution.y[0] - angle[start:end]).max() < 0.2
    assert np.allclose(bob.position, np.nan_to_num(place[0]))
    (state,) = state_coordinates(world, run)
    assert state.labels == ("bob.angle", "bob.rate")
    assert np.isfinite(state.start).all()  # although y was not measured


@needs("pendulum")
def test_a_table_of_the_encoders_readings_gives_the_same_positions(tmp_path: Path) -> None:
    world, recording = pendulum(until=3.0)
    path = tmp_path / "swing.csv"
    with np.load(FOLDER / "pendulum" / "single_freeswing_100Hz.npz") as file:
        rows = zip(file["t"].astype(float).tolist(), file["theta"].astype(float).tolist(), strict=True)
        path.write_text("time [s],theta\n" + "".join(f"{t!r},{theta!r}\n" for t, theta in rows if t <= 3.0))
    read = read_recording(path, form=RecordingForm(theta_hanging=np.pi), world=world).runs[0]
    swing = recording.runs[0]
    assert read.names == ("bob",)
    assert np.allclose(read.times, swing.times)
    assert np.allclose(read.positions, swing.positions, atol=1e-9, equal_nan=True)
    assert np.isnan(read.orientations).all()


@needs("cube_toss")
def test_the_cube_flies_freely_spins_and_comes_to_rest_on_the_table() -> None:
    world, recording = cube_toss((0, 5, 60))
    table = world.statics[0].position[2]
    assert -0.004 < table < 0.0
    for run in recording.runs:
        assert np.allclose(np.diff(run.times), 1.0 / 148.0)
        assert abs(run.positions[-1, 0, 2] - CUBE_UNIT - table) < 0.0015
        turns = Rotation.from_quat(run.orientations[-10:, 0], scalar_first=True)
        up = np.abs(turns.as_matrix()[:, 2]).max(axis=1)
        assert up.min() > 0.995  # one face lies on the table
    flight = recording.run("toss_005")
    fall = 2.0 * np.polyfit(flight.times[:13], flight.positions[:13, 0, 2], 2)[0]
    assert -10.0 < fall < -9.2


@needs("clevrer")
def test_annotated_velocities_fit_the_time_of_0_028_s_a_frame() -> None:
    world, recording = clevrer(("00000", "02000"))
    assert [r.name for r in recording.runs] == ["scene_00000", "scene_02000"]
    run = recording.runs[0]
    moving = [o for o in world.objects if o.name in run.names and np.linalg.norm(o.velocity) > 0.5]
    assert len(moving) >= 3
    for item in moving:
        column = run.names.index(item.name)
        speed = (run.positions[2, column, :2] - run.positions[0, column, :2]) / (2 * 0.028)
        assert np.allclose(speed, item.velocity[:2], atol=0.05 * np.linalg.norm(item.velocity))
    assert any(state.count for state in state_coordinates(world, run))
