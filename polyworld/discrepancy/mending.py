"""Runs that a fit has lost: their states were bent to a law that lacked something, or to a collision that was not,
and no slope leads back.

With the law right, few runs fit ill while all others are explained. Each is then fitted anew by itself from the data's
own start, with the shared values kept. And whole fits begun anew, over other parts of the runs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.discrepancy import profile
from polyworld.discrepancy.forward import Forward
from polyworld.discrepancy.hypothesis import Hypothesis
from polyworld.discrepancy.several_ways import best_way
from polyworld.discrepancy.trial import Trial

Array = NDArray[np.float64]

ILL = 1.5  # chi2 per measurement of a run beyond which it may be lost
WORSE = 3.0  # times the chi2 per measurement of the better half beyond which it is, where that is ill too
UNLIKELY = 3.0  # standard deviations of chi2 above that of the better half: lost already so where that is explained
IN_DOUBT = 1.0  # the same where much hangs on one fit: a run may be stuck a little off, too
ODD = 0.25  # of chi2, by which a run has to be above that even if it is long: a law may be a little off
ITERATIONS = 12
ANEW_ITERATIONS = 6  # at each of many horizons


def mended(trial: Trial) -> Trial:
    """The trial, with runs that fit much worse than the better half fitted anew, and all of it fitted on where that
    was of use."""
    bench = trial.bench
    middle = _middle(trial)
    most = _limits(trial, middle)
    schedules = [profile.horizons_for(bench.design)]
    if profile.collide(bench.design) and middle < ILL:
        schedules.append(profile.OTHER_HORIZONS)
    states, costs = list(trial.fit.states), _costs(trial)
    for horizons in schedules:
        chosen = np.flatnonzero(costs > most)
        if len(chosen):
            _alone(trial, states, costs, chosen, horizons)
    return _carried_on(trial, states)


def searched(trial: Trial, level: float = np.inf, doubt: float = UNLIKELY) -> Trial:
    """The trial mended, and where bodies collide with runs that still fit ill fitted along several ways at once.

    level: EBIC above which the trial is of no interest even if such runs came to fit as well as any does. doubt:
    standard deviations of chi2 above that of the better half, beyond which a run is ill.
    """
    trial = mended(trial)
    bench = trial.bench
    middle = _middle(trial)
    if not profile.collide(bench.design) or middle >= ILL:
        return trial
    if bench.design.world.coupled:  # so many rollouts would take too long
        return trial
    states, costs = list(trial.fit.states), _costs(trial)
    limits = _limits(trial, middle, doubt)
    ill = [k for k in np.flatnonzero(costs > limits) if bench.design.runs[k].count]
    hoped = np.minimum(costs, _limits(trial, middle, -UNLIKELY))
    if float(hoped.sum()) + trial.ebic - trial.chi2 > level:
        return trial
    world = trial.hypothesis.fitted_world(trial.values)
    for k in ill:
        way = best_way(world, bench.design, bench.noise, int(k), float(limits[k]), bench.cancelled)
        bench.forward(trial.hypothesis).rollouts += way.rollouts
        if way.chi2 < costs[k] - 1.0:
            states[k] = way.state
    return _carried_on(trial, states)


def anew(trial: Trial, hypothesis: Hypothesis) -> Trial:
    """A trial's hypothesis, or the same stepped otherwise, fitted from its values and the data's own starts, over other
    parts of the runs; then with the states of whichever fits a run better."""
    bench = trial.bench
    horizons = profile.OTHER_HORIZONS if profile.collide(bench.design) else profile.FINE_HORIZONS
    begun = profile.start_states(bench.design)
    again = bench.fit(hypothesis, trial.values, begun, horizons=horizons, iterations=ANEW_ITERATIONS)
    again = again if again.fit.converged else bench.refit(again)
    return min([again, _crossed(again, trial)], key=lambda t: t.chi2)


def _crossed(one: Trial, other: Trial) -> Trial:
    """The first of two fits with the other's states for runs that these fit better, fitted on."""
    use = other.misfits < one.misfits
    if not use.any() or use.all():
        return one
    states = [b if taken else a for a, b, taken in zip(one.fit.states, other.fit.states, use, strict=True)]
    values = one.values if one.chi2 < other.chi2 else other.values
    return one.bench.fit(one.hypothesis, values, states)


def _carried_on(trial: Trial, states: list[Array]) -> Trial:
    """The trial fitted on from other states, where there are any and that was of use."""
    if all(a is b for a, b in zip(states, trial.fit.states, strict=True)):
        return trial
    return min([trial, trial.bench.fit(trial.hypothesis, trial.values, states)], key=lambda t: t.chi2)


def _middle(trial: Trial) -> float:
    """chi2 per measurement of the worst run of the better half; of two the better one."""
    return float(np.sort(trial.misfits)[(len(trial.misfits) - 1) // 2])


def _limits(trial: Trial, middle: float, doubt: float = UNLIKELY) -> Array:
    """chi2 (R,) beyond which runs may be lost."""
    counts = np.array([max(int(kept.sum()), 1) for kept in trial.bench.noise.kept])
    if middle < ILL:
        above = doubt * np.sqrt(2.0 / counts)
        if not profile.collide(trial.bench.design):
            above = np.maximum(above, ODD)
        unlikely: Array = middle * (1.0 + above) * counts
        return unlikely
    worse: Array = max(ILL, WORSE * middle) * counts
    return worse


def _costs(trial: Trial) -> Array:
    """chi2 (R,) of each run."""
    return np.array([float(r @ r) for r in trial.fit.linear.r])


def _alone(
    trial: Trial, states: list[Array], costs: Array, chosen: NDArray[np.intp], horizons: tuple[float, ...]
) -> None:
    """Fit some runs each by itself; states and chi2 (R,) of those that are the better for it are put in place."""
    bench = trial.bench
    few, noise = bench.design.only(chosen.tolist()), bench.noise.only(chosen.tolist())
    world = trial.hypothesis.fitted_world(trial.values)
    forward = Forward(few, world, (), bench.cancelled)
    begun = profile.start_states(few)
    found = profile.fit(forward, noise, np.zeros(0), begun, horizons=horizons, iterations=ITERATIONS)
    bench.forward(trial.hypothesis).rollouts += found.rollouts
    for k, own, r in zip(chosen, found.states, found.linear.r, strict=True):
        if float(r @ r) < costs[k] - 1.0:
            states[k], costs[k] = own, float(r @ r)
