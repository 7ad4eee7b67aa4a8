"""The proposed experiment: where two laws differ by theory, the proposal goes there."""

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.design import design
from polyworld.estimation.forward import Forward
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.unknown import Unknown
from polyworld.gap.experiment import Contender, propose_experiment
from polyworld.gap.settings import ExperimentSettings
from polyworld.world import World
from tests.polyworld.estimation.thrown_ball import ball_world, thrown

SIGMA = 0.01
ENOUGH = ExperimentSettings().enough


def one_launch(seed):
    times, places = thrown(np.random.default_rng(seed), 0.03, SIGMA)
    return Recording((Run("r", ("ball",), times, places[:, None], np.full((len(times), 1, 4), np.nan)),))


def contender(plan, noise, kind, coefficient):
    world = ball_world(effects=[{"name": "drag", "kind": kind}])
    unknown = Unknown("drag", ("effects.drag.coefficient",), "kg/m", 0.0, 0.0, 1.0, 0.05)
    found = profile.fit(
        Forward(plan, world, (unknown,)),
        noise,
        np.array([coefficient]),
        profile.start_states(plan),
        horizons=profile.HORIZONS,
    )
    return Contender((f"{kind}",), world, (unknown,), found.values, found.covariance), found


def test_linear_and_quadratic_drag_are_distinguished_by_a_faster_launch():
    plan = design(ball_world(), one_launch(0))
    noise = measured_noise(plan)
    quadratic, one = contender(plan, noise, "quadratic_drag", 0.03)
    linear, other = contender(plan, noise, "linear_drag", 0.1)
    assert abs(one.chi2 - other.chi2) < 60  # this design distinguishes them poorly
    proposed = propose_experiment(plan, noise, (quadratic, linear))
    assert proposed is not None
    measured = np.linalg.norm(plan.runs[0].start[[1, 3, 5]])
    assert np.linalg.norm(proposed.velocity) > 2.0 * measured
    assert proposed.decides
    assert proposed.separations[0].sigmas > ENOUGH
    assert set(proposed.forecasts) == {"quadratic_drag", "linear_drag"}
    assert abs(proposed.forecasts["quadratic_drag"] - proposed.forecasts["linear_drag"]) > ENOUGH * SIGMA


def test_what_is_to_be_watched_is_where_the_predictions_differ():
    """Drag and viscous friction slow a block on a ramp alike and part when it is thrown.

    Not at the first instant, where each of them would have it start a little otherwise.
    """
    slope, high, rate = np.radians(20.0), 0.05, 0.4
    pull = 9.81 * (np.sin(slope) - 0.25 * np.cos(slope))
    times = np.arange(48) / 60.0
    rng = np.random.default_rng(2)
    runs = []
    for k, speed in enumerate((0.05, 0.35, 0.65)):
        way = pull / rate * times + (speed - pull / rate) * (1 - np.exp(-rate * times)) / rate
        down = np.outer(way, [np.cos(slope), 0.0, -np.sin(slope)]) + high * np.array([np.sin(slope), 0, np.cos(slope)])
        places = down + rng.normal(0.0, 0.0015, down.shape)
        runs.append(Run(f"r{k}", ("block",), times, places[:, None], np.full((len(times), 1, 4), np.nan)))
    turn = [np.cos(slope / 2), 0, np.sin(slope / 2), 0]
    block = {"name": "block", "shape": {"kind": "box", "half_extents": [high] * 3}, "mass": 0.5, "friction": 0.25}
    block |= {"position": [high * np.sin(slope), 0, high * np.cos(slope)], "orientation": turn, "restitution": 0.0}
    ramp = {"name": "ramp", "shape": {"kind": "plane"}, "orientation": turn}
    parts = {"objects": [block], "statics": [ramp]}
    plan = design(World.model_validate(parts), Recording(tuple(runs)))
    noise = measured_noise(plan)
    both = []
    for kind, start, unit in (("linear_drag", 0.2, "kg/s"), ("viscous_friction", 0.2, "kg/s")):
        world = World.model_validate(parts | {"effects": [{"name": "law", "kind": kind}]})
        unknown = Unknown("law", ("effects.law.coefficient",), unit, 0.0, 0.0, 1.0, 0.05)
        found = profile.fit(Forward(plan, world, (unknown,)), noise, np.array([start]), profile.start_states(plan))
        both.append(Contender((kind,), world, (unknown,), found.values, found.covariance))
    proposed = propose_experiment(plan, noise, tuple(both))
    assert proposed is not None
    assert proposed.decides
    assert abs(proposed.forecasts["linear_drag"] - proposed.forecasts["viscous_friction"]) > ENOUGH * 0.0015


def test_two_names_for_the_same_motion_are_not_claimed_to_be_separable():
    plan = design(ball_world(), one_launch(1))
    noise = measured_noise(plan)
    first, _ = contender(plan, noise, "quadratic_drag", 0.03)
    second = Contender(("equivalent",), first.world, first.unknowns, first.values, first.covariance)
    proposed = propose_experiment(plan, noise, (first, second))
    assert proposed is not None
    assert not proposed.decides
    assert proposed.separations[0].sigmas == pytest.approx(0.0, abs=1e-6)


def test_one_contender_needs_no_experiment():
    plan = design(ball_world(), one_launch(2))
    noise = measured_noise(plan)
    first, _ = contender(plan, noise, "quadratic_drag", 0.03)
    assert propose_experiment(plan, noise, (first,)) is None
