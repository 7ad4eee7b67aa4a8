"""The cross-entropy method against its equations and on functions with known minima."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.estimation.search import Cem, SearchSettings

LOWER, UPPER = np.full(3, -2.0), np.full(3, 2.0)
TARGET = np.array([0.3, -1.2, 1.9])


def bowl(x: np.ndarray) -> np.ndarray:
    return ((x - TARGET) ** 2 * np.array([1.0, 10.0, 100.0])).sum(axis=1)


def minimise(evaluate, lower, upper, mean, sd, *, generations: int, seed: int = 0) -> Cem:
    settings, state = SearchSettings(), Cem(mean, sd, np.random.default_rng(seed))
    for _ in range(generations):
        state.advance(evaluate, lower, upper, settings.floor * sd, settings)
    return state


def test_update_follows_the_smoothed_elite_statistics_and_the_floor() -> None:
    seen: list[np.ndarray] = []

    def watched(x: np.ndarray) -> np.ndarray:
        seen.append(x.copy())
        return bowl(x)

    settings = SearchSettings(population=20, elites=5, carried=2, smoothing=0.4, floor=0.0)
    state = Cem(np.zeros(3), np.ones(3), np.random.default_rng(3))
    floor = np.array([0.0, 0.0, 0.9])
    state.advance(watched, LOWER, UPPER, floor, settings)
    elite = seen[0][np.argsort(bowl(seen[0]), kind="stable")[:5]]
    assert state.mean == pytest.approx(0.6 * elite.mean(axis=0))
    assert state.sd == pytest.approx(np.maximum(floor, 0.4 + 0.6 * elite.std(axis=0)))
    state.advance(watched, LOWER, UPPER, floor, settings)
    assert np.array_equal(seen[1][:2], elite[:2]), "the best two are carried into the next generation"


def test_it_finds_the_minimum_of_a_badly_scaled_bowl() -> None:
    found = minimise(bowl, LOWER, UPPER, np.zeros(3), np.ones(3), generations=40)
    assert found.elite[0] == pytest.approx(TARGET, abs=0.02)
    assert np.all(np.diff(found.losses) >= 0.0)


def test_a_minimum_on_the_bound_is_reached() -> None:
    def slope(x: np.ndarray) -> np.ndarray:
        return x.sum(axis=1)

    found = minimise(slope, LOWER, UPPER, np.zeros(3), np.ones(3), generations=30)
    assert found.elite[0] == pytest.approx(LOWER)


def test_at_equal_budget_it_beats_random_search_in_ten_dimensions() -> None:
    lower, upper = np.full(10, -1.0), np.full(10, 1.0)

    def far(x: np.ndarray) -> np.ndarray:
        return ((x - 0.4) ** 2).sum(axis=1)

    ours = minimise(far, lower, upper, np.zeros(10), np.full(10, 0.5), generations=40).losses[0]
    theirs = far(np.random.default_rng(0).uniform(lower, upper, (40 * 64, 10))).min()
    assert ours < 0.01 * theirs


@pytest.mark.parametrize("wrong", [{"elites": 1}, {"elites": 65}, {"carried": 13}, {"smoothing": 1.0}, {"floor": -0.1}])
def test_impossible_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SearchSettings(**wrong)
