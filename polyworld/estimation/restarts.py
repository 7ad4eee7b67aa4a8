"""Other initial states for runs that fit ill, where no slope leads from a guess to the right one.

Spins that were not measured can turn either way; and a body that hits something right after the start was taken to
begin with the velocity that it has behind the impact.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.descent import Estimate, Steps, counts, descend, held, run_costs
from polyworld.estimation.design import RunDesign
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import Noise

Array = NDArray[np.float64]

SUSPECT = 1.2  # chi2 per measurement of a run beyond which its spins are flipped: 3 sigma of 450
TURN_ITERATIONS = 4
OTHER_SPINS = np.array([-1.5, -0.75, 0.75, 1.5])  # of its spread, that a spin is tried at besides the other way round


def flip_spins(forward: Forward, noise: Noise, at: Estimate, horizon: float, steps: Steps, ill: float) -> Estimate:
    """Return spins the other way, or of another size, for runs whose chi2 per measurement is above `ill`: one body at a
    time. The slope of a spin shows nothing of the other sign."""
    cost = run_costs(forward, noise, at, horizon)
    limits = ill * counts(forward, horizon)
    for slot in range(max((int(np.count_nonzero(r.spread)) for r in forward.design.runs), default=0)):
        options = {
            r.index: _other_spins(r, at.states[r.index], slot)
            for r in forward.design.runs
            if cost[r.index] > limits[r.index] and slot < np.count_nonzero(r.spread)
        }
        at, cost = _tried(forward, noise, at, horizon, steps, options, cost)
    return at


def _other_spins(run: RunDesign, own: Array, slot: int) -> Array:
    i = int(np.flatnonzero(run.spread)[slot])
    size = max(abs(own[i]), 0.5 * run.spread[i])
    others = np.array([-size if own[i] > 0.0 else size, *(OTHER_SPINS * run.spread[i])])
    options = np.repeat(own[None], len(others), axis=0)
    options[:, i] = others
    return options


def restart_velocities(
    forward: Forward, noise: Noise, at: Estimate, horizon: float, steps: Steps, worse: float
) -> Estimate:
    """Restart runs that fit ill, and `worse` times worse than the better ones, from their very first samples: a body
    that hits something right after the start was taken to begin with the velocity that it has behind the impact, and no
    slope leads back."""
    cost = run_costs(forward, noise, at, horizon)
    relative = cost / counts(forward, horizon)
    limit = max(SUSPECT, worse * float(np.quantile(relative, 0.25)) if len(relative) > 1 else 0.0)
    options = {
        r.index: _other_velocities(r, at.states[r.index])
        for r in forward.design.runs
        if relative[r.index] > limit and any(np.any(state.short_window != state.start) for state in r.states)
    }
    return _tried(forward, noise, at, horizon, steps, options, cost)[0]


def _other_velocities(run: RunDesign, own: Array) -> Array:
    """Return states of one body at a time, or of all, as the very first samples suggest them."""
    options = []
    short_window = np.concatenate([state.short_window for state in run.states], axis=1)
    first = 0
    for state in run.states:
        mine = slice(first, first + len(state.labels))
        first = mine.stop
        for guess in short_window:
            options.append(own.copy())
            options[-1][mine] = guess[mine]
    return np.array([*options, *short_window])


def _tried(
    forward: Forward,
    noise: Noise,
    at: Estimate,
    horizon: float,
    steps: Steps,
    options: Mapping[int, Array],
    cost: Array,
) -> tuple[Estimate, Array]:
    """Try other initial states (K, N) of some runs: follow the nearest to the data by a few iterations, keep it where
    the run then fits better; return these and chi2 (R,) of all runs."""
    if not options:
        return at, cost
    runs = [forward.design.runs[k] for k in options]
    settings = [Settings(k, np.repeat(at.values[None], len(o), axis=0), o) for k, o in options.items()]
    states = list(at.states)
    for r, raw in zip(runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw) * r.before(horizon)
        costs = np.where(np.all(np.isfinite(white), axis=1), (white**2).sum(axis=1), np.inf)
        states[r.index] = options[r.index][int(np.argmin(costs))]
    hold = held(forward, at.values, horizon)
    start = Estimate(at.values, tuple(states))
    trial, *_ = descend(forward, noise, start, horizon, steps, TURN_ITERATIONS, 10.0, None, hold)
    other = run_costs(forward, noise, Estimate(at.values, trial.states), horizon)
    better = [k for k in options if other[k] < cost[k] - 1.0]
    kept = Estimate(at.values, tuple(trial.states[k] if k in better else s for k, s in enumerate(at.states)))
    cost = cost.copy()
    cost[better] = other[better]
    return kept, cost
