"""The paper's searches over a study: the cross-entropy method, and random samples as their yardstick.

A diagonal Gaussian is drawn towards its best samples (Rubinstein & Kroese, The Cross-Entropy Method, 2004), with the
smoothed update and the variance floor; the best candidates so far are carried into the next generation.

Both see constants and initial states as one box: those of the bounds, and of initial states so many ordinary changes
about their first guess. They are here for comparison; `least_squares` is what a fit uses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.least_squares import Point, Problem

Array = NDArray[np.float64]

Evaluate = Callable[[Array], Array]


@dataclass(frozen=True)
class CemSettings:
    """population N candidates a generation, of which `elites` K form the elite set and the `carried` best so
    far are candidates of the generation before. smoothing: the weight of the old mean and deviation. floor:
    smallest standard deviation as a share of the initial one.
    """

    population: int = 64
    elites: int = 12
    carried: int = 4
    smoothing: float = 0.4
    floor: float = 0.01

    def __post_init__(self) -> None:
        if not 2 <= self.elites <= self.population:
            raise ValueError(f"elites must lie in 2..population ({self.population}), got {self.elites}")
        if not 0 <= self.carried <= min(self.elites, self.population - 1):
            raise ValueError(f"carried must lie in 0..{min(self.elites, self.population - 1)}, got {self.carried}")
        if not 0.0 <= self.smoothing < 1.0:
            raise ValueError(f"smoothing must lie in [0, 1), got {self.smoothing}")
        if not 0.0 <= self.floor <= 1.0:
            raise ValueError(f"floor must lie in 0..1, got {self.floor}")


@dataclass
class CemState:
    """All that the search knows between generations.

    mean, sd (P,): the proposal. elite (K', P): the best candidates so far, best first, and their losses.
    rng: state of the random generator.
    """

    generation: int
    mean: Array
    sd: Array
    elite: Array
    elite_losses: Array
    rng: dict[str, Any]

    @classmethod
    def start(cls, mean: Array, sd: Array, seed: int) -> CemState:
        """Return the state before the first generation."""
        p = len(mean)
        return cls(
            generation=0,
            mean=np.array(mean, dtype=float),
            sd=np.array(sd, dtype=float),
            elite=np.zeros((0, p)),
            elite_losses=np.zeros(0),
            rng=dict(np.random.default_rng(seed).bit_generator.state),
        )


def generation(
    state: CemState,
    evaluate: Evaluate,
    lower: Array,
    upper: Array,
    floor: Array,
    settings: CemSettings,
    *,
    free: NDArray[np.bool_] | None = None,
) -> CemState:
    """Run one generation: sample, project, evaluate, select, update; return the next state.

    evaluate: candidates (N, P) -> losses (N,). floor (P,): smallest standard deviations. free (P,):
    parameters that take part (default all); the others keep their mean in every candidate and their proposal.
    The carried candidates are evaluated again with the rest, so `evaluate` may change between generations
    (a longer horizon) and the elite's losses always belong to the present one.
    """
    rng = np.random.default_rng(0)
    rng.bit_generator.state = state.rng
    active = np.ones(len(state.mean), dtype=bool) if free is None else free
    noise = rng.standard_normal((settings.population, len(state.mean)))
    candidates = np.clip(state.mean + state.sd * noise * active, lower, upper)
    # The mean itself is a candidate, and the best so far are carried over.
    candidates[-1] = np.clip(state.mean, lower, upper)
    carried = state.elite[: settings.carried]
    candidates[: len(carried)] = carried
    losses = evaluate(candidates)
    order = np.argsort(losses, kind="stable")[: settings.elites]
    elite = candidates[order]
    elite_mean, elite_sd = elite.mean(axis=0), elite.std(axis=0)
    a = settings.smoothing
    mean = np.where(active, a * state.mean + (1.0 - a) * elite_mean, state.mean)
    sd = np.where(active, np.maximum(floor, a * state.sd + (1.0 - a) * elite_sd), state.sd)
    return CemState(
        generation=state.generation + 1,
        mean=mean,
        sd=sd,
        elite=elite,
        elite_losses=losses[order],
        rng=dict(rng.bit_generator.state),
    )


Search = Literal["cem", "random_search"]


@dataclass(frozen=True)
class SearchSettings:
    """generations of `cem.population` candidates each. reach: ordinary changes of an initial state within which it is
    searched, beyond the error of a first guess. stages: equal shares of the time that a search sees in turn; last:
    share of the generations that see all of it. reopen: share of the first deviation to which it is raised where the
    horizon grows."""

    generations: int = 60
    cem: CemSettings = field(default_factory=CemSettings)
    seed: int = 0
    reach: float = 2.0
    stages: int = 8
    last: float = 0.4
    reopen: float = 0.15


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
    lower = np.concatenate([problem.lower, centre[len(start.shared) :] - settings.reach * typical[len(start.shared) :]])
    upper = np.concatenate([problem.upper, centre[len(start.shared) :] + settings.reach * typical[len(start.shared) :]])

    def point(vector: Array) -> Point:
        own, at = [], len(start.shared)
        for run in problem.runs:
            parts = []
            for block in run:
                parts.append(vector[at : at + block.states.count])
                at += block.states.count
            own.append(tuple(parts))
        return Point(vector[: len(start.shared)], tuple(own))

    state = CemState.start(np.clip(centre, lower, upper), typical, settings.seed)
    rng = np.random.default_rng([settings.seed, 1])
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
            candidates = rng.uniform(lower, upper, (settings.cem.population, len(lower)))
            found = costs(candidates)
            if found.min() < least:
                best, least = candidates[int(np.argmin(found))], float(found.min())
        else:
            if share != before:
                state.sd = np.maximum(state.sd, settings.reopen * typical)
            state = generation(state, costs, lower, upper, settings.cem.floor * typical, settings.cem)
            best, least = state.elite[0], float(state.elite_losses[0])
        before = share
        if watch is not None:
            watch(number + 1, least)
    return point(best)
