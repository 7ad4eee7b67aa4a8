"""Fits of runs in which discs collide, where a slope leads past a collision that was not."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FitContext
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.multistart import best_of_starts
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.refitting import (
    fit_near,
    refit_every_run,
    refit_ill_runs,
    restarted,
)
from polyworld.gap.catalogue import catalogue
from polyworld.gap.contest import Contest
from polyworld.gap.search import Search
from polyworld.gap.segment_context import segment_context
from polyworld.gap.settings import SearchSettings
from polyworld.world import World
from tests.polyworld.estimation.colliding_discs import bent_run, laid_out, plain, scene, world
from tests.scenes.discs import Discs, Started, slide

Array = NDArray[np.float64]


@pytest.mark.parametrize(("run", "start", "off"), [(0, "disc1.velocity.x", 0.2), (1, "disc0.velocity.x", -0.4)])
def test_a_run_that_a_collision_misled_is_fitted_again(run: int, start: str, off: float) -> None:
    _, right = plain(3, 2)
    assert right.misfits.max() < 1.1
    stuck = bent_run(right, run, start, off)
    assert 1.2 < stuck.misfits[run] < 2.0  # no slope leads back, and alone it is no great misfit
    assert refit_ill_runs(stuck).chi2 == pytest.approx(right.chi2, abs=1.0)
    assert restarted(stuck, stuck.hypothesis).chi2 < right.chi2 + 1.0
    assert refit_ill_runs(right) is right


def test_where_one_start_misleads_a_little_multistart_does_not() -> None:
    _, right = plain(4, 2)
    stuck = bent_run(right, 0, "disc3.velocity.y", -0.4)
    assert refit_ill_runs(stuck).chi2 > right.chi2 + 50.0
    assert refit_every_run(stuck).chi2 < right.chi2 + 1.0


def test_states_that_fit_a_like_law_are_a_short_cut_and_no_trap() -> None:
    context, right = plain(3, 2)
    starts = [profile.start_states(context.design)]

    def asked(known: Sequence[Array] | None) -> tuple[float, int]:
        before = context.rollouts
        like = None if known is None else context.fit(right.hypothesis, right.values, known)
        return fit_near(context, right.hypothesis, right.values, starts, like).chi2, context.rollouts - before

    alone, all_the_way = asked(None)
    short, rollouts = asked(right.fit.states)
    assert short == pytest.approx(alone, abs=1.0)
    assert 5 * rollouts < all_the_way
    stuck = bent_run(right, 1, "disc0.velocity.x", -0.4)
    assert asked(stuck.fit.states)[0] < right.chi2 + 1.0 < stuck.chi2 - 20.0


@pytest.mark.benchmark
def test_a_run_whose_chi2_is_not_conspicuous_is_refitted_with_all_others() -> None:
    _, right = plain(4, 5)
    stuck = bent_run(right, 1, "disc3.velocity.y", -0.4)
    assert stuck.chi2 > right.chi2 + 50.0
    assert refit_ill_runs(stuck) is stuck
    assert refit_every_run(stuck).chi2 < right.chi2 + 1.0


def test_a_run_that_diverges_does_not_hold_up_the_others() -> None:
    """One run is 100 m away, where a force grows without bound in the next metre."""
    context, right = plain(2, 2)
    first, *others = context.design.recording.runs
    data = Recording((replace(first, positions=first.positions + np.array([100.0, 0.0, 0.0])), *others))
    runaway = {"name": "runaway", "kind": "expression", "expression": "a*exp(20*(x.x/1[m] - 99))*ex"}
    runaway |= {"parameters": {"a": 1.0}, "parameter_units": {"a": "m/s^2"}}
    described = World.model_validate(context.design.world.model_dump() | {"effects": [runaway]})
    mixed_up = FitContext(design(described, data), context.noise, 1)
    starts = profile.start_states(mixed_up.design)
    mixed = mixed_up.fit(Hypothesis(described, ()), np.zeros(0), starts, horizons=profile.FINE_HORIZONS)
    assert not np.isfinite(mixed.misfits[0])
    assert not mixed.fit.converged
    np.testing.assert_array_equal(mixed.fit.states[0], starts[0])
    np.testing.assert_allclose(mixed.misfits[1:], right.misfits[1:], atol=0.01)


def test_multistart_finds_the_motion_that_one_start_misses() -> None:
    masses, radii = np.array([0.65, 1.39, 1.42, 0.73, 0.4]), np.array([0.093, 0.126, 0.132, 0.123, 0.093])
    discs = Discs(masses, radii, np.full(5, 0.15), 0.8)
    places = np.array([[-0.8709, -0.4385], [0.2771, -0.6711], [0.962, 0.1914], [0.1972, 0.8185], [-0.5546, 0.4909]])
    speeds = [[2.1333, 1.2291], [-0.6879, 2.2282], [-1.3149, -0.3524], [-0.7558, -2.2695], [1.5836, -1.8336]]
    start = Started(places, np.array(speeds), np.array([6.14, -3.65, -0.58, 3.51, 2.52]))
    rng, times = np.random.default_rng(4), np.arange(91) / 60.0
    path = slide(discs, start, times)
    seen = np.zeros((len(times), 5, 3))
    seen[..., :2] = path[..., :2] + rng.normal(0.0, 0.0076, (len(times), 5, 2))
    half = 0.5 * (path[..., 2] + rng.normal(0.0, 0.03, (len(times), 5)))
    turns = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=-1)
    data = Recording((Run("run0", tuple(f"disc{i}" for i in range(5)), times, seen, turns),))
    plan = design(world(discs, start).with_substep(1.001 / 60.0), data)
    context = FitContext(plan, measured_noise(plan), 1)
    states = profile.start_states(plan)
    one = context.fit(Hypothesis(plan.world, ()), np.zeros(0), states, horizons=profile.FINE_HORIZONS)
    assert one.misfits[0] > 2.0
    way = best_of_starts(plan.world, plan, context.noise, 0, 1.1 * context.observations)
    assert way.chi2 < 1.1 * context.observations
    again = best_of_starts(plan.world, plan, context.noise, 0, 1.1 * context.observations)
    np.testing.assert_array_equal(way.state, again.state)


def test_a_contender_on_segments_is_not_held_by_states_bent_to_another_law() -> None:
    discs, _ = scene(3, 3)

    def turning(_t: float, _x: Array, v: Array, _w: Array) -> Array:
        return 2.0 * 0.15 * discs.masses[:, None] * np.column_stack([v[:, 1], -v[:, 0]])

    plan = laid_out(replace(discs, forces=(turning,)), 3, 3)
    context = FitContext(plan, measured_noise(plan), 1)
    base = context.fit(Hypothesis(plan.world, ()), np.zeros(0), profile.start_states(plan), iterations=0)
    cut = segment_context(context, 2)
    assert cut is not None
    contest = Contest(cut.context, cut, SearchSettings(), lambda _step, _figures: None)
    coriolis = catalogue()["coriolis"]
    parent = cut.fit_base(base.hypothesis, base.values)
    predictions = contest.predict([parent], lambda t: list(extended(t.hypothesis, coriolis, plan.recording)))
    best = contest.fit(predictions, 1, parent.chi2)[0]
    assert best.chi2 < 1.1 * cut.context.observations
    assert best.values[0] == pytest.approx(0.15, abs=0.01)


def test_what_a_law_contains_is_tried_whatever_was_predicted() -> None:
    discs, _ = scene(2, 2)
    anchor = np.array([0.3, -0.2])
    plan = laid_out(replace(discs, forces=(lambda _t, x, _v, _w: -0.5 * (x - anchor),)), 2, 2)
    context = FitContext(plan, measured_noise(plan), 2)
    base = context.fit(Hypothesis(plan.world, ()), np.zeros(0), profile.start_states(plan), iterations=0)
    chosen = tuple(catalogue()[name] for name in ("spring", "tether"))
    search = Search.begin(base, chosen, SearchSettings(), lambda _step, _figures: None, plan.world.time.substep)
    (tether,) = extended(base.hypothesis, chosen[1], plan.recording)
    known = {"stiffness": 0.5, "rest_length": 0.01, "anchor_x": 0.3, "anchor_y": -0.2}
    values = np.array([known[u.name] for u in tether.unknowns])
    states = profile.start_states(plan)
    search.whole.take(context.fit(tether, values, states, horizons=profile.FINE_HORIZONS))
    search.improve(1)
    best = search.best(1)
    assert best is not None
    assert best.hypothesis.names == ("spring",)
    assert best.passes


def test_short_segments_are_fitted_in_as_few_parts_as_they_have_samples_for() -> None:
    plan = laid_out(scene(2, 1)[0], 2, 1)
    cut = segment_context(FitContext(plan, measured_noise(plan), 1), 4)
    assert cut is not None
    whole, short = profile.horizons_for(plan), profile.horizons_for(cut.context.design)
    assert whole[-1] == short[-1] == 1.0
    samples = max(len(r.times) for r in cut.context.design.runs)
    assert samples < len(plan.runs[0].times) / 2.0
    assert len(short) > 1
    assert np.diff([0.0, *short]).min() * samples > 3.0  # less than that many samples determine no state
    assert np.diff([0.0, *whole]).min() * samples < 3.0
