"""First guesses of initial states, held against bodies that fall, and bodies that are supported."""

import numpy as np
import pytest

from polyworld.data.recording import Run
from polyworld.estimation.states import state_coordinates
from polyworld.world import World

TIMES = np.arange(60) / 120.0


FLOOR = {"name": "floor", "shape": {"kind": "plane"}}


def guessed(height, sigma, statics=(FLOOR,), **changes):
    """First guesses by label of a ball seen at heights (T,) as it moves along x at 2 m/s, and where it is known."""
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 0.1], **changes}
    world = World.model_validate({"objects": [ball], "statics": list(statics)})
    places = np.stack([2.0 * TIMES, np.zeros_like(TIMES), height], axis=-1)[:, None]
    places = places + np.random.default_rng(3).normal(0.0, sigma, places.shape)
    run = Run("r", ("ball",), TIMES, places, np.full((len(TIMES), 1, 4), np.nan))
    (found,) = state_coordinates(world, run)
    known = {path: v[0] for path, v in found.overrides(found.start[None], {}).items() if path[8:] not in found.labels}
    start = {label.removeprefix("ball."): v for label, v in zip(found.labels, found.start, strict=True)}
    return start | {f"known {path.removeprefix('objects.ball.')}": v for path, v in known.items()}


@pytest.mark.parametrize("sigma", [0.0005, 0.005, 0.02])
def test_a_ball_on_the_floor_has_no_velocity_upwards_to_be_fitted(sigma):
    found = guessed(np.full_like(TIMES, 0.1), sigma)
    assert "velocity.z" not in found
    assert "position.z" not in found
    assert found["known position.z"] == pytest.approx(0.1, abs=1e-9)


def test_a_box_on_the_floor_has_no_height_to_be_fitted():
    found = guessed(np.full_like(TIMES, 0.1), 0.002, shape={"kind": "box", "half_extents": [0.1, 0.1, 0.1]})
    assert "velocity.z" not in found
    assert found["known position.z"] == pytest.approx(0.1, abs=1e-9)


@pytest.mark.parametrize("sigma", [0.0005, 0.005])
def test_a_falling_ball_starts_with_the_velocity_it_was_thrown_with(sigma):
    found = guessed(1.0 + 1.0 * TIMES - 0.5 * 9.81 * TIMES**2, sigma)
    assert found["velocity.z"] == pytest.approx(1.0, abs=60 * sigma)


def test_a_ball_that_hops_is_not_at_rest():
    """Up 6 cm and down again, three times: level on average."""
    phase = TIMES % 0.22
    hops = 0.1 + 0.5 * 9.81 * phase * (0.22 - phase)
    assert "velocity.z" in guessed(hops, 0.005)


def test_a_ball_thrown_up_is_not_at_rest_though_its_noise_drifts():
    missed = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        drift = np.zeros_like(TIMES)
        for i in range(len(TIMES)):
            drift[i] = (0.9 * drift[i - 1] if i else 0.0) + 0.03 * np.sqrt(1.0 - 0.81) * rng.normal()
        missed += "velocity.z" not in guessed(2.0 + 1.2 * TIMES - 0.5 * 9.81 * TIMES**2 + drift, 1e-4)
    assert missed == 0


def test_a_ball_on_another_body_may_rest():
    balls = [
        {"name": n, "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, z]}
        for n, z in (("upper", 0.3), ("lower", 0.1))
    ]
    world = World.model_validate({"objects": balls, "statics": [{"name": "floor", "shape": {"kind": "plane"}}]})
    places = np.zeros((len(TIMES), 2, 3))
    places[:, :, 2] = [0.3, 0.1]
    places += np.random.default_rng(3).normal(0.0, 0.001, places.shape)
    found = state_coordinates(world, Run("r", ("upper", "lower"), TIMES, places, np.full((len(TIMES), 2, 4), np.nan)))
    assert not any(label.endswith(".velocity.z") for s in found for label in s.labels)
    alone = Run("r", ("upper",), TIMES, places[:, :1] + [2.0, 0.0, 0.0], np.full((len(TIMES), 1, 4), np.nan))
    (upper,) = state_coordinates(world, alone)
    assert "upper.velocity.z" in upper.labels


def test_a_measured_spin_is_the_first_guess_where_turns_were_seen_or_none_was():
    turn = np.stack([np.cos(2 * TIMES), 0 * TIMES, 0 * TIMES, np.sin(2 * TIMES)], axis=-1)[:, None]  # 4 rad/s about z
    spins = np.full((len(TIMES), 1, 3), np.nan)
    spins[3:, 0, 2] = 30.0  # as read by a faster instrument: seven turns too many to see between samples
    places = np.stack([TIMES, 0 * TIMES, 0.1 + 0 * TIMES], axis=-1)[:, None]
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 0.1]}
    for representation, turns in (("rigid_spatial", turn), ("rigid_planar", np.full_like(turn, np.nan))):
        statics = [{"name": "wall", "shape": {"kind": "wall", "start": [0, 1, 0], "end": [2, 1, 0]}}]
        world = World.model_validate({"objects": [ball | {"representation": representation}], "statics": statics})
        run = Run("r", ("ball",), TIMES, places, turns, angular_velocities=spins)
        (found,) = state_coordinates(world, run)
        start = dict(zip(found.labels, found.start, strict=True))
        assert start["ball.angular_velocity.z"] == pytest.approx(30.0)
        assert start.get("ball.angular_velocity.x", 0.0) == pytest.approx(0.0, abs=1e-9)
