"""Lift of balls whose spins were measured, but no orientations: throws that SciPy integrated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld.data.recording import Array, Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.cautions import cautions
from polyworld.gap.experiment import Contender, propose_experiment
from polyworld.gap.held_out import held_out_gap
from polyworld.world import World

G, MASS, LIFT = 9.81, 0.0027, 3e-5  # [m/s^2], [kg], [kg]
SIGMA, SPIN_SIGMA = 0.002, 0.5  # [m], [rad/s]
TIMES = np.arange(70) / 100.0


def ball_world(**effect: float) -> World:
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.02}, "mass": MASS, "position": [0, 0, 1]}
    effects = [{"name": "lift", "kind": "magnus_lift", "parameters": effect}] if effect else []
    return World.model_validate({"objects": [ball], "effects": effects, "time": {"substep": 0.002}})


def throw(seed: int, *, measured: bool = True) -> Run:
    """A throw that spins steadily: positions, and if measured its spin, with noise; no orientation."""
    rng = np.random.default_rng(seed)
    spin = 80.0 * rng.normal(size=3)
    start = [*rng.uniform([-0.3, -0.3, 0.7], [0.3, 0.3, 1.3]), *rng.uniform([4.0, -1.0, 1.0], [8.0, 1.0, 3.0])]

    def slopes(_: float, y: Array) -> Array:
        return np.concatenate([y[3:], np.array([0.0, 0.0, -G]) + LIFT / MASS * np.cross(spin, y[3:])])

    path = solve_ivp(slopes, (0.0, TIMES[-1]), start, t_eval=TIMES, rtol=1e-10, atol=1e-12).y[:3].T
    places = (path + rng.normal(0.0, SIGMA, path.shape))[:, None]
    spins = spin + rng.normal(0.0, SPIN_SIGMA, (len(TIMES), 1, 3)) if measured else np.full((len(TIMES), 1, 3), np.nan)
    turns = np.full((len(TIMES), 1, 4), np.nan)
    return Run(f"throw{seed}", ("ball",), TIMES, places, turns, angular_velocities=spins)


def throws(*seeds: int, measured: bool = True) -> Recording:
    return Recording(tuple(throw(seed, measured=measured) for seed in seeds))


def test_runs_start_with_the_spin_that_was_measured_in_them() -> None:
    """The lift explains held-out throws only with each throw's own spin."""
    gap = held_out_gap(ball_world(), ball_world(coefficient=LIFT), throws(5, 6))
    assert gap.gap_before > 10.0 * SIGMA
    assert gap.gap_after < 0.5 * SIGMA
    assert gap.closed is not None
    assert gap.closed > 0.97


def test_a_spin_that_was_not_measured_in_a_held_out_run_is_fitted() -> None:
    gap = held_out_gap(ball_world(), ball_world(coefficient=LIFT), throws(5, 6, measured=False))
    assert gap.gap_before > 10.0 * SIGMA
    assert gap.gap_after < 0.5 * SIGMA


def test_lift_is_identified_from_measured_spins_and_held_out_throws_agree() -> None:
    report = find_gap(
        ball_world(),
        throws(1, 2, 3),
        held_out=throws(4),
        candidates=named(["magnus_lift", "quadratic_drag", "coriolis"]),
        settings=GapSettings(null_control=False),
    )
    summary = report.to_dict()
    assert summary["verdict"] == "identified"
    (effect,) = summary["effects"]
    assert effect["name"] == "magnus_lift"
    assert effect["unknowns"]["coefficient"]["value"] == pytest.approx(LIFT, rel=0.03)
    assert summary["sealed"]["closed"] > 0.95
    assert not any("never measured" in caution for caution in summary["cautions"])


def test_a_spin_that_was_measured_calls_for_no_caution() -> None:
    assert cautions(design(ball_world(), throws(1, 2))) == ()
    assert any("ball" in said for said in cautions(design(ball_world(), throws(1, 2, measured=False))))


def test_a_proposed_throw_spins_as_those_that_were_measured() -> None:
    """In one throw, lift and turning axes look alike; the same throw with its spin reversed separates them."""
    plan = design(ball_world(), throws(1))
    spin = np.median(plan.recording.runs[0].angular_velocities[:, 0], axis=0)
    lift = (Unknown("coefficient", ("effects.law.coefficient",), "kg", 0.0, -1e-3, 1e-3, 1e-5),)
    turning = tuple(
        Unknown(f"rotation_{a}", (f"effects.law.rotation_{a}",), "rad/s", 0.0, -5.0, 5.0, 0.1) for a in "xyz"
    )
    contenders = []
    for kind, unknowns, values in (
        ("magnus_lift", lift, np.array([LIFT])),
        ("coriolis", turning, -0.5 * LIFT / MASS * spin),
    ):
        world = World.model_validate({**ball_world().model_dump(), "effects": [{"name": "law", "kind": kind}]})
        contenders.append(Contender((kind,), world, unknowns, values, 1e-12 * np.eye(len(unknowns))))
    proposed = propose_experiment(plan, measured_noise(plan), contenders)
    assert proposed is not None
    assert proposed.decides
    np.testing.assert_allclose(proposed.angular_velocity, -spin, atol=3 * SPIN_SIGMA)
    still = replace(throw(1), angular_velocities=np.zeros((len(TIMES), 1, 3)))
    plan = design(ball_world(), Recording((still,)))
    proposed = propose_experiment(plan, measured_noise(plan), contenders)
    assert proposed is not None
    assert proposed.angular_velocity == (0.0, 0.0, 0.0)
