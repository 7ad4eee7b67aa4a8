"""Intervals of unknowns where the initial states follow on a curve: discs that collide."""

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
