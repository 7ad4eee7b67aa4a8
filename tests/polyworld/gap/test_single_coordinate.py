"""Heights of a single drop: what falls, slows down and is seen askew cannot be named from one coordinate of one run."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.gap import find_gap
from polyworld.world import TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere


def heights(coefficient: float, slant: float, sigma: float = 0.03) -> Recording:
    """A ball of 1 kg dropped 40 m with quadratic drag [kg/m], filmed by a camera that looks at the fall askew."""
    times = np.arange(45) / 16.0
    fall = solve_ivp(
        lambda _, y: (y[1], -9.81 - coefficient * abs(y[1]) * y[1]), (0.0, 3.0), (50.0, -2.0), t_eval=times, rtol=1e-9
    )
    about = fall.y[0] - 30.0
    seen = 30.0 + about / (1.0 + slant * about) + np.random.default_rng(7).normal(0.0, sigma, len(times))
    places = np.full((len(times), 1, 3), np.nan)
    places[:, 0, 2] = seen
    return Recording((Run("drop", ("ball",), times, places, np.full((len(times), 1, 4), np.nan)),))


def test_one_drop_that_is_seen_askew_is_not_given_one_name() -> None:
    ball = RigidObject(name="ball", shape=Sphere(radius=0.05), position=(0.0, 0.0, 50.0))
    world = World(objects=(ball,), time=TimeBase(seconds_per_frame=1.0 / 16.0, substep=0.01))
    report = find_gap(world, heights(0.05, 0.007))
    assert report.verdict.kind in ("ambiguous", "unexplained")
    if report.verdict.kind == "ambiguous":
        assert len(report.verdict.competitors) > 0
