"""Lift by spins that nobody measured: throws of a table tennis ball from SciPy, each with a spin of its own."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld.data.recording import Array, Recording, Run
from polyworld.gap import find_gap
from polyworld.gap.catalogue import catalogue, named
from polyworld.world import TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

G = 9.81
MASS = 0.0027  # [kg]
LIFT = 3e-5  # [kg]: lift per spin and speed
SIGMA = 0.002
BALL = RigidObject(name="ball", shape=Sphere(radius=0.02), mass=MASS, position=(0.0, 0.0, 1.0))
WORLD = World(objects=(BALL,), time=TimeBase(seconds_per_frame=0.01, substep=0.002))
OFFERED = ("magnus_lift", "quadratic_drag", "linear_drag", "gravity_error", "tilt")


def throw(seed: int, lift: float = LIFT) -> tuple[Run, Array]:
    """A throw at 100 Hz with noise, and its rate b = s omega / m [1/s]."""
    rng = np.random.default_rng(seed)
    place, speed = rng.uniform([-0.3, -0.3, 0.7], [0.3, 0.3, 1.3]), rng.uniform([4.0, -1.0, 1.0], [8.0, 1.0, 3.0])
    start = np.concatenate([place, speed])
    rate = lift * rng.normal(size=3) * 80.0 / MASS
    times = np.arange(70) / 100.0

    def slopes(_: float, y: Array) -> Array:
        return np.concatenate([y[3:], np.array([0.0, 0.0, -G]) + np.cross(rate, y[3:])])

    path = solve_ivp(slopes, (0.0, times[-1]), start, t_eval=times, rtol=1e-10, atol=1e-12).y[:3].T
    seen = (path + rng.normal(0.0, SIGMA, path.shape))[:, None]
    return Run(f"throw{seed}", ("ball",), times, seen, np.full((70, 1, 4), np.nan)), rate


def test_each_throw_gets_a_rate_of_its_own_and_so_does_the_held_out_one() -> None:
    throws = [throw(seed) for seed in range(4)]
    recording = Recording(tuple(run for run, _ in throws))
    report = find_gap(WORLD, recording, held_out=Recording((throw(9)[0],)), candidates=named(OFFERED))
    assert (report.verdict.kind, report.names) == ("identified", ("magnus_lift",))
    best = report.verdict.best
    for (run, rate), state in zip(throws, best.of_states(), strict=True):
        assert [u.name for u in best.hypothesis.own(run.name)] == [f"rate_{a} in {run.name}" for a in "xyz"]
        assert state[-3:] == pytest.approx(rate, abs=0.1)
    assert report.sealed is not None
    assert report.sealed.gap_after < 0.05 * report.sealed.gap_before


def test_throws_without_lift_miss_nothing() -> None:
    recording = Recording(tuple(throw(seed, lift=0.0)[0] for seed in range(4)))
    assert find_gap(WORLD, recording, candidates=named(OFFERED)).verdict.kind == "nothing_missing"


def test_it_is_not_offered_where_spins_are_known() -> None:
    (variants, recording) = (catalogue()["magnus_lift"].variants, Recording((throw(0)[0],)))
    (unobserved,) = variants(WORLD, recording)
    assert [u.run for u in unobserved.unknowns] == ["throw0"] * 3
    spinning = WORLD.model_copy(update={"objects": (BALL.model_copy(update={"angular_velocity": (0.0, 50.0, 0.0)}),)})
    (known,) = variants(spinning, recording)
    assert [u.name for u in known.unknowns] == ["coefficient"]
