"""Rollouts end when they are asked to, also while a kernel runs, and run again as if nothing had been."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from polyworld.core.interruption import Interrupted, Interruption
from polyworld.solver.rollout import simulator
from polyworld.solver.spatial.simulator import SpatialSimulator
from polyworld.world import Environment, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Cylinder, Sphere

TIME = TimeBase(seconds_per_frame=0.02, frame_count=11, substep=0.002)
FREE = Environment(gravity=(0.0, 0.0, 0.0))
DISC, BALL = Cylinder(radius=0.1, half_height=0.05), Sphere(radius=0.1)
MOTION = {"position": (0.0, 0.0, 0.0), "velocity": (1.0, 0.0, 0.0), "mass": 1.0, "friction": 0.0}
PLANAR = RigidObject(name="disc", representation="rigid_planar", shape=DISC, **MOTION)
SPATIAL = RigidObject(name="ball", representation="rigid_spatial", shape=BALL, **MOTION)


class AtTheStart(Interruption):
    """Asks for the end when a kernel is about to start."""

    @contextmanager
    def stopping(self, stop: Callable[[], None]) -> Iterator[None]:
        with super().stopping(stop):
            self.request()
            yield


@pytest.mark.parametrize("body", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_an_interrupted_rollout_leaves_a_simulator_that_runs_as_a_new_one(body: RigidObject) -> None:
    world = World(objects=(body,), time=TIME, environment=FREE)
    times = np.linspace(0.0, 0.2, 11)
    used, new = (simulator(world, times, n_worlds=3) for _ in range(2))
    with AtTheStart().active(), pytest.raises(Interrupted):
        used.run()
    assert np.array_equal(used.run().positions, new.run().positions)
    assert used.run().positions[0, -1, 0, 0] == pytest.approx(0.2, abs=0.01)


def test_a_kernel_that_runs_is_ended() -> None:
    samples = 1_000_001  # a substep each: a full run takes seconds
    world = World(objects=(SPATIAL,), time=TIME, environment=FREE)
    long = simulator(world, np.arange(samples) * TIME.substep, threads=1)
    assert isinstance(long, SpatialSimulator)
    x = long._motion["position"].values[0, :, 0, 0]
    x[:] = np.nan
    interruption, ended = Interruption(), threading.Event()

    def run() -> None:
        with interruption.active(), pytest.raises(Interrupted):
            long.run()
        ended.set()

    thread = threading.Thread(target=run)
    thread.start()
    deadline = time.monotonic() + 30
    while x[0] != 0.0 and time.monotonic() < deadline:
        time.sleep(0.001)
    interruption.request()
    thread.join(60)
    assert ended.is_set()
    assert 0.0 <= x[-1] < 0.9 * (samples - 1) * TIME.substep  # it stands where it was when the end was asked for


@pytest.mark.parametrize("worlds", [1, 2])
def test_a_rollout_of_a_rope_is_interrupted_in_every_thread(worlds: int) -> None:
    rope = Rope(name="rope", points=((0.0, 0.0, 1.0), (0.5, 0.0, 1.0)), radius=0.01, segments=4)
    hanging = simulator(World(deformables=(rope,), time=TIME), np.array([0.0, 0.02]), n_worlds=worlds, threads=worlds)
    hanging.run()
    interruption = Interruption()
    interruption.request()
    with interruption.active(), pytest.raises(Interrupted):
        hanging.run()
