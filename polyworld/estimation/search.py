"""The paper's searches over a study: the cross-entropy method, and random samples as their yardstick.

Both see constants and initial states as one box: those of the bounds, and of initial states so many ordinary changes
about their first guess. They are here for comparison; `least_squares` is what a fit uses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import cem
from polyworld.estimation.cem import CemSettings, CemState
from polyworld.estimation.least_squares import Point, Problem

Array = NDArray[np.float64]

Search = Literal["cem", "random_search"]
REACH = 10.0  # ordinary changes of an initial state within which it is searched
HORIZON = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)  # shares of the time that a search sees in turn
LAST = 0.4  # share of the generations that see all of it
REOPEN = 0.15  # share of the first deviation to which it is raised where the horizon grows


@dataclass(frozen=True)
class SearchSettings:
    """generations of `cem.population` candidates each."""

    generations: int = 60
    cem: CemSettings = field(default_factory=CemSettings)
    seed: int = 0


def search(
    problem: Problem,
    method: Search,
    settings: SearchSettings,
    watch: Callable[[int, float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Point:
    """Return the best point found; `watch` gets the generation and the least chi-square."""
    start = problem.start()
    centre = np.concatenate([start.shared, *(y for run in start.states for y in run)])
    typical = np.concatenate([problem.typical, *(b.states.typical for run in problem.runs for b in run)])
    states = len(centre) - len(start.shared)
    lower = np.concatenate([problem.lower, centre[len(start.shared) :] - REACH * typical[len(start.shared) :]])
    upper = np.concatenate([problem.upper, centre[len(start.shared) :] + REACH * typical[len(start.shared) :]])
    spread = np.concatenate([problem.typical, 3.0 * typical[-states:] if states else np.zeros(0)])

    def point(vector: Array) -> Point:
        own, at = [], len(start.shared)
        for run in problem.runs:
            parts = []
            for block in run:
                parts.append(vector[at : at + block.states.count])
                at += block.states.count
            own.append(tuple(parts))
        return Point(vector[: len(start.shared)], tuple(own))

    state = CemState.start(np.clip(centre, lower, upper), spread, settings.seed)
    rng = np.random.default_rng([settings.seed, 1])
    best, least, before = centre, np.inf, 0.0
    for number in range(settings.generations):
        if cancelled is not None and cancelled():
            break
        early = number / max((1.0 - LAST) * settings.generations, 1.0)
        share = 1.0 if method == "random_search" or early >= 1.0 else HORIZON[int(early * (len(HORIZON) - 1))]

        def costs(candidates: Array, share: float = share) -> Array:
            return problem.costs([point(c) for c in candidates], share)

        if method == "random_search":
            candidates = rng.uniform(lower, upper, (settings.cem.population, len(lower)))
            found = costs(candidates)
            if found.min() < least:
                best, least = candidates[int(np.argmin(found))], float(found.min())
        else:
            if share != before:
                state.sd = np.maximum(state.sd, REOPEN * spread)
            state = cem.generation(state, costs, lower, upper, settings.cem.floor * spread, settings.cem)
            best, least = state.elite[0], float(state.elite_losses[0])
        before = share
        if watch is not None:
            watch(number + 1, least)
    return point(best)
