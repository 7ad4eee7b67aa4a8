"""Spins that were measured are data: lift and the decay of a spin, named from flights that SciPy integrated."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.fitting import fit
from polyworld.gap.ground import ground_of
from polyworld.gap.hypothesis import Hypothesis, extended
from polyworld.gap.report import effects_of
from polyworld.gap.verdict import intervals
from polyworld.world import World

Array = NDArray[np.float64]

MASS, RADIUS = 0.0027, 0.02
INERTIA = 0.4 * MASS * RADIUS**2
DRAG, LIFT, DECAY = 3.8e-4, 1.2e-5, 0.8  # [kg/m], [kg], [1/s]
SIGMA, SPIN_SIGMA = 0.002, 5.0  # [m], [rad/s]
TIMES = np.arange(40) / 66.0


def flight_world() -> World:
    """A table tennis ball without air."""
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": RADIUS}, "mass": MASS, "position": [0.0, 0.0, 1.5]}
    return World.model_validate({"objects": [ball], "time": {"seconds_per_frame": 1 / 66, "substep": 0.004}})


def flights(
    count: int, drag: float, lift: float, decay: Callable[[Array], Array] = lambda omega: 0.0 * omega
) -> Recording:
    """Throws with noisy places and spins and without orientations. decay: torque [N m] by the spin (3,)."""
    rng = np.random.default_rng(4)
    runs = []
    for k in range(count):
        heading, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(4.0, 9.0)
        spin = rng.normal(size=3)
        spin *= rng.uniform(100.0, 300.0) / np.linalg.norm(spin)
        velocity = [speed * np.cos(heading), speed * np.sin(heading), rng.uniform(1.0, 3.0)]

        def rate(_t: float, y: Array) -> Array:
            v, omega = y[3:6], y[6:]
            pull = np.array([0.0, 0.0, -9.81]) + (lift * np.cross(omega, v) - drag * np.linalg.norm(v) * v) / MASS
            return np.concatenate([v, pull, decay(omega) / INERTIA])

        start = np.concatenate([[0.0, 0.0, 1.5], velocity, spin])
        moved = solve_ivp(rate, (0.0, TIMES[-1]), start, t_eval=TIMES, rtol=1e-10, atol=1e-12).y.T
        places = moved[:, :3] + rng.normal(0.0, SIGMA, (len(TIMES), 3))
        spins = moved[:, 6:] + rng.normal(0.0, SPIN_SIGMA, (len(TIMES), 3))
        unobserved = np.full((len(TIMES), 1, 4), np.nan)
        runs.append(Run(f"r{k}", ("ball",), TIMES, places[:, None], unobserved, angular_velocities=spins[:, None]))
    return Recording(tuple(runs))


def test_drag_and_lift_of_flights_with_measured_spins_are_named_together() -> None:
    recording = flights(7, DRAG, LIFT)
    names = tuple(r.name for r in recording.runs)
    offered = named(["quadratic_drag", "linear_drag", "magnus_lift", "wind", "spin_damping"])
    report = find_gap(
        flight_world(), recording.select(names[:5]), held_out=recording.select(names[5:]), candidates=offered
    )
    assert report.verdict.kind == "identified"
    found = {e["name"]: e["unknowns"]["coefficient"]["interval95"] for e in effects_of(report.verdict.best)}
    assert set(found) == {"quadratic_drag", "magnus_lift"}
    for name, true in (("quadratic_drag", DRAG), ("magnus_lift", LIFT)):
        low, high = found[name]
        assert low < true < high < 1.1 * low
    assert report.sealed is not None
    assert report.sealed.gap_after < SIGMA < 0.1 * report.sealed.gap_before


def test_a_spin_that_decays_in_flight_is_found_from_measured_spins_alone() -> None:
    recording = flights(4, 0.0, 0.0, lambda omega: -DECAY * INERTIA * omega)
    offered = named(["spin_damping", "linear_drag", "tilt", "gravity_error"])
    report = find_gap(flight_world(), recording, candidates=offered)
    assert report.verdict.kind == "identified"
    (effect,) = effects_of(report.verdict.best)
    assert (effect["name"], effect["label"]) == ("spin_damping", "in proportion to the spin")
    low, high = effect["unknowns"]["coefficient"]["interval95"]
    assert low < DECAY * INERTIA < high


def test_spins_measured_once_do_not_take_up_what_places_are_off() -> None:
    """Each flight is bent by centimetres, its own way, as poorly calibrated cameras bend it: no lift makes up for it.

    Spins that the fit may move by many standard deviations of their measurement do, and give a lift several times off.
    """
    rng = np.random.default_rng(3)
    runs = []
    for run in flights(8, DRAG, LIFT).runs:
        spins = np.full_like(run.angular_velocities, np.nan)
        spins[0] = run.angular_velocities[0]
        bend = 0.04 * np.sin(2.0 * np.pi * run.times[:, None] / run.times[-1] + rng.uniform(0.0, 6.28, 3))
        positions = run.positions + bend[:, None] * rng.normal(size=3)
        runs.append(replace(run, positions=positions, angular_velocities=spins))
    recording = Recording(tuple(runs))
    ground = ground_of(flight_world(), recording, GapSettings())
    hypothesis = Hypothesis(ground.world)
    for candidate in named(["quadratic_drag", "magnus_lift"]):
        hypothesis = next(extended(hypothesis, candidate, recording))
    fitted = fit(ground, hypothesis, growing=True, scale=1.0)
    assert fitted.scale > 3.0  # the noise is read off the places, and is not what they are off
    (low, high) = intervals(fitted)[1]
    assert low < LIFT < high
    assert fitted.values == pytest.approx([DRAG, LIFT], rel=0.3)
