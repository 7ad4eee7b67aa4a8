"""Worlds of one batch, each sampled at times of its own, move as they do alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld.solver.rollout import scheduled_simulator, simulator
from polyworld.world import World

LISTS = (np.array([0.0, 0.11, 0.2, 0.37]), np.array([0.05, 0.3]), np.array([0.0, 0.04, 0.08, 0.12, 0.6]))


def padded() -> Any:
    times = np.full((len(LISTS), max(len(t) for t in LISTS)), np.nan)
    for row, own in zip(times, LISTS, strict=True):
        row[: len(own)] = own
    return times


def ball() -> World:
    return World.model_validate(
        {
            "objects": [
                {
                    "name": "ball",
                    "shape": {"kind": "sphere", "radius": 0.03},
                    "mass": 0.1,
                    "restitution": 0.7,
                    "friction": 0.3,
                    "position": [0, 0, 0.2],
                    "velocity": [1, 0, 0],
                }
            ],
            "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
        }
    )


def discs() -> World:
    disc = {
        "representation": "rigid_planar",
        "shape": {"kind": "cylinder", "radius": 0.05, "half_height": 0.01},
        "mass": 0.2,
        "friction": 0.1,
        "restitution": 0.8,
    }
    return World.model_validate(
        {
            "objects": [
                disc | {"name": "a", "position": [0, 0, 0.01], "velocity": [1, 0.1, 0]},
                disc | {"name": "b", "position": [0.3, 0, 0.01]},
            ],
            "environment": {"motion_plane": {"supports": True, "point": [0, 0, 0.01], "friction": 0.1}},
        }
    )


@pytest.mark.parametrize(("world", "path"), [(ball(), "objects.ball.velocity.x"), (discs(), "objects.a.velocity.x")])
def test_each_world_moves_as_it_does_alone(world: World, path: str) -> None:
    which = np.array([2, 0, 1, 1, 0])
    speeds = np.array([0.5, 1.0, 1.5, 2.0, 2.5])
    batch = scheduled_simulator(world, padded(), n_worlds=8).run({path: speeds}, schedule=which)
    for w, (own, speed) in enumerate(zip(which, speeds, strict=True)):
        alone = simulator(world, LISTS[own]).run({path: np.array([speed])})
        count = len(LISTS[own])
        assert np.array_equal(batch.positions[w, :count], alone.positions[0])
        assert np.array_equal(batch.angular_velocities[w, :count], alone.angular_velocities[0])
        assert np.array_equal(batch.times[w, :count], LISTS[own])
        assert np.all(np.isnan(batch.positions[w, count:]))


def test_a_smaller_batch_follows_a_larger_one() -> None:
    world, path = ball(), "objects.ball.velocity.x"
    made = scheduled_simulator(world, padded(), n_worlds=4)
    made.run({path: np.array([3.0, 4.0, 5.0, 6.0])}, schedule=np.array([0, 1, 2, 0]))
    again = made.run({path: np.array([1.0])}, schedule=np.array([2]), samples=3)
    alone = simulator(world, LISTS[2][:3]).run({path: np.array([1.0])})
    assert np.array_equal(again.positions, alone.positions)


def test_batches_larger_than_there_is_room_for_are_refused() -> None:
    made = scheduled_simulator(ball(), padded(), n_worlds=2)
    with pytest.raises(ValueError, match="room for 1 to 2"):
        made.run(schedule=np.zeros(3, dtype=np.int64))
