"""A run fitted along several ways at once, where bodies collide.

Before a collision, data leave initial states a little uncertain; behind it this has become many motions, and a fit that
follows sample by sample may be led to a collision that was not. So it goes from part to part of the run with a few
states side by side, each fitted by itself: the best so far, and the best of many drawn from the spread that the part
before has left (as particle filters draw, but descending from each; Gordon, Salmond & Smith 1993). Spins that nobody
measured show by their size while a body slides, and by their sign only where it is hit: all patterns of signs are
tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, combinations, islice

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.descent import Point, first_steps, linearised, trial_costs
from polyworld.estimation.design import Design
from polyworld.estimation.forward import Forward
from polyworld.estimation.noise import Noise
from polyworld.estimation.per_run_descent import descend_per_run
from polyworld.world import World

Array = NDArray[np.float64]

FIRST = 0.05  # part of a run's time that is fitted before all else
PARTS = (14, 11, 17)  # stages to the whole: where one way of parting it leads astray, another may not
WAYS = 3  # states that are fitted side by side
DRAWN = 100 * WAYS  # around the best, of which the nearest to the data are fitted
WIDTHS = (1.0, 2.0)  # standard deviations in which they are drawn, in turn
UNKNOWN = 0.1  # of a typical change: the spread before anything is fitted
ITERATIONS, LAST = 2, 12  # at each stage, and at the whole
ROUGH, TOLERANCE = 1.0, 1e-2  # of chi2
PATTERNS = 64  # of the signs of spins at most, those with few turned first: of six bodies all
ROUNDS = 2  # of them, at most: what a pattern leads to may be near to another
TURNED, KEPT = 3, 8  # iterations for each, and how many of them are fitted to the end
SEED = 2024  # of the draws, the same for all


@dataclass(frozen=True)
class Way:
    """An initial state (N,) of a run, its chi2, and how many rollouts it took to find."""

    state: Array
    chi2: float
    rollouts: int


def best_of_starts(
    world: World,
    design: Design,
    noise: Noise,
    run: int,
    below: float,
    cancelled: Callable[[], bool] | None = None,
) -> Way:
    """The way found to fit a run best in a world, from the data's own start.

    below: chi2 at which no other way of parting the run is tried. cancelled: asked between batches; where it says so
    `InterruptedError` is raised. Equal inputs give equal results.
    """
    forward = Forward(design.copies(run, WAYS), world, (), cancelled)
    copies = noise.only([run] * WAYS)
    found: list[tuple[Array, float]] = []
    for count in PARTS:
        found.append(_followed(forward, copies, np.linspace(FIRST, 1.0, count)))
        for _ in range(ROUNDS if design.runs[run].spread.any() else 0):
            state, before = found[-1]
            found.append(_turned_over(forward, noise, run, state))
            if found[-1][1] > before - ROUGH:
                break
        if min(cost for _, cost in found) < below:
            break
    state, cost = min(found, key=lambda way: way[1])
    return Way(state, cost, forward.rollouts)


def _followed(forward: Forward, noise: Noise, parts: Array) -> tuple[Array, float]:
    run = forward.design.runs[0]
    rng = np.random.default_rng(SEED)
    best, cost, steps = run.start, np.inf, first_steps(forward)
    root = np.diag(UNKNOWN * run.typical)
    for part in parts:
        whole = part == parts[-1]
        at = Point(np.zeros(0), (best, *_drawn(forward, noise, best, root, float(part), rng)))
        many, tolerance = (LAST, TOLERANCE) if whole else (ITERATIONS, ROUGH)
        at, steps, _, _ = descend_per_run(forward, noise, at, float(part), steps, many, tolerance)
        linear = linearised(forward, noise, at, float(part), steps)
        costs = np.array([float(r @ r) for r in linear.r])
        least = int(np.argmin(costs))
        best, cost = at.states[least], float(costs[least])
        root = _root(linear.b[least], run.typical)
    return best, cost


def _turned_over(forward: Forward, noise: Noise, run: int, state: Array) -> tuple[Array, float]:
    """The best of fits to the whole run from a state with unseen spins turned the other way, in all patterns."""
    spins = np.flatnonzero(forward.design.runs[0].spread)
    few_first = chain.from_iterable(combinations(spins, k) for k in range(len(spins) + 1))
    options = []
    for turned in islice(few_first, PATTERNS):
        options.append(state.copy())
        options[-1][list(turned)] *= -1.0
    for iterations in (TURNED, LAST):
        many = Forward(forward.design.copies(0, len(options)), forward.world, (), forward.cancelled)
        copies = noise.only([run] * len(options))
        at, *_ = descend_per_run(
            many, copies, Point(np.zeros(0), tuple(options)), 1.0, first_steps(many), iterations, ROUGH
        )
        costs = trial_costs(many, copies, [at], 1.0)[0]
        forward.rollouts += many.rollouts
        best = np.argsort(costs)
        options = [at.states[k] for k in best[:KEPT]]
    return options[0], float(costs[best[0]])


def _root(slopes: Array, typical: Array) -> Array:
    """Root (N, N) of the covariance that residuals with these slopes (m, N) leave the initial state."""
    scaled = slopes * typical
    size, turn = np.linalg.eigh(scaled.T @ scaled + np.eye(len(typical)))
    root: Array = typical[:, None] * turn / np.sqrt(np.maximum(size, 1.0))  # none is less, but for rounding
    return root


def _drawn(
    forward: Forward, noise: Noise, best: Array, root: Array, part: float, rng: np.random.Generator
) -> list[Array]:
    """Of many states drawn around the best, those nearest to a part of the run: one less than are fitted."""
    width = np.resize(WIDTHS, DRAWN)[:, None]
    drawn = best + width * (rng.normal(size=(DRAWN, len(root))) @ root.T)
    points = [Point(np.zeros(0), tuple(drawn[k : k + WAYS])) for k in range(0, DRAWN, WAYS)]
    costs = trial_costs(forward, noise, points, part).ravel()
    return [drawn[k] for k in np.argsort(costs)[: WAYS - 1]]
