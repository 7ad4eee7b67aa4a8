"""The paper's searches over a study: the cross-entropy method, and random samples as their yardstick.

A diagonal Gaussian is drawn towards its best samples (Rubinstein & Kroese, The Cross-Entropy Method, 2004), with the
smoothed update and the variance floor; the best candidates so far are carried into the next generation.

Both see constants and initial states as one box: those of the bounds, and of initial states so many ordinary changes
about their first guess. They are here for comparison; `least_squares` is what a fit uses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.least_squares import Point, Problem

Array = NDArray[np.float64]

Evaluate = Callable[[Array], Array]
Search = Literal["cem", "random_search"]


@dataclass(frozen=True)
class SearchSettings:
    """generations of `population` candidates, of which `elites` form the elite set and the `carried` best so far are
    candidates of the generation before. smoothing: the weight of the old mean and deviation. floor: smallest standard
    deviation as a share of the initial one. reach: ordinary changes of an initial state within which it is searched,
    beyond the error of a first guess. stages: equal shares of the time that a search sees in turn; last: share of the
    generations that see all of it. reopen: share of the first deviation to which it is raised where the horizon
    grows."""

    generations: int = 60
    population: int = 64
    elites: int = 12
    carried: int = 4
    smoothing: float = 0.4
    floor: float = 0.01
    seed: int = 0
    reach: float = 2.0
    stages: int = 8
    last: float = 0.4
    reopen: float = 0.15

    def __post_init__(self) -> None:
        most = min(self.elites, self.population - 1)
        limits = {"elites": (2, self.population), "carried": (0, most), "smoothing": (0, 0.999), "floor": (0, 1)}
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} must lie in {low}..{high}, got {getattr(self, name)}")


@dataclass
class Cem:
    """State of the search: mean, sd (P,) of the proposal; elite (K, P), the best candidates so far, best first, and
    their losses."""

    mean: Array
    sd: Array
    rng: np.random.Generator
    elite: Array = field(default_factory=lambda: np.zeros((0, 1)))
    losses: Array = field(default_factory=lambda: np.zeros(0))

    def advance(self, evaluate: Evaluate, lower: Array, upper: Array, floor: Array, settings: SearchSettings) -> None:
        """Run one generation: sample, project, evaluate (N, P) -> losses (N,), select, update.

        floor (P,): smallest standard deviations. The carried candidates are evaluated again with the rest, so that the
        elite's losses always belong to the present horizon.
        """
        noise = self.rng.standard_normal((settings.population, len(self.mean)))
        candidates = np.clip(self.mean + self.sd * noise, lower, upper)
        candidates[-1] = np.clip(self.mean, lower, upper)
        carried = self.elite[: settings.carried]
        candidates[: len(carried)] = carried
        losses, old = evaluate(candidates), settings.smoothing
        order = np.argsort(losses, kind="stable")[: settings.elites]
        self.elite, self.losses = candidates[order], losses[order]
        self.mean = old * self.mean + (1.0 - old) * self.elite.mean(axis=0)
        self.sd = np.maximum(floor, old * self.sd + (1.0 - old) * self.elite.std(axis=0))


def search(
    problem: Problem,
    method: Search,
    settings: SearchSettings,
    watch: Callable[[int, float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Point:
    """Return the best point found; `watch` gets the generation and the least chi-square."""
    start, count = problem.start(), len(problem.shared)
    sizes = [[b.states.count for b in run] for run in problem.runs]
    centre = np.concatenate([start.shared, *(y for run in start.states for y in run)])
    typical = np.concatenate([problem.typical, *(b.states.typical for run in problem.runs for b in run)])
    lower, upper = (
        np.concatenate([bound, (centre + way * settings.reach * typical)[count:]])
        for bound, way in ((problem.lower, -1.0), (problem.upper, 1.0))
    )

    def point(vector: Array) -> Point:
        parts = iter(np.split(vector, np.cumsum([count, *(n for run in sizes for n in run)])[:-1]))
        return Point(next(parts), tuple(tuple(next(parts) for _ in run) for run in sizes))

    state = Cem(np.clip(centre, lower, upper), typical.copy(), np.random.default_rng(settings.seed))
    best, least, before = centre, np.inf, 0.0
    for number in range(settings.generations):
        if cancelled is not None and cancelled():
            break
        early = number / max((1.0 - settings.last) * settings.generations, 1.0)
        whole = method == "random_search" or early >= 1.0
        share = 1.0 if whole else (1 + int(early * (settings.stages - 1))) / settings.stages

        def costs(candidates: Array, share: float = share) -> Array:
            return problem.costs([point(c) for c in candidates], share)

        if method == "random_search":
            candidates = state.rng.uniform(lower, upper, (settings.population, len(lower)))
            found = costs(candidates)
            if found.min() < least:
                best, least = candidates[int(np.argmin(found))], float(found.min())
        else:
            if share != before:
                state.sd = np.maximum(state.sd, settings.reopen * typical)
            state.advance(costs, lower, upper, settings.floor * typical, settings)
            best, least = state.elite[0], float(state.losses[0])
        before = share
        if watch is not None:
            watch(number + 1, least)
    return point(best)
