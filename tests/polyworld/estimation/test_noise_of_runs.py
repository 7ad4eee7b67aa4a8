"""Noise of recorded runs before any model, against noise that was put into smooth motion and into bounces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polyworld.data.recording import Recording, Run
from polyworld.estimation.noise import run_noise
from tests.polyworld.gap_scenes import Bouncing, ball_recording, launches

Array = NDArray[np.float64]

TIMES = np.arange(192) / 120.0


def run(places: Array, times: Array = TIMES, name: str = "run", turns: Array | None = None, **more: Any) -> Run:
    turns = np.full((len(times), 4), np.nan) if turns is None else turns
    return Run(name, ("ball",), times, places[:, None], turns[:, None], **more)


def flight(sigma: float | Array, seed: int, times: Array = TIMES) -> Array:
    """A throw (T, 3) with white noise of a standard deviation or of one by axis."""
    rng = np.random.default_rng(seed)
    path = rng.uniform(10.0, 20.0, 3) + rng.uniform(-3.0, 3.0, 3) * times[:, None]
    path[:, 2] -= 0.5 * 9.81 * times**2
    found: Array = path + rng.normal(0.0, 1.0, path.shape) * sigma
    return found


@pytest.mark.parametrize("sigma", [0.001, 0.03])
def test_white_noise_is_found_in_flights_and_in_bounces(sigma: float) -> None:
    rng = np.random.default_rng(1)
    bounces = ball_recording(Bouncing(), launches(rng, 8), rng, sigma)
    flights = Recording(tuple(run(flight(sigma, k), name=f"r{k}") for k in range(8)))
    for recording in (bounces, flights):
        for noise in run_noise(recording.runs):
            assert noise.position == pytest.approx(np.full((1, 3), sigma), rel=0.15)


@pytest.mark.parametrize("rate", [12.0, 20.0, 100.0])
def test_an_oscillation_with_few_samples_a_period_is_not_taken_for_noise(rate: float) -> None:
    times = np.arange(0.0, 4.0, 1.0 / rate)
    clean = np.stack([0.15 * np.sin(8.0 * times), 0.15 * np.cos(8.0 * times), 0.0 * times], axis=1)  # 1.27 Hz
    places = clean + np.random.default_rng(11).normal(0.0, 2e-4, clean.shape)
    (noise,) = run_noise([run(places, times)])
    assert np.all(noise.position < 5e-4)
    assert np.all(noise.position > 1e-4)


def test_outliers_and_gaps_leave_the_level() -> None:
    rng = np.random.default_rng(9)
    places = flight(0.01, 3)
    places[rng.uniform(size=places.shape) < 0.02] += 0.1
    places[100:130] = np.nan
    (noise,) = run_noise([run(places)])
    assert noise.position == pytest.approx(np.full((1, 3), 0.01), rel=0.25)


def test_positions_in_whole_pixels_have_the_noise_of_rounding_however_evenly_they_move() -> None:
    """One run moves by exactly two pixels a frame, so that its differences scatter by nothing; others do not."""
    pixel, times = 0.005, 0.02 * np.arange(60)
    runs = []
    for k, speed in enumerate((0.5, 0.37, 0.613, 0.741)):
        places = np.stack([0.1 + speed * times, np.full(60, 0.2), np.full(60, 1.0)], axis=1)
        runs.append(run(pixel * np.round(places / pixel), times, f"r{k}"))
    for noise in run_noise(runs):
        assert 0.5 < noise.position[0, 0] / (pixel / np.sqrt(12.0)) < 2.0


def test_noise_of_turns_in_a_plane_is_found_beyond_full_turns() -> None:
    rng = np.random.default_rng(10)
    half = 0.5 * (20.0 * TIMES + rng.normal(0.0, 0.02, len(TIMES)))
    turns = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=1)
    (noise,) = run_noise([run(flight(0.01, 1), turns=turns)])
    assert noise.turn[0, 2] == pytest.approx(0.02, rel=0.15)


def test_noise_of_turns_in_space_is_that_about_one_axis() -> None:
    errors = Rotation.from_rotvec(np.random.default_rng(4).normal(0.0, 0.02, (len(TIMES), 3)))
    spun = Rotation.from_rotvec(np.outer(TIMES, [5.0, -8.0, 3.0]))
    (noise,) = run_noise([run(flight(0.01, 1), turns=(errors * spun).as_quat(scalar_first=True))])
    assert noise.turn == pytest.approx(np.full((1, 3), 0.02), rel=0.15)


def test_noise_that_the_recording_states_is_believed() -> None:
    (noise,) = run_noise([run(flight(0.01, 1), sigma=0.011)])
    assert noise.position == pytest.approx(np.full((1, 3), 0.011))
