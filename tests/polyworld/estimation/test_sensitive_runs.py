"""Runs that no fit follows as a whole though their segments are explained, and states that the data do not show."""

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FitContext
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.multistart import best_of_starts
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.normal_equations import LONGEST
from polyworld.estimation.profile import FINE_HORIZONS, start_states
from polyworld.estimation.run_segments import split_runs
from polyworld.estimation.score_test import score_test_starts
from polyworld.gap.catalogue import catalogue
from polyworld.gap.segment_context import segment_context
from polyworld.gap.sensitive_runs import sensitive_runs
from polyworld.gap.stepping import coarsened
from polyworld.world import World
from tests.polyworld.estimation.colliding_discs import bent_run, laid_out, plain, scene, world
from tests.scenes.discs import Started, slide

Array = NDArray[np.float64]


def test_a_run_that_is_stuck_whole_shows_by_its_segments_and_more_are_not() -> None:
    context, right = plain(4, 2)
    cut = segment_context(context, 2)
    assert cut is not None
    on_segments = cut.fit_base(right.hypothesis, right.values)
    assert sensitive_runs(right, cut, on_segments) == ()
    stuck = bent_run(right, 1, "disc3.velocity.y", 0.2)
    assert stuck.chi2 > right.chi2 + 100.0
    assert sensitive_runs(stuck, cut, on_segments) == ("run1",)
    other = bent_run(right, 0, "disc3.velocity.y", -0.4)
    both = [other.fit.states[0], *stuck.fit.states[1:]]
    most = context.fit(right.hypothesis, right.values, both, iterations=0)
    assert np.all((most.costs - right.costs)[:2] > 100.0)
    assert sensitive_runs(most, cut, on_segments) == ()  # a law that lacks something shows in most runs


def test_named_runs_are_split_in_two_and_the_others_stay() -> None:
    recording = laid_out(scene(4, 2)[0], 4, 2).recording
    parts = split_runs(recording, ("run1",)).runs
    assert [p.part_of for p in parts if p.part_of is not None] == ["run1", "run1"]
    halves = [p for p in parts if p.part_of == "run1"]
    whole = next(r for r in recording.runs if r.name == "run1")
    np.testing.assert_array_equal(np.concatenate([p.times for p in halves]), whole.times)
    assert [p for p in parts if p.part_of is None] == [r for r in recording.runs if r.name != "run1"]


def test_spins_that_nobody_measured_are_found_with_their_signs() -> None:
    """Motion before a collision is the same for both; each body by itself is no way to the right pattern."""
    plan = laid_out(scene(5, 3)[0], 5, 3)
    noise = measured_noise(plan)
    found = best_of_starts(plan.world, plan, noise, 1, 0.0)
    assert found.chi2 < 1.2 * len(plan.runs[1].run.times) * 2 * 5


def test_a_disc_at_rest_does_not_hold_up_what_the_others_show() -> None:
    """The slope of what rests on friction by its speed is next to nothing, and asks for speeds beyond all sense."""
    discs, _ = scene(3, 3)
    rng, times = np.random.default_rng(1), np.arange(25) / 60.0
    names, runs = ("disc0", "disc1", "disc2"), []
    for k in range(6):
        places = np.array([[-0.5, 0.02 * k - 0.05], [0.0, 0.0], [0.9, 1.1]])
        velocities = rng.uniform(0.6, 1.4) * np.array([[1.6, 0.0], [0.0, 0.0], [-0.9, -1.2]])
        start = Started(places, velocities, np.array([rng.uniform(-6.0, 6.0), 0.0, rng.uniform(-6.0, 6.0)]))
        seen = np.zeros((25, 3, 3))
        seen[..., :2] = 1.08 * slide(discs, start, times)[..., :2] + rng.normal(0.0, 0.003, (25, 3, 2))
        runs.append(Run(f"run{k}", names, times, seen, np.full((25, 3, 4), np.nan)))
    data = Recording(tuple(runs))
    plan = design(coarsened(world(discs, start), data), data)
    context = FitContext(plan, measured_noise(plan), 1)
    law = extended(Hypothesis(plan.world, ()), catalogue()["observer_scale"], data)[0]

    base = context.fit(Hypothesis(plan.world, ()), np.zeros(0), start_states(plan), horizons=FINE_HORIZONS)
    found = context.fit(law, np.array([1.0]), base.fit.states)
    assert found.chi2 < 1.1 * context.observations
    assert found.values[0] == pytest.approx(1.08, abs=0.02)


def test_what_the_score_test_makes_of_a_spin_that_shows_nowhere_stays_within_reach() -> None:
    discs, starts = scene(2, 1)
    distant = Started(starts[0].positions * np.array([[1.0], [40.0]]), starts[0].velocities, starts[0].spins)
    times = np.arange(40) / 60.0
    seen = np.zeros((40, 2, 3))
    seen[..., :2] = slide(discs, distant, times)[..., :2] + np.random.default_rng(1).normal(0.0, 1e-4, (40, 2, 2))
    data = Recording((Run("run0", ("disc0", "disc1"), times, seen, np.full((40, 2, 4), np.nan)),))
    described = world(discs, distant).model_dump()
    for item in described["objects"]:
        item["torsional_radius"] = 1e-4  # next to nothing
    plan = design(coarsened(World.model_validate(described), data), data)
    context = FitContext(plan, measured_noise(plan), 1)
    base = context.fit(Hypothesis(plan.world, ()), np.zeros(0), start_states(plan))
    found = score_test_starts(context, base, extended(base.hypothesis, catalogue()["quadratic_drag"], data), 1)
    assert found
    for tested in found:
        assert tested.states is not None
        change = np.abs(tested.states[0] - base.fit.states[0])
        assert np.all(change <= 1.0001 * LONGEST * plan.runs[0].typical)
