"""A ball that spins in air, moved by SciPy: three effects at once, and a force described beside a torque."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.world import World

Array = NDArray[np.float64]
Law = Callable[[Array, Array, Array], Array]  # (x, v, omega)

MASS, RADIUS = 0.045, 0.02
INERTIA = 0.4 * MASS * RADIUS**2
TIMES = np.arange(32) / 40.0
SIGMA, TURN_SIGMA = 0.001, 0.01
DRAG, LIFT, SPIN_DRAG = 0.004, 2e-4, 2e-7  # [kg/m], [kg], [kg m^2]
QUICK = GapSettings(null_control=False, experiment=False)


def flight_world() -> World:
    """A ball in free flight."""
    ball = {
        "name": "ball",
        "shape": {"kind": "sphere", "radius": RADIUS},
        "mass": MASS,
        "position": [0.0, 0.0, 2.0],
    }
    return World.model_validate({"objects": [ball], "time": {"seconds_per_frame": 1 / 40, "substep": 0.004}})


def thrown(force: Law, torque: Law, runs: int = 3, seed: int = 8) -> Recording:
    """Throws with places and turns measured; the turn is about the spin's axis, which no torque here changes."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(runs):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        heading, speed, spin = rng.uniform(0, 2 * np.pi), rng.uniform(2.0, 9.0), rng.uniform(20.0, 90.0)
        start = [0, 0, 2.0, speed * np.cos(heading), speed * np.sin(heading), rng.uniform(0.0, 4.0), spin, 0.0]

        def rate(_t: float, y: Array, along: Array = axis) -> Array:
            omega = y[6] * along
            pull = np.array([0.0, 0.0, -9.81]) + force(y[:3], y[3:6], omega) / MASS
            return np.concatenate([y[3:6], pull, [along @ torque(y[:3], y[3:6], omega) / INERTIA, y[6]]])

        motion = solve_ivp(rate, (0.0, TIMES[-1]), start, t_eval=TIMES, rtol=1e-10, atol=1e-12).y
        half = 0.5 * (motion[7] + rng.normal(0.0, TURN_SIGMA, len(TIMES)))
        turns = np.concatenate([np.cos(half)[:, None], np.sin(half)[:, None] * axis], axis=1)
        places = motion[:3].T + rng.normal(0.0, SIGMA, (len(TIMES), 3))
        found.append(Run(f"r{k}", ("ball",), TIMES, places[:, None], turns[:, None]))
    return Recording(tuple(found))


def in_air(_x: Array, v: Array, omega: Array) -> Array:
    return -DRAG * np.linalg.norm(v) * v + LIFT * np.cross(omega, v)


@pytest.mark.benchmark
def test_drag_lift_and_the_spins_decay_are_found_together() -> None:
    report = find_gap(
        flight_world(),
        thrown(in_air, lambda _x, _v, omega: -SPIN_DRAG * np.linalg.norm(omega) * omega),
        candidates=named(["quadratic_drag", "linear_drag", "magnus_lift", "spin_damping"]),
        settings=replace(QUICK, residual_force=False),
    )
    summary = report.to_dict()
    assert summary["verdict"] == "identified"
    found = {e["name"]: e for e in summary["effects"]}
    assert set(found) == {"quadratic_drag", "magnus_lift", "spin_damping"}
    assert found["spin_damping"]["label"] == "as the square of the spin"
    for name, true in (("quadratic_drag", DRAG), ("magnus_lift", LIFT), ("spin_damping", SPIN_DRAG)):
        number = found[name]["unknowns"]["coefficient"]
        low, high = number["interval95"]
        assert abs(number["value"] - true) < high - low  # four standard errors
        assert high - low < 0.2 * true


@pytest.mark.benchmark
def test_a_force_outside_the_catalogue_is_described_beside_the_torque_that_is_in_it() -> None:
    report = find_gap(
        flight_world(),
        thrown(
            lambda x, _v, _w: MASS * 1.2 * x[2] * np.array([0.8, 0.6, 0.0]),
            lambda _x, _v, omega: -0.6 * INERTIA * omega,
        ),
        candidates=named(["spin_damping", "linear_drag"]),
        settings=QUICK,
    )
    summary = report.to_dict()
    assert summary["verdict"] == "identified_with_remainder"
    assert [effect["name"] for effect in summary["effects"]] == ["spin_damping"]
    assert summary["remainder"]["beyond_noise"] > 10.0 * summary["remainder"]["noise"]
    force = summary["residual_force"]
    assert force["explains"]
    assert force["beside"] == ["spin_damping"]
    assert "x.z" in force["expression"]
    assert "beside spin_damping explains the data" in force["summary"]
    assert summary["world"] is not None
    assert {e["kind"] for e in summary["world"]["effects"]} == {"spin_damping", "expression"}
    (decay,) = [e for e in summary["world"]["effects"] if e["kind"] == "spin_damping"]
    assert decay["parameters"]["coefficient"] == pytest.approx(0.6 * INERTIA, rel=0.05)
