"""Initial states of bodies in flight: few frames per second, distances that are hardly known, short paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.initial_states import initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import FitProblem, default_unknowns
from polyworld.estimation.world_fit.sight_lines import sight_lines
from polyworld.world import TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

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


def test_starts_depart_along_the_line_of_sight_as_distances_are_unknown() -> None:
    """A path farther away by a share of its distance starts farther by that share, and is faster by it."""
    ball = RigidObject(
        name="ball",
        shape=Sphere(radius=0.1),
        representation="rigid_spatial",
        position=tuple(START),
        velocity=tuple(SPEED),
    )
    world = World(objects=(ball,), time=TimeBase(seconds_per_frame=1.0 / 30.0, frame_count=8))
    still = np.zeros(3)
    tracks = track(8, 30.0, pull=still, spread=0.05)
    problem = FitProblem(world, tracks, default_unknowns(world, tracks))
    (line,) = sight_lines(problem)
    paths = [unknown.paths[0] for unknown in problem.space.unknowns]
    moved = {path: float(value) for path, value in zip(paths, line, strict=True)}
    for axis, away, speed in zip("xyz", START - CAMERA, SPEED, strict=True):
        assert moved.pop(f"objects.ball.position.{axis}") == pytest.approx(0.05 * away)
        assert moved.pop(f"objects.ball.velocity.{axis}") == pytest.approx(0.05 * speed)
    assert not any(moved.values())
    exact = FitProblem(world, replace(tracks, position_spread=None), default_unknowns(world, tracks))
    assert sight_lines(exact).shape == (0, len(paths))
