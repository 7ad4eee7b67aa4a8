"""Runs that a fit has lost: their states were bent to a law that lacked something, or to a collision that was not,
and no slope leads back.

With the law right, few runs fit ill while all others are explained. Each is then fitted anew by itself from the data's
own start, with the shared values kept. And whole fits begun anew, over other parts of the runs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.descent import Point
from polyworld.estimation.forward import Forward
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.trial import FitContext, FittedHypothesis
from polyworld.estimation.variable_projection import ILL, best_start_of, middle, profiled, sensitive

Array = NDArray[np.float64]

WORSE = 3.0  # times the chi2 per measurement of the better half beyond which it is, where that is ill too
UNLIKELY = 3.0  # standard deviations of chi2 above that of the better half: lost already so where that is explained
ODD = 0.25  # of chi2, by which a run has to be above that even if it is long: a law may be a little off
BEHIND = 50.0  # chi2 by which the better half of the runs, taken twice, may be behind the best's where some were lost
ITERATIONS = 12
ANEW_ITERATIONS = 6  # at each of many horizons


def refit_ill_runs(trial: FittedHypothesis) -> FittedHypothesis:
    """The trial, with runs that fit much worse than the better half fitted anew, and all of it fitted on where that
    was of use."""
    bench = trial.bench
    typical = middle(trial.misfits)
    most = _limits(bench, typical)
    schedules = [profile.horizons_for(bench.design)]
    if profile.collide(bench.design) and typical < ILL:
        schedules.append(profile.thinned(profile.OTHER_HORIZONS, bench.design))
    states, costs = list(trial.fit.states), trial.costs
    for horizons in schedules:
        chosen = np.flatnonzero(costs > most)
        if len(chosen):
            _alone(trial, states, costs, chosen, horizons)
    return _carried_on(trial, states)


def refit_every_run(trial: FittedHypothesis) -> FittedHypothesis:
    """Refit every run by multistart at the trial's shared values, conspicuous or not; then all of them together."""
    bench, costs, states = trial.bench, trial.costs, list(trial.fit.states)
    for run in bench.design.runs:
        if run.count:
            way = best_start_of(bench, trial.hypothesis, trial.values, run.index, np.inf)
            if way.chi2 < costs[run.index] - 1.0:
                states[run.index] = way.state
    return _carried_on(trial, states)


def restarted(trial: FittedHypothesis, hypothesis: Hypothesis) -> FittedHypothesis:
    """A trial's hypothesis, or the same stepped otherwise, fitted from its values and the data's own starts, over other
    parts of the runs; then with the states of whichever fits a run better. Where bodies collide, `begun`."""
    bench = trial.bench
    if sensitive(bench.design):
        return fit_near(bench, hypothesis, trial.values, [profile.start_states(bench.design), trial.fit.states])
    states = profile.start_states(bench.design)
    again = bench.fit(hypothesis, trial.values, states, horizons=profile.FINE_HORIZONS, iterations=ANEW_ITERATIONS)
    again = again if again.fit.converged else bench.refit(again)
    return min([again, _crossed(again, trial)], key=lambda t: t.chi2)


def fit_near(
    bench: FitContext,
    hypothesis: Hypothesis,
    values: Array,
    starts: Sequence[Sequence[Array]],
    like: FittedHypothesis | None = None,
) -> FittedHypothesis:
    """A hypothesis fitted from shared values that are about right: every run by itself for these, from each of some
    initial states, a little more of it at a time, and where it is lost still, along several ways; then all of it.

    like: the hypothesis fitted from initial states with which a law like it fits; where it passes the gate from there,
    that is all.
    """
    if like is not None and like.passes and not np.any(_lost(like)):
        return profiled(like)
    horizons = profile.horizons_for(bench.design)
    together = bench.fit(hypothesis, values, starts[0], horizons=horizons, iterations=ANEW_ITERATIONS)
    if together.passes and not np.any(_lost(together)):
        return profiled(together)
    forward = bench.forward(hypothesis)
    best, costs = list(starts[0]), np.full(len(bench.design.runs), np.inf)
    for states in starts:
        at = Point(values, tuple(states))
        at, found = profile.fit_per_run(forward, bench.noise, at, horizons=horizons, iterations=ANEW_ITERATIONS)
        for k in np.flatnonzero(found < costs):
            best[k], costs[k] = at.states[k], found[k]
    typical = middle(costs / bench.counts)
    limits = _limits(bench, typical)
    for k in np.flatnonzero(costs > limits) if typical < ILL else ():
        if bench.design.runs[k].count:
            way = best_start_of(bench, hypothesis, values, int(k), float(limits[k]))
            if way.chi2 < costs[k]:
                best[k] = way.state
    return profiled(bench.fit(hypothesis, values, best))


def refused_by_most(trial: FittedHypothesis, best: FittedHypothesis) -> bool:
    """Whether most runs speak against a trial that began where the best ended: no run that is lost is to blame then."""
    worse = np.sort(trial.costs - best.costs)
    return 2.0 * float(worse[: (len(worse) + 1) // 2].sum()) > BEHIND


def _lost(trial: FittedHypothesis) -> NDArray[np.bool_]:
    """Runs (R,) that fit much worse than the better half."""
    return trial.costs > _limits(trial.bench, middle(trial.misfits))


def _crossed(one: FittedHypothesis, other: FittedHypothesis) -> FittedHypothesis:
    """The first of two fits with the other's states for runs that these fit better, fitted on."""
    use = other.misfits < one.misfits
    if not use.any() or use.all():
        return one
    states = [b if taken else a for a, b, taken in zip(one.fit.states, other.fit.states, use, strict=True)]
    values = one.values if one.chi2 < other.chi2 else other.values
    return one.bench.fit(one.hypothesis, values, states)


def _carried_on(trial: FittedHypothesis, states: list[Array]) -> FittedHypothesis:
    """The trial fitted on from other states, where there are any and that was of use."""
    if all(a is b for a, b in zip(states, trial.fit.states, strict=True)):
        return trial
    return min([trial, trial.bench.fit(trial.hypothesis, trial.values, states)], key=lambda t: t.chi2)


def _limits(bench: FitContext, typical: float) -> Array:
    """chi2 (R,) beyond which runs may be lost, where the worst of the better half has `typical` per measurement."""
    counts = bench.counts
    if typical < ILL:
        above = UNLIKELY * np.sqrt(2.0 / counts)
        if not profile.collide(bench.design):
            above = np.maximum(above, ODD)
        unlikely: Array = typical * (1.0 + above) * counts
        return unlikely
    worse: Array = max(ILL, WORSE * typical) * counts
    return worse


def _alone(
    trial: FittedHypothesis, states: list[Array], costs: Array, chosen: NDArray[np.intp], horizons: tuple[float, ...]
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
