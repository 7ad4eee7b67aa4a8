"""Fits of runs in which discs collide, where a slope leads past a collision that was not."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.design import Design, design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.multistart import best_of_starts
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.refitting import (
    fit_near,
    refit_every_run,
    refit_ill_runs,
    restarted,
)
from polyworld.estimation.trial import FitContext, FittedHypothesis
from polyworld.gap.catalogue import catalogue
from polyworld.gap.contest import Contest
from polyworld.gap.search import Search
from polyworld.gap.segment_context import segment_context
from polyworld.gap.settings import SearchSettings
from polyworld.gap.stepping import coarsened
from polyworld.recording import Recording, Run
from polyworld.world import World
from tests.benchmarks.hidden_cases import Case
from tests.benchmarks.hidden_disc_cases import draw_discs
from tests.benchmarks.hidden_discs import Discs
from tests.polyworld.estimation.test_several_bodies import recordings, scene, world

Array = NDArray[np.float64]


def laid_out(hidden: Discs, count: int, seed: int) -> Design:
    discs, starts = scene(count, seed)
    told = world(discs, starts[0])
    data, _ = recordings(hidden, [*starts, starts[0]], seed)
    return design(coarsened(told, data), data)


@cache
def plain(count: int, seed: int) -> tuple[FitContext, FittedHypothesis]:
    """Discs without anything hidden, fitted with all care."""
    plan = laid_out(scene(count, seed)[0], count, seed)
    bench = FitContext(plan, measured_noise(plan), 1)
    begun = profile.start_states(plan)
    base = Hypothesis(plan.world, ())
    fitted = bench.fit(base, np.zeros(0), begun, horizons=profile.FINE_HORIZONS)
    return bench, refit_ill_runs(refit_every_run(fitted))


@pytest.mark.parametrize(("run", "start", "off"), [(0, "disc1.velocity.x", 0.2), (1, "disc0.velocity.x", -0.4)])
def test_a_run_that_a_collision_led_astray_is_fitted_anew(run: int, start: str, off: float) -> None:
    _, right = plain(3, 2)
    assert right.misfits.max() < 1.1
    lost = bent_run(right, run, start, off)
    assert 1.2 < lost.misfits[run] < 2.0  # no slope leads back, and alone it is no great misfit
    assert refit_ill_runs(lost).chi2 == pytest.approx(right.chi2, abs=1.0)
    assert restarted(lost, lost.hypothesis).chi2 < right.chi2 + 1.0
    assert refit_ill_runs(right) is right


def bent_run(right: FittedHypothesis, run: int, start: str, off: float) -> FittedHypothesis:
    """A fit begun with one initial state of one run off."""
    states = list(right.fit.states)
    labels = right.bench.design.runs[run].labels
    states[run] = right.fit.states[run] + off * np.array([label == start for label in labels])
    return right.bench.fit(right.hypothesis, right.values, states)


def test_where_one_way_leads_a_little_astray_several_do_not() -> None:
    _, right = plain(4, 2)
    lost = bent_run(right, 0, "disc3.velocity.y", -0.4)
    assert refit_ill_runs(lost).chi2 > right.chi2 + 50.0
    assert refit_every_run(lost).chi2 < right.chi2 + 1.0


def test_states_that_fit_a_like_law_are_a_short_cut_and_no_trap() -> None:
    bench, right = plain(3, 2)
    starts = [profile.start_states(bench.design)]

    def asked(known: Sequence[Array] | None) -> tuple[float, int]:
        before = bench.rollouts
        like = None if known is None else bench.fit(right.hypothesis, right.values, known)
        return fit_near(bench, right.hypothesis, right.values, starts, like).chi2, bench.rollouts - before

    alone, all_the_way = asked(None)
    short, rollouts = asked(right.fit.states)
    assert short == pytest.approx(alone, abs=1.0)
    assert 5 * rollouts < all_the_way
    lost = bent_run(right, 1, "disc0.velocity.x", -0.4)
    assert asked(lost.fit.states)[0] < right.chi2 + 1.0 < lost.chi2 - 20.0


def test_a_run_whose_chi2_is_not_conspicuous_is_refitted_with_all_others() -> None:
    _, right = plain(4, 5)
    lost = bent_run(right, 1, "disc3.velocity.y", -0.4)
    assert lost.chi2 > right.chi2 + 50.0
    assert refit_ill_runs(lost) is lost
    assert refit_every_run(lost).chi2 < right.chi2 + 1.0


def test_a_run_that_diverges_does_not_hold_up_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, right = plain(2, 2)
    given = Forward.residuals

    def diverging(self: Forward, settings: Sequence[Settings], horizon: float = 1.0) -> list[Array]:
        found = given(self, settings, horizon)
        return [np.full_like(raw, np.nan) if item.run == 0 else raw for item, raw in zip(settings, found, strict=True)]

    monkeypatch.setattr(Forward, "residuals", diverging)
    begun = profile.start_states(bench.design)
    mixed = bench.fit(right.hypothesis, right.values, begun, horizons=profile.FINE_HORIZONS)
    assert not np.isfinite(mixed.misfits[0])
    assert not mixed.fit.converged
    np.testing.assert_array_equal(mixed.fit.states[0], begun[0])
    np.testing.assert_allclose(mixed.misfits[1:], right.misfits[1:], atol=0.01)


def test_several_ways_find_the_motion_that_one_misses() -> None:
    draw, bodies, run, seed = 32, 5, 0, 3
    case = Case("bodies", 9000 + draw, draw, (), 0.03, "white", "discs", 4, 60.0, bodies)
    drawn = draw_discs(case, 4711)
    told = World.model_validate(drawn.world_json())
    data = Recording(
        tuple(Run(n, tuple(drawn.names), *rest) for n, *rest in drawn.runs(np.random.default_rng(seed), [run]))
    )
    plan = design(told.with_substep(1.001 / 60.0), data)
    bench = FitContext(plan, measured_noise(plan), 1)
    begun = profile.start_states(plan)
    one = bench.fit(Hypothesis(plan.world, ()), np.zeros(0), begun, horizons=profile.FINE_HORIZONS)
    assert one.misfits[0] > 2.0
    way = best_of_starts(plan.world, plan, bench.noise, 0, 1.1 * bench.observations)
    assert way.chi2 < 1.1 * bench.observations
    again = best_of_starts(plan.world, plan, bench.noise, 0, 1.1 * bench.observations)
    np.testing.assert_array_equal(way.state, again.state)


def test_a_contender_on_segments_is_not_held_by_states_bent_to_another_law() -> None:
    discs, _ = scene(3, 3)

    def turning(_t: float, _x: Array, v: Array, _w: Array) -> Array:
        return 2.0 * 0.15 * discs.masses[:, None] * np.column_stack([v[:, 1], -v[:, 0]])

    plan = laid_out(replace(discs, forces=(turning,)), 3, 3)
    bench = FitContext(plan, measured_noise(plan), 1)
    base = bench.fit(Hypothesis(plan.world, ()), np.zeros(0), profile.start_states(plan), iterations=0)
    cut = segment_context(bench, 2)
    assert cut is not None
    contest = Contest(cut.bench, cut, SearchSettings(), lambda _step, _figures: None)
    coriolis = catalogue()["coriolis"]
    parent = cut.ground(base.hypothesis, base.values)
    predictions = contest.predict([parent], lambda t: list(extended(t.hypothesis, coriolis, plan.recording)))
    best = contest.fit(predictions, 1, parent.chi2)[0]
    assert best.chi2 < 1.1 * cut.bench.observations
    assert best.values[0] == pytest.approx(0.15, abs=0.01)


def test_what_a_law_contains_is_tried_whatever_was_predicted() -> None:
    discs, _ = scene(2, 2)
    anchor = np.array([0.3, -0.2])
    plan = laid_out(replace(discs, forces=(lambda _t, x, _v, _w: -0.5 * (x - anchor),)), 2, 2)
    bench = FitContext(plan, measured_noise(plan), 2)
    base = bench.fit(Hypothesis(plan.world, ()), np.zeros(0), profile.start_states(plan), iterations=0)
    chosen = tuple(catalogue()[name] for name in ("spring", "tether"))
    search = Search.begin(base, chosen, SearchSettings(), lambda _step, _figures: None, plan.world.time.substep)
    (tether,) = extended(base.hypothesis, chosen[1], plan.recording)
    known = {"stiffness": 0.5, "rest_length": 0.01, "anchor_x": 0.3, "anchor_y": -0.2}
    values = np.array([known[u.name] for u in tether.unknowns])
    begun = profile.start_states(plan)
    search.whole.take(bench.fit(tether, values, begun, horizons=profile.FINE_HORIZONS))
    search.improve(1)
    best = search.best(1)
    assert best is not None
    assert best.hypothesis.names == ("spring",)
    assert best.passes


def test_short_windows_are_fitted_in_as_few_parts_as_they_have_samples_for() -> None:
    plan = laid_out(scene(2, 1)[0], 2, 1)
    cut = segment_context(FitContext(plan, measured_noise(plan), 1), 4)
    assert cut is not None
    whole, short = profile.horizons_for(plan), profile.horizons_for(cut.bench.design)
    assert whole[-1] == short[-1] == 1.0
    samples = max(len(r.times) for r in cut.bench.design.runs)
    assert samples < len(plan.runs[0].times) / 2.0
    assert len(short) > 1
    assert np.diff([0.0, *short]).min() * samples > 3.0  # less than that many samples tell no state
    assert np.diff([0.0, *whole]).min() * samples < 3.0
