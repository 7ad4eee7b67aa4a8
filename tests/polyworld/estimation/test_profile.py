"""Fits on several runs at once, held against motion that SciPy integrated."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.design import design
from polyworld.estimation.forward import Forward
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from tests.polyworld.estimation.thrown_ball import DRAG, MASS, RADIUS, G, ball_world, thrown


def recording(seed, drag, sigma, runs=4):
    rng = np.random.default_rng(seed)
    found = []
    for i in range(runs):
        times, places = thrown(rng, drag, sigma)
        found.append(Run(f"r{i}", ("ball",), times, places[:, None], np.full((len(times), 1, 4), np.nan)))
    return Recording(tuple(found))


DRAGGED = {"effects": [{"name": "drag", "kind": "quadratic_drag"}]}
STRENGTH = Unknown("drag", ("effects.drag.coefficient",), "kg/m", 0.0, 0.0, 1.0, 0.02)


def test_a_complete_model_fits_to_the_noise_and_recovers_the_drag():
    errors = []
    for seed in range(6):
        plan = design(ball_world(), recording(seed, DRAG, 0.002))
        noise = measured_noise(plan)
        forward = Forward(plan, ball_world(**DRAGGED), (STRENGTH,))
        found = profile.fit(forward, noise, np.zeros(1), profile.start_states(plan), horizons=profile.HORIZONS)
        freedom = plan.length - sum(r.count for r in plan.runs) - 1
        assert found.converged
        # The noise level is estimated from some 100 third differences a series: known to some 5%.
        assert found.chi2 == pytest.approx(freedom, rel=0.15)
        errors.append((found.values[0] - DRAG) / np.sqrt(found.covariance[0, 0]))
    assert np.max(np.abs(errors)) < 4.0
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.8)


def test_a_model_without_drag_does_not_fit_motion_with_drag():
    plan = design(ball_world(), recording(0, DRAG, 0.002))
    noise = measured_noise(plan)
    found = profile.fit(
        Forward(plan, ball_world(), ()), noise, np.zeros(0), profile.start_states(plan), horizons=profile.HORIZONS
    )
    assert found.chi2 > 10 * plan.length


def test_runs_that_show_different_objects_share_one_law():
    rng = np.random.default_rng(3)
    other = {
        "name": "second",
        "shape": {"kind": "sphere", "radius": RADIUS},
        "position": [5, 0, 1],
        "mass": MASS,
        "restitution": 0.8,
        "friction": 0.0,
    }
    both = ball_world().model_dump(mode="json")["objects"] + [other]
    runs = []
    for i, name in enumerate(("ball", "second", "ball")):
        times, places = thrown(rng, DRAG, 0.002, count=60 + 10 * i)
        places[:, 1] = np.nan  # one component was not measured in these runs
        runs.append(Run(f"r{i}", (name,), times, places[:, None], np.full((len(times), 1, 4), np.nan)))
    world = ball_world(objects=both)
    plan = design(world, Recording(tuple(runs)))
    assert [r.absent for r in plan.runs] == [("second",), ("ball",), ("second",)]
    assert all("velocity.y" not in label for r in plan.runs for label in r.labels)


def test_a_pendulum_is_fitted_by_angle_and_rate_and_its_damping_recovered():
    length, mass, damping = 0.5, 0.3, 0.004
    moment = mass * length**2 + 0.4 * mass * 0.02**2
    times = np.arange(300) / 60.0
    motion = solve_ivp(
        lambda _, y: [y[1], (-mass * G * length * np.sin(y[0]) - damping * y[1]) / moment],
        (0, times[-1] + 0.01),
        [0.8, 0.3],
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
    )
    angle = motion.y[0]
    rng = np.random.default_rng(0)
    places = np.stack([length * np.sin(angle), 0 * angle, 1 - length * np.cos(angle)], axis=1)
    places += rng.normal(0, 0.001, places.shape)
    world = World.model_validate(
        {
            "objects": [
                {"name": "bob", "shape": {"kind": "sphere", "radius": 0.02}, "position": [0, 0, 0.5], "mass": mass}
            ],
            "joints": [{"kind": "hinge", "name": "pin", "object": "bob", "anchor": [0, 0, 1], "axis": [0, -1, 0]}],
        }
    )
    run = Run("swing", ("bob",), times, places[:, None], np.full((len(times), 1, 4), np.nan))
    plan = design(world, Recording((run,)))
    assert plan.runs[0].labels == ("bob.angle", "bob.rate")
    assert plan.runs[0].start == pytest.approx([0.8, 0.3], abs=0.3)
    unknown = Unknown("damping", ("joints.pin.damping",), "N m s", 0.0, 0.0, 1.0, 0.01)
    noise = measured_noise(plan)
    found = profile.fit(
        Forward(plan, world, (unknown,)), noise, np.zeros(1), profile.start_states(plan), horizons=profile.HORIZONS
    )
    assert found.values[0] == pytest.approx(damping, rel=0.05)
    assert found.states[0] == pytest.approx([0.8, 0.3], abs=0.005)
    assert found.chi2 == pytest.approx(plan.length, rel=0.2)
