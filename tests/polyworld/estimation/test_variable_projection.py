"""Steps of shared values that every run's states follow, where one sensitive run holds up a fit of all together."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.descent import Estimate
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.normal_equations import Linearised
from polyworld.estimation.refitting import fit_near
from polyworld.estimation.variable_projection import asked_for, profiled
from polyworld.gap.catalogue import catalogue
from polyworld.gap.stepping import coarsened
from tests.polyworld.estimation.colliding_discs import scene, started, world
from tests.scenes.discs import slide

Array = NDArray[np.float64]


TRUE = 0.1  # kg/m


@cache
def colliding(count: int, seed: int) -> tuple[FitContext, Hypothesis]:
    """Discs with air drag that the world lacks, in four runs of 3 s at 30 Hz: 4 mm and 0.02 rad of noise; and the
    law."""
    discs, _ = scene(count, seed)
    rng = np.random.default_rng([seed, count, 7])

    def drag(_t: float, _x: Array, v: Array, _w: Array) -> Array:
        return -TRUE * np.linalg.norm(v, axis=1, keepdims=True) * v

    times = np.arange(91) / 30.0
    starts = [started(rng, count) for _ in range(4)]
    runs = []
    for k, start in enumerate(starts):
        path = slide(replace(discs, forces=(drag,)), start, times)
        places = np.zeros((len(times), count, 3))
        places[..., :2] = path[..., :2] + rng.normal(0.0, 0.004, (len(times), count, 2))
        half = 0.5 * (path[..., 2] + rng.normal(0.0, 0.02, (len(times), count)))
        turns = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=-1)
        runs.append(Run(f"run{k}", tuple(f"disc{i}" for i in range(count)), times, places, turns))
    data = Recording(tuple(runs))
    plan = design(coarsened(world(discs, starts[0]), data), data)
    context = FitContext(plan, measured_noise(plan), 1)
    return context, extended(Hypothesis(plan.world, ()), catalogue()["quadratic_drag"], data)[0]


def states_at(
    context: FitContext, hypothesis: Hypothesis, values: Array, states: tuple[Array, ...]
) -> tuple[Array, ...]:
    at = Estimate(values, states)
    return profile.fit_per_run(context.forward(hypothesis), context.noise, at, horizons=(1.0,), iterations=12)[0].states


@cache
def fitted(count: int, seed: int) -> FittedHypothesis:
    """From the true value, with states that follow collision by collision."""
    context, law = colliding(count, seed)
    at = Estimate(np.array([TRUE]), profile.start_states(context.design))
    horizons = profile.FINE_HORIZONS
    at, _ = profile.fit_per_run(context.forward(law), context.noise, at, horizons=horizons, iterations=6)
    return context.fit(law, np.array([TRUE]), at.states, iterations=40)


def test_a_sensitive_run_does_not_hold_up_the_others() -> None:
    context, law = colliding(3, 3)
    right = fitted(3, 3)
    assert right.passes
    assert right.values[0] == pytest.approx(TRUE, rel=0.01)
    away = np.array([0.4 * TRUE])
    held_up = context.fit(law, away, states_at(context, law, away, right.fit.states), iterations=40)
    assert held_up.chi2 > 10.0 * right.chi2
    found = profiled(held_up)
    assert found.chi2 < right.chi2 + 1.0
    assert found.values[0] == pytest.approx(right.values[0], rel=0.002)


def test_what_is_at_rest_stays() -> None:
    right = fitted(3, 3)
    assert profiled(right) is right


def test_a_fit_begins_from_a_value_half_of_the_true_one() -> None:
    context, law = colliding(5, 3)
    far = np.array([0.5 * TRUE])
    starts = profile.start_states(context.design)
    together = context.fit(law, far, starts, horizons=profile.FINE_HORIZONS, iterations=6)
    assert together.chi2 > 9000.0  # a run is behind another collision, and holds the others
    found = fit_near(context, law, far, [starts])
    assert found.passes
    assert found.values[0] == pytest.approx(TRUE, rel=0.04)


def test_runs_fitted_independently_keep_what_they_share() -> None:
    context, law = colliding(3, 3)
    values = np.array([1.2 * TRUE])
    begin = Estimate(values, profile.start_states(context.design))
    horizons = profile.FINE_HORIZONS
    at, costs = profile.fit_per_run(context.forward(law), context.noise, begin, horizons=horizons, iterations=6)
    np.testing.assert_array_equal(at.values, values)
    alone = replace(law, world=law.fitted_world(values), parts=())
    same = context.fit(alone, np.zeros(0), at.states, iterations=0)
    np.testing.assert_allclose([float(r @ r) for r in same.fit.linear.r], costs, rtol=1e-9)


def test_a_world_of_one_run_has_the_values_of_that_run() -> None:
    context, law = colliding(3, 3)
    part, (unknown,) = law.parts[0], law.parts[0].variant.unknowns
    each = tuple(replace(unknown, run=r.name) for r in context.design.recording.runs)
    own = replace(law, parts=(replace(part, variant=replace(part.variant, unknowns=each)),))
    values = np.array([0.1, 0.2, 0.3, 0.4])
    for run, value in zip(context.design.recording.runs, values, strict=True):
        (effect,) = own.fitted_world(values, run).effects
        assert effect.parameters["coefficient"] == value


def test_a_step_that_a_bound_stops_leaves_the_others_what_is_best_then() -> None:
    """Two unknowns go together; the step that both ask for leaves the bound of one."""
    context, law = colliding(3, 3)
    trial = fitted(3, 3)
    (unknown,) = law.parts[0].variant.unknowns
    two = (replace(unknown, upper=float(trial.values[0])), replace(unknown, name="other", upper=1e9))
    part = replace(law.parts[0], variant=replace(law.parts[0].variant, unknowns=two))
    slope = np.random.default_rng(0).normal(size=50)
    beside = 0.9 * slope + 0.4 * np.random.default_rng(1).normal(size=50)
    a = np.column_stack([slope, beside])
    r = a @ np.array([-0.5, 0.3])  # the best step is (0.5, -0.3)
    linear = Linearised((r,), (a,), (np.zeros((50, 0)),))
    covariance = np.linalg.inv(a.T @ a)
    values = np.array([trial.values[0], 0.5])
    made = replace(trial.fit, values=values, linear=linear, covariance=covariance, states=(np.zeros(0),))
    (asked,) = asked_for(FittedHypothesis(replace(law, parts=(part,)), made, context))
    assert asked[0] == values[0]
    alone = -(beside @ r) / (beside @ beside)
    assert asked[1] == pytest.approx(values[1] + alone, rel=1e-3)
