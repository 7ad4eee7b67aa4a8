"""Worlds that are simulated at the same time by several threads move as they do alone."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from polyworld.core import buffers
from polyworld.core.capture_lock import CaptureLock
from polyworld.solver.rollout import rollout
from polyworld.world import World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere


def rope() -> World:
    line = {"name": "line", "representation": "rope", "points": [(0, 0, 1), (0.5, 0, 1)], "segments": 6}
    return World.model_validate({"deformables": [line]})


def ball() -> World:
    thrown = RigidObject(
        name="ball", representation="rigid_spatial", shape=Sphere(radius=0.1), position=(0, 0, 1), velocity=(1, 0, 3)
    )
    return World(objects=(thrown,))


def final_state(world: World) -> bytes:
    moved = rollout(world, 0.2).trajectory
    return moved.positions.tobytes() + b"".join(part.points.tobytes() for part in moved.deformables.values())


def test_simulations_at_the_same_time_equal_those_one_after_another() -> None:
    worlds = [rope(), ball()] * 6
    alone = [final_state(world) for world in worlds]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(final_state, worlds)) == alone


def test_a_launch_waits_for_the_end_of_another_threads_capture() -> None:
    values = buffers.zeros(3, float)
    done = threading.Event()

    def set_to_seven() -> None:
        buffers.fill(values, 7.0)
        done.set()

    thread = threading.Thread(target=set_to_seven)
    with buffers.capture():
        thread.start()
        assert not done.wait(0.1)
    assert done.wait(10.0)
    thread.join()
    np.testing.assert_array_equal(values.numpy(), [7.0, 7.0, 7.0])


def test_a_capture_that_fails_lets_the_others_go_on() -> None:
    lock = CaptureLock()
    with pytest.raises(ValueError, match="broken"), lock.exclusive():
        raise ValueError("broken")
    with ThreadPoolExecutor(1) as pool:
        pool.submit(lambda: lock.shared().__enter__()).result(timeout=5.0)
