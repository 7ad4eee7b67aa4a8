"""Several searches, each refined: the deepest of several basins, found where one search would stay in another."""

from __future__ import annotations

import pytest

from polyworld.estimation.world_fit import (
    CemSettings,
    FitProblem,
    ObjectiveSettings,
    SearchProgress,
    SearchSettings,
    Unknown,
    fit,
    multistart,
    restarts,
)
from tests.polyworld.estimation.world_fit.closed_form import ClosedForm, observe, thrown_ball

SPIN = [Unknown("spin", ("objects.ball.angular_velocity.z",), "", 0.0, -60.0, 60.0, 40.0)]
TRUE_SPIN = 2.0


def refit_by_multistart(restarts: int, **given):
    objective = ObjectiveSettings(rotation_sigma=0.05)
    tracks = observe(thrown_ball(), frames=60)
    problem = FitProblem(thrown_ball(), tracks, SPIN, objective=objective, make_simulator=ClosedForm)
    search = SearchSettings(generations=8, cem=CemSettings(population=6, elites=2, carried=1), horizon=(1.0,))
    return multistart(problem, search, restarts, **given)


def test_the_true_spin_is_found_among_those_that_look_alike_from_frame_to_frame() -> None:
    # Angles are seen modulo a turn: fast spins have minima of their own, in which single searches end.
    starts = refit_by_multistart(12)
    spins = [start.best.value("spin").value for start in starts]
    assert spins[0] == pytest.approx(TRUE_SPIN, abs=0.05)
    assert starts[0].best.loss == pytest.approx(1.0, abs=0.3)
    diverged = [start for start, spin in zip(starts, spins, strict=True) if abs(spin - TRUE_SPIN) > 1.0]
    assert diverged
    assert all(start.best.loss > 2.0 * starts[0].best.loss for start in diverged)


def test_starts_come_in_order_and_refining_makes_none_worse() -> None:
    starts = refit_by_multistart(4)
    assert {start.searched.seed for start in starts} == {0, 1, 2, 3}
    assert [start.best.loss for start in starts] == sorted(start.best.loss for start in starts)
    for start in starts:
        assert start.refined is not None
        assert start.best.loss <= start.searched.loss


def test_a_cancelled_fit_returns_the_starts_made_so_far() -> None:
    heard: list[SearchProgress] = []
    starts = refit_by_multistart(4, progress=heard.append, cancelled=lambda: len(heard) >= 12)
    assert [step.done for step in heard] == list(range(1, 13))
    assert heard[-1].total == 32
    assert len(starts) == 2
    assert "cancelled" in {start.searched.status for start in starts}


def test_searches_differ_in_their_seeds_and_each_is_that_of_its_seed_alone() -> None:
    tracks = observe(thrown_ball(), frames=60)
    problem = FitProblem(thrown_ball(), tracks, SPIN, make_simulator=ClosedForm)
    settings = SearchSettings(generations=4, cem=CemSettings(population=6, elites=2, carried=1), seed=5)
    results = list(restarts(problem, settings, 3))
    assert [result.seed for result in results] == [5, 6, 7]
    assert [result.history[0].restart for result in results] == [0, 1, 2]
    alone = fit(problem, SearchSettings(generations=4, cem=settings.cem, seed=7))
    assert alone.by_name == results[2].by_name
    assert alone.rollouts == results[2].rollouts
