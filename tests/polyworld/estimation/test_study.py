"""Studies of recordings: angles of a pendulum against its equation of motion, and spins that were measured."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld.data.hinge_angles import HingedBody
from polyworld.data.initial_states import with_initial_states
from polyworld.data.recording import Recording, Run
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.study import Study
from polyworld.world import World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

ARM, MASS, DAMPING, NOISE = 0.5, 0.3, 0.01, 0.002  # [m], [kg], [N m s], [rad]
TIMES = np.arange(0.0, 3.0, 0.02)


def test_damping_of_a_pendulum_is_fitted_to_its_angles() -> None:
    """A small bob, whose own inertia is a thousandth: I th'' = -m g L sin th - c th', three swings."""
    bob = RigidObject(name="bob", shape=Sphere(radius=0.02), mass=MASS, position=(0.0, 0.0, -ARM))
    world = World(objects=(bob,), joints=(Hinge(name="pivot", object="bob", anchor=(0, 0, 0), axis=(0, 1, 0)),))
    inertia, rng, runs = MASS * (ARM**2 + 0.4 * 0.02**2), np.random.default_rng(2), []

    def rates(_: float, y: tuple[float, float]) -> list[float]:
        return [y[1], (-MASS * 9.81 * ARM * np.sin(y[0]) - DAMPING * y[1]) / inertia]

    for name, start in (("low", 0.4), ("middle", 0.8), ("high", 1.2)):
        angles = solve_ivp(rates, (0.0, 3.0), [start, 0.0], t_eval=TIMES, rtol=1e-9, atol=1e-9).y[0]
        places, turns = HingedBody.of(world, "bob").measured(angles + rng.normal(0.0, NOISE, len(TIMES)))
        runs.append(Run(name, ("bob",), TIMES, places[:, None], turns[:, None], arms=(ARM,)))
    study = Study.of(world, Recording(tuple(runs)))
    found = fit(study, FitOptions(only=("joints.pivot.damping",), share=0.0)).constants[0]
    assert found.value == pytest.approx(DAMPING, rel=0.03)
    assert found.interval[0] < 1.01 * DAMPING
    assert found.interval[1] > 0.99 * DAMPING


def test_a_ball_starts_with_the_spin_that_was_measured() -> None:
    spin = np.array([3.0, -40.0, 15.0])
    places = np.stack([2.0 * TIMES, 0.0 * TIMES, 3.0 * TIMES - 4.905 * TIMES**2], axis=-1)[:, None]
    spins = spin + np.random.default_rng(1).normal(0.0, 0.2, (len(TIMES), 1, 3))
    run = Run("r", ("ball",), TIMES, places, np.full((len(TIMES), 1, 4), np.nan), angular_velocities=spins)
    ball = RigidObject(name="ball", shape=Sphere(radius=0.05), position=(0.0, 0.0, 0.0))
    (one,) = Study.of(World(objects=(ball,)), Recording((run,))).runs
    placed = with_initial_states(one.world, one.tracks).object("ball").angular_velocity
    np.testing.assert_allclose(placed, spin, atol=0.5)
