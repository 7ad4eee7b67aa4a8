"""Spins that were measured are data: lift, and the decay of a spin, named from flights made by SciPy."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.forward import Forward
from polyworld.estimation.noise import measured_noise
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.null_control import simulated_recording
from polyworld.world import World

Array = NDArray[np.float64]

MASS, RADIUS = 0.0027, 0.02
INERTIA = 0.4 * MASS * RADIUS**2
DRAG, LIFT = 3.8e-4, 1.2e-5  # [kg/m], [kg]
SIGMA, SPIN_SIGMA = 0.002, 5.0  # [m], [rad/s]
TIMES = np.arange(40) / 66.0
QUICK = GapSettings(null_control=False, experiment=False)


def flight_world() -> World:
    """A table tennis ball in still air that is not there."""
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
    report = find_gap(
        flight_world(),
        flights(4, DRAG, LIFT),
        candidates=named(["quadratic_drag", "linear_drag", "magnus_lift", "wind", "spin_damping"]),
        settings=QUICK,
    )
    assert report.verdict.kind == "identified"
    found = {e["name"]: e["unknowns"]["coefficient"] for e in report.to_dict()["effects"]}
    assert set(found) == {"quadratic_drag", "magnus_lift"}
    for name, true in (("quadratic_drag", DRAG), ("magnus_lift", LIFT)):
        low, high = found[name]["interval95"]
        assert low < true < high
        assert high - low < 0.05 * true
    assert not any("spins" in text for text in report.cautions)


def test_a_spin_that_decays_in_flight_is_found_from_measured_spins_alone() -> None:
    rate = 0.8  # [1/s]
    report = find_gap(
        flight_world(),
        flights(3, 0.0, 0.0, lambda omega: -rate * INERTIA * omega),
        candidates=named(["spin_damping", "linear_drag", "tilt", "gravity_error"]),
        settings=QUICK,
    )
    assert report.verdict.kind == "identified"
    (effect,) = report.to_dict()["effects"]
    assert (effect["name"], effect["label"]) == ("spin_damping", "in proportion to the spin")
    low, high = effect["unknowns"]["coefficient"]["interval95"]
    assert low < rate * INERTIA < high


def test_spins_have_a_noise_level_of_their_own_which_simulated_recordings_repeat() -> None:
    plan = design(flight_world(), flights(8, 0.0, 0.0))
    noise = measured_noise(plan)
    levels = {level.kind: (level.sigma, level.unit) for level in noise.levels}
    assert levels["position"] == (pytest.approx(SIGMA, rel=0.1), "m")
    assert levels["spin"] == (pytest.approx(SPIN_SIGMA, rel=0.1), "rad/s")
    states = [r.start for r in plan.runs]
    again = simulated_recording(Forward(plan, plan.world, ()), np.zeros(0), states, noise, seed=3)
    assert {level.kind for level in measured_noise(design(plan.world, again)).levels} == {"position", "spin"}
    spread = np.concatenate([r.angular_velocities[:, 0] - r.angular_velocities[:, 0].mean(axis=0) for r in again.runs])
    assert spread.std() == pytest.approx(SPIN_SIGMA, rel=0.15)
