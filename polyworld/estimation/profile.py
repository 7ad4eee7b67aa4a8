"""Least squares on all runs at once, with every run's initial state eliminated, over growing parts of the runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import restarts
from polyworld.estimation.descent import (
    Estimate,
    Steps,
    covariances,
    descend,
    first_steps,
    held,
    linearised,
    linearised_centrally,
    linearised_shared,
    run_costs,
    standard_steps,
)
from polyworld.estimation.design import Design
from polyworld.estimation.forward import Forward
from polyworld.estimation.noise import Noise
from polyworld.estimation.normal_equations import Linearised
from polyworld.estimation.per_run_descent import descend_per_run

Array = NDArray[np.float64]

HORIZONS = (0.35, 0.65, 1.0)  # growing, so that a bounce that comes too early does not trap the fit
# Where bodies meet: about one more collision at a time.
FINE_HORIZONS = (0.08, 0.15, 0.22, 0.3, 0.38, 0.46, 0.54, 0.62, 0.7, 0.8, 0.9, 1.0)
OTHER_HORIZONS = tuple(float(h) for h in np.linspace(0.05, 1.0, 24).round(3))  # another way past the collisions
ADDED = 7  # samples by which parts of segments are to grow on average where bodies meet
COARSEST = 4  # at least every so many of the parts is fitted all the same
OPENING = 0.4  # part of a run's time in which its first velocities are decided
WORSE = 2.0  # times chi2 per measurement of the better runs, beyond which a run's first velocities are tried again
SWEEPS = 2  # through all spins
ROUGH = 10.0  # fall of chi2 below which a fit to a part of the runs is at rest


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    values (S,): shared unknowns. states[run] (N,): initial-state coordinates. chi2: sum of squared whitened residuals
    at the minimum. covariance (S, S) of the shared unknowns, initial states profiled out; infinite variance where the
    data say nothing. linear: residuals and derivatives there. converged: False where the iterations
    ran out, or no step brought what the slopes predicted.
    """

    values: Array
    states: tuple[Array, ...]
    chi2: float
    covariance: Array
    linear: Linearised
    converged: bool
    iterations: int
    rollouts: int


def fit(
    forward: Forward,
    noise: Noise,
    values: Array,
    states: Sequence[Array],
    *,
    horizons: Sequence[float] = (1.0,),
    iterations: int = 12,
    tolerance: float = 1e-2,
    target: float | None = None,
) -> Fit:
    """Fit shared unknowns and initial states from the values given.

    horizons: parts of each run's time fitted one after another; the result is that of the last, so end with 1 for the
    whole. tolerance: a fit has converged when chi2 falls by less than this, absolutely: differences of 10 decide
    between hypotheses. target: chi2 below which the fit is of interest; a fit far above it that comes no nearer is
    given up. Where nothing is shared, runs are fitted each by itself: the tolerance is that of a run, and there is no
    target.
    """
    at = Estimate(np.array(values, dtype=float), tuple(np.array(s, dtype=float) for s in states))
    start = at.values
    before = forward.rollouts

    def descended(at: Estimate, steps: Steps, horizon: float) -> tuple[Estimate, Steps, int, bool]:
        loose = tolerance if horizon >= 1.0 else ROUGH
        if not len(values):
            return descend_per_run(forward, noise, at, horizon, steps, iterations, loose)
        aim = target if horizon >= 1.0 else None
        return descend(forward, noise, at, horizon, steps, iterations, loose, aim, held(forward, start, horizon))

    at, steps, total, converged = _over_horizons(forward, noise, at, horizons, descended)
    linear = linearised(forward, noise, at, horizons[-1], steps)
    covariance, _ = covariances(forward, linear)
    return Fit(at.values, at.states, linear.chi2, covariance, linear, converged, total, forward.rollouts - before)


