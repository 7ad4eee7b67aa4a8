"""Fit one run by multistart, where bodies collide.

Before a collision, data leave initial states a little uncertain; behind it this has become many motions, and a fit that
follows sample by sample may be led to a collision that was not. So a few states are fitted side by
side over growing parts of the run: the best so far, and the best of many drawn from the spread that the part
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

from polyworld.estimation.descent import Estimate, first_steps, linearised, trial_costs
from polyworld.estimation.design import Design
from polyworld.estimation.forward import Forward
from polyworld.estimation.noise import Noise
from polyworld.estimation.per_run_descent import descend_per_run
from polyworld.estimation.settings import MULTISTART
from polyworld.world import World

Array = NDArray[np.float64]

SEED = 2024  # of the draws, the same for all


@dataclass(frozen=True)
class RunFit:
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
) -> RunFit:
    """Fit one run in a world by multistart, from the data's own start.

    below: chi2 at which no other division of the run is tried. cancelled: asked between batches; where it says so
    `InterruptedError` is raised. Equal inputs give equal results.
    """
    forward = Forward(design.copies(run, MULTISTART.kept), world, (), cancelled)
    copies = noise.only([run] * MULTISTART.kept)
    found: list[tuple[Array, float]] = []
    for count in MULTISTART.stages:
        found.append(_followed(forward, copies, np.linspace(MULTISTART.first, 1.0, count)))
        for _ in range(MULTISTART.rounds if design.runs[run].spread.any() else 0):
            state, before = found[-1]
            found.append(_flip_unobserved_spins(forward, noise, run, state))
            if found[-1][1] > before - MULTISTART.rough:
                break
        if min(cost for _, cost in found) < below:
            break
    state, cost = min(found, key=lambda fit: fit[1])
    return RunFit(state, cost, forward.rollouts)


def _followed(forward: Forward, noise: Noise, parts: Array) -> tuple[Array, float]:
    run = forward.design.runs[0]
    rng = np.random.default_rng(SEED)
    best, cost, steps = run.start, np.inf, first_steps(forward)
    root = np.diag(MULTISTART.unknown * run.typical)
    for part in parts:
        whole = part == parts[-1]
        at = Estimate(np.zeros(0), (best, *_drawn(forward, noise, best, root, float(part), rng)))
        many = MULTISTART.last if whole else MULTISTART.iterations
        tolerance = MULTISTART.tolerance if whole else MULTISTART.rough
        at, steps, _, _ = descend_per_run(forward, noise, at, float(part), steps, many, tolerance)
        linear = linearised(forward, noise, at, float(part), steps)
        costs = np.array([float(r @ r) for r in linear.r])
        least = int(np.argmin(costs))
        best, cost = at.states[least], float(costs[least])
        root = _root(linear.b[least], run.typical)
    return best, cost


def _flip_unobserved_spins(forward: Forward, noise: Noise, run: int, state: Array) -> tuple[Array, float]:
    """Return the best fit to the whole run from a state with signs of unobserved spins flipped, in all patterns."""
    spins = np.flatnonzero(forward.design.runs[0].spread)
    few_first = chain.from_iterable(combinations(spins, k) for k in range(len(spins) + 1))
    options = []
    for turned in islice(few_first, MULTISTART.patterns):
        options.append(state.copy())
        options[-1][list(turned)] *= -1.0
    for iterations in (MULTISTART.flipped, MULTISTART.last):
        many = Forward(forward.design.copies(0, len(options)), forward.world, (), forward.cancelled)
        copies = noise.only([run] * len(options))
        at, *_ = descend_per_run(
            many, copies, Estimate(np.zeros(0), tuple(options)), 1.0, first_steps(many), iterations, MULTISTART.rough
        )
        costs = trial_costs(many, copies, [at], 1.0)[0]
        forward.rollouts += many.rollouts
        best = np.argsort(costs)
        options = [at.states[k] for k in best[: MULTISTART.finished]]
    return options[0], float(costs[best[0]])


def _root(slopes: Array, typical: Array) -> Array:
    """Return the root (N, N) of the covariance that residuals with these slopes (m, N) leave the initial state."""
    scaled = slopes * typical
    size, turn = np.linalg.eigh(scaled.T @ scaled + np.eye(len(typical)))
    root: Array = typical[:, None] * turn / np.sqrt(np.maximum(size, 1.0))  # none is less, but for rounding
    return root


def _drawn(
    forward: Forward, noise: Noise, best: Array, root: Array, part: float, rng: np.random.Generator
) -> list[Array]:
    """Draw many states around the best; return those nearest to a part of the run: one less than are fitted."""
    count, kept = MULTISTART.drawn * MULTISTART.kept, MULTISTART.kept
    width = np.resize(MULTISTART.widths, count)[:, None]
    drawn = best + width * (rng.normal(size=(count, len(root))) @ root.T)
    points = [Estimate(np.zeros(0), tuple(drawn[k : k + kept])) for k in range(0, count, kept)]
    costs = trial_costs(forward, noise, points, part).ravel()
    return [drawn[k] for k in np.argsort(costs)[: kept - 1]]
