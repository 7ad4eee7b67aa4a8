"""A block that friction and drag slow down, x'' = -mu g - k x', whose turn about the vertical nobody measured."""

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.gap import find_gap
from polyworld.gap.catalogue import named
from polyworld.world import Environment, MotionPlane, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box

MASS, FRICTION, RATE, SIGMA = 1.5, 0.15, 0.3, 0.004  # [kg], 1, [1/s], [m]
BLOCK = RigidObject(
    name="block",
    representation="rigid_planar",
    shape=Box(half_extents=(0.05, 0.05, 0.05)),
    mass=MASS,
    position=(0.0, 0.0, 0.05),
    friction=0.38,
)


def slide(seed: int, speed: float) -> Run:
    """Half a second along x at 240 Hz: v = (v0 + mu g / k) exp(-k t) - mu g / k."""
    t, final = np.arange(130) / 240.0, FRICTION * 9.81 / RATE
    places = np.full((len(t), 1, 3), np.nan)
    path = (speed + final) * (1.0 - np.exp(-RATE * t)) / RATE - final * t
    places[:, 0, 0] = path + np.random.default_rng(seed).normal(0.0, SIGMA, len(t))
    return Run(f"slide{seed}", ("block",), t, places, np.full((len(t), 1, 4), np.nan))


def test_a_turn_that_moves_nothing_does_not_hide_drag_beside_friction() -> None:
    runs = tuple(slide(seed, speed) for seed, speed in enumerate((2.7, 2.8, 1.5, 3.4, 1.9, 3.0)))
    plane = Environment(motion_plane=MotionPlane())
    world = World(objects=(BLOCK,), environment=plane, time=TimeBase(seconds_per_frame=1.0 / 240.0))
    report = find_gap(world, Recording(runs), candidates=named(("friction_error", "linear_drag")))
    assert (report.verdict.kind, set(report.names)) == ("identified", {"friction_error", "linear_drag"})
    friction, drag = (report.verdict.best.values[report.verdict.best.hypothesis.of_part(i)][0] for i in (0, 1))
    assert friction == pytest.approx(FRICTION, abs=0.04)
    assert drag == pytest.approx(RATE * MASS, abs=0.3)
