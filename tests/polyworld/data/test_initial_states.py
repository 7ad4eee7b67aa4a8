"""Initial states of bodies in flight: few frames per second, distances that are hardly known, short paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.initial_states import initial_states, with_initial_states
from polyworld.data.tracks import ObservedTracks
from tests.polyworld.estimation.pucks import CROSSING, FRAME, RADIUS, discs, tracks, world
from tests.scenes.discs import slide

Floats = NDArray[np.float64]
G = (0.0, 0.0, -9.81)
START, SPEED = np.array([-0.8, 0.3, 0.5]), np.array([2.1, 0.1, 2.2])
CAMERA = np.array([0.0, -3.0, 1.0])


def track(count: int, rate: float, *, pull: Floats, spread: float = 0.0, noise: float = 0.005) -> ObservedTracks:
    """A ball that flies, or slides, seen from CAMERA: `spread` of its distance is not known."""
    t = np.arange(count)[:, None] / rate
    places = START + SPEED * t + 0.5 * pull * t**2
    seen = places + np.random.default_rng(2).normal(0.0, noise, places.shape)
    return ObservedTracks(
        names=("ball",),
        frames=np.arange(count),
        seconds_per_frame=1.0 / rate,
        positions=seen[:, None],
        position_sigma=np.full((count, 1), noise),
        orientations=np.full((count, 1, 4), np.nan),
        confidence=np.ones((count, 1)),
        orientation_confidence=np.zeros((count, 1)),
        symmetry=(0,),
        position_spread=None if spread == 0.0 else (spread * (places - CAMERA))[:, None],
    )


@pytest.mark.parametrize("spread", [0.0, 0.06])
def test_a_throw_of_few_frames_begins_upwards_however_little_is_known_of_its_distance(spread: float) -> None:
    """In the half second of seven frames at twelve a second gravity turns 2.2 m/s up into 2.7 m/s down."""
    state = initial_states(track(7, 12.0, pull=np.array(G), spread=spread), gravity=G)["ball"]
    np.testing.assert_allclose(state.velocity, SPEED, atol=0.15)
    assert np.all(np.abs(state.velocity - SPEED) < 3.0 * state.velocity_sd)


def test_what_is_not_known_of_a_distance_is_not_known_of_the_start() -> None:
    """A distance of 3.4 m that may be 6% off leaves 0.2 m, most of it across the room."""
    known, vague = (initial_states(track(12, 30.0, pull=np.array(G), spread=s), gravity=G)["ball"] for s in (0.0, 0.06))
    assert known.position_sd < 0.02
    assert vague.position_sd == pytest.approx(0.06 * np.abs(START - CAMERA).max(), rel=0.05)
    assert vague.velocity_sd > known.velocity_sd


@pytest.mark.parametrize("pull", [np.array(G), np.zeros(3)])
def test_a_path_too_short_for_its_curvature_is_a_fall_or_straight(pull: Floats) -> None:
    state = initial_states(track(5, 60.0, pull=pull, noise=0.002), gravity=G)["ball"]
    np.testing.assert_allclose(state.velocity, SPEED, atol=0.12)


def pucks(frames: int = 90, *, sigma: float, seed: int) -> ObservedTracks:
    return tracks(slide(discs([0.12, 0.12]), CROSSING, np.arange(frames) / 60.0), sigma=sigma, seed=seed)


@pytest.mark.parametrize("sigma", [1e-4, 0.02])
def test_the_true_initial_state_is_within_its_stated_errors(sigma: float) -> None:
    errors = []
    for seed in range(12):
        state = initial_states(pucks(sigma=sigma, seed=seed), seconds_per_frame=1.0 / 60.0)["a"]
        place, speed = state.position[:2] - CROSSING.positions[0], state.velocity[:2] - CROSSING.velocities[0]
        errors.append([np.hypot(*place) / state.position_sd, np.hypot(*speed) / state.velocity_sd])
        assert state.moves
    assert np.max(errors) < 5.0, np.max(errors, axis=0)


def test_free_motion_ends_where_the_collision_is() -> None:
    path = slide(discs([0.12, 0.12]), CROSSING, np.arange(60) / 60.0)
    met = int(np.argmax(np.hypot(*(path[:, 1, :2] - path[:, 0, :2]).T) < 2.0 * RADIUS + 0.05))
    state = initial_states(tracks(path, sigma=0.001, seed=4), seconds_per_frame=1.0 / 60.0)["a"]
    assert met - 8 <= state.free_until <= met + 3


def test_a_late_body_joins_when_it_is_first_seen() -> None:
    path = np.zeros((40, 1, 2))
    path[:, 0, 0] = np.arange(40) * 0.01
    late = tracks(path, sigma=0.001, seed=2)
    confidence = late.confidence.copy()
    confidence[:10] = 0.0
    placed = with_initial_states(world(1), replace(late, confidence=confidence)).object("a")
    assert placed.start_time == pytest.approx(10.0 * FRAME)
    assert placed.position == pytest.approx((0.1, 0.0, 0.05), abs=0.002)  # in the plane: the height stays the world's
    assert placed.velocity[0] == pytest.approx(0.01 / FRAME, abs=0.02)
