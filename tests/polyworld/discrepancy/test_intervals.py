"""Intervals of unknowns where chi2 is no parabola: discs that collide, a ball that grips the floor."""

import numpy as np
import pytest

from polyworld.discrepancy import profile
from polyworld.discrepancy.catalogue import catalogue
from polyworld.discrepancy.design import design
from polyworld.discrepancy.forward import Forward
from polyworld.discrepancy.hypothesis import Hypothesis, extended
from polyworld.discrepancy.intervals import LEVEL, intervals95
from polyworld.discrepancy.noise import measured_noise
from polyworld.discrepancy.stepping import coarsened
from polyworld.discrepancy.trial import Bench
from polyworld.parameters import with_parameters
from polyworld.recording import Recording, Run
from polyworld.world import World
from tests.benchmarks.hidden_ball import Ball, Launch, fly
from tests.benchmarks.hidden_cases import Case
from tests.benchmarks.hidden_disc_cases import draw_discs


@pytest.fixture(scope="module")
def discs() -> tuple[World, Recording, float]:
    """Four discs whose restitution is not as told, seen with small noise; and the true restitution."""
    case = Case("bodies", 0, 0, ("restitution_error",), 0.001, design="discs", runs=3, rate=60.0, bodies=4)
    drawn = draw_discs(case, 7)
    rows = drawn.runs(np.random.default_rng(1), range(case.runs))
    data = Recording(tuple(Run(n, tuple(drawn.names), t, x, q) for n, t, x, q in rows))
    assert drawn.effect is not None
    return World.model_validate(drawn.world_json()), data, drawn.effect.told(drawn.strength)["restitution"]


def test_an_interval_ends_where_the_best_fit_with_that_value_is_worse_by_its_level(
    discs: tuple[World, Recording, float],
) -> None:
    world, data, true = discs
    plan = design(coarsened(world, data), data)
    bench = Bench(plan, measured_noise(plan), 1)
    (hypothesis,) = extended(Hypothesis(plan.world, ()), catalogue()["restitution_error"], data)
    start = np.array([u.start for u in hypothesis.unknowns])
    trial = bench.fit(hypothesis, start, profile.start_states(plan), horizons=profile.FINE_HORIZONS)
    trial = bench.refit(trial)
    ((low, high),) = intervals95(bench, trial)
    assert low < true < high
    for end in (low, high):
        told = with_parameters(hypothesis.world, dict.fromkeys(hypothesis.unknowns[0].paths, float(end)))
        fixed = Forward(plan, told, ())
        worse = profile.fit(fixed, bench.noise, np.zeros(0), trial.fit.states)
        assert worse.chi2 - trial.chi2 == pytest.approx(LEVEL**2, rel=0.15)


@pytest.mark.parametrize("start", [0.0, 0.1])
def test_a_grip_that_was_enough_tells_of_no_greater_one(start: float) -> None:
    """A ball that bounces at 1 m/s sideways leaves the floor rolling if mu > 2 v / (7 (1 + e) u), here 0.04.

    The data hold no upper bound: chi2 is steep below 0.04 and level above.
    """
    restitution, drop, sideways, true = 0.8, 0.5, 1.0, 0.5
    enough = 2.0 * sideways / (7.0 * (1.0 + restitution) * np.sqrt(2.0 * 9.81 * drop))
    times = np.arange(90) / 120.0
    rng = np.random.default_rng(2)
    runs = []
    for k in range(3):
        launch = Launch((0.0, 0.0, 0.1 + drop), (sideways * np.cos(k), sideways * np.sin(k), 0.0))
        path = fly(Ball(friction=true, restitution=lambda _: restitution), launch, times)
        places = path.positions + rng.normal(0.0, 0.001, path.positions.shape)
        runs.append(Run(f"run {k}", ("ball",), times, places[:, None], np.full((len(times), 1, 4), np.nan)))
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "mass": 0.5, "position": [0, 0, 0.6]}
    world = World.model_validate(
        {
            "objects": [ball | {"friction": 0.02, "restitution": restitution}],
            "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
        }
    )
    data = Recording(tuple(runs))
    plan = design(coarsened(world, data), data)
    bench = Bench(plan, measured_noise(plan), 1)
    (hypothesis,) = extended(Hypothesis(plan.world, ()), catalogue()["friction_error"], data)
    trial = bench.fit(hypothesis, np.array([start]), profile.start_states(plan))
    ((low, high),) = intervals95(bench, bench.refit(trial))
    assert high == hypothesis.unknowns[0].upper
    assert 0.25 * enough < low < enough * 1.02