def fit_per_run(
    forward: Forward, noise: Noise, at: Estimate, *, horizons: Sequence[float], iterations: int, tolerance: float = 1e-2
) -> tuple[Estimate, Array]:
    """Fit every run's initial state by itself, with shared unknowns kept; and chi2 (R,) of the runs then.

    horizons, tolerance: as in `fit`.
    """

    def descended(at: Estimate, steps: Steps, horizon: float) -> tuple[Estimate, Steps, int, bool]:
        loose = tolerance if horizon >= 1.0 else ROUGH
        return descend_per_run(forward, noise, at, horizon, steps, iterations, loose)

    at, *_ = _over_horizons(forward, noise, at, horizons, descended)
    return at, run_costs(forward, noise, at, horizons[-1])


def _over_horizons(
    forward: Forward,
    noise: Noise,
    at: Estimate,
    horizons: Sequence[float],
    descended: Callable[[Estimate, Steps, float], tuple[Estimate, Steps, int, bool]],
) -> tuple[Estimate, Steps, int, bool]:
    """Descend over one part of the runs after another, with other starts tried where there are several."""
    total = 0
    converged = False
    steps = first_steps(forward)
    for horizon in horizons:
        at, steps, used, converged = descended(at, steps, horizon)
        total += used
        if len(horizons) > 1:
            if horizon <= OPENING:
                worse = 0.0 if horizon == horizons[0] else WORSE
                at = restarts.restart_velocities(forward, noise, at, horizon, steps, worse)
            for _ in range(SWEEPS):
                at = restarts.flip_spins(forward, noise, at, horizon, steps, restarts.SUSPECT)
    return at, steps, total, converged


def with_central_slopes(forward: Forward, noise: Noise, fitted: Fit) -> Fit:
    """Return the fit with slopes, and what follows from them, by central differences."""
    before = forward.rollouts
    at = Estimate(fitted.values, fitted.states)
    linear = linearised_centrally(forward, noise, at, standard_steps(forward, fitted.linear))
    if not np.isfinite(linear.chi2):
        return fitted
    covariance, _ = covariances(forward, linear)
    rollouts = fitted.rollouts + forward.rollouts - before
    return replace(fitted, chi2=linear.chi2, covariance=covariance, linear=linear, rollouts=rollouts)


def collide(design: Design) -> bool:
    """Return whether bodies may collide: a small change then makes another motion. Those that a joint joins do not."""
    world = design.world
    joined = {frozenset((j.object, j.other)) for j in world.joints if j.other is not None and j.kind != "spring"}
    return len(world.objects) * (len(world.objects) - 1) // 2 > len(joined)


def horizons_for(design: Design) -> tuple[float, ...]:
    """Return parts of the runs' time to be fitted one after another: the finer, the more bodies may meet."""
    return thinned(FINE_HORIZONS, design) if collide(design) else HORIZONS


def thinned(horizons: tuple[float, ...], design: Design) -> tuple[float, ...]:
    """Thin out horizons: return all, or for segments with few samples every second to fourth, with the last."""
    if any(r.run.window_of is None for r in design.runs):
        return horizons
    samples = max(len(r.times) for r in design.runs)
    every = min(max(1, round(len(FINE_HORIZONS) * ADDED / samples)), COARSEST)
    return horizons[::-1][::every][::-1]


def start_states(design: Design) -> tuple[Array, ...]:
    """Return initial states as the first samples of each run suggest them."""
    return tuple(r.start for r in design.runs)


def linearise(
    forward: Forward, noise: Noise, values: Array, states: Sequence[Array], fitted: Fit | None = None
) -> Linearised:
    """Whitened residuals and their derivatives by the shared unknowns; those by the states are taken from `fitted`.

    For the score test: states are the fit's own, and the shared unknowns those of an effect that does nothing yet.
    """
    point = Estimate(np.asarray(values, dtype=float), tuple(states))
    shared, own = first_steps(forward)
    if fitted is None:
        return linearised(forward, noise, point, 1.0, (shared, own))
    return linearised_shared(forward, noise, point, fitted.linear.b, shared)


def flip_spins(forward: Forward, noise: Noise, fitted: Fit) -> tuple[Array, ...]:
    """Return initial states from which a fit may come out better: spins that were not measured, tried the other way."""
    at = Estimate(fitted.values, fitted.states)
    return restarts.flip_spins(forward, noise, at, 1.0, standard_steps(forward, fitted.linear), 0.0).states
