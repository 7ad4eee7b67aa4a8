"""Refit runs whose initial state sits in a wrong local minimum, shared values fixed.

A state may have followed a law that lacked something, or a collision that was not, and no slope leads back. With the
law right, few runs fit ill while all others are explained; each of these is fitted again by itself, from the data's own
start or by multistart. Whole fits can be restarted, too, over other segments of the runs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.descent import Estimate
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.forward import Forward
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.settings import REFIT
from polyworld.estimation.variable_projection import best_start_of, middle, profiled, sensitive

Array = NDArray[np.float64]


def refit_ill_runs(trial: FittedHypothesis) -> FittedHypothesis:
    """Refit the runs that fit much worse than the better half, each by itself, and all together where that helped."""
    context = trial.context
    typical = middle(trial.misfits)
    most = _limits(context, typical)
    schedules = [profile.horizons_for(context.design)]
    if profile.collide(context.design) and typical < REFIT.explained:
        schedules.append(profile.thinned(profile.OTHER_HORIZONS, context.design))
    states, costs = list(trial.fit.states), trial.costs
    for horizons in schedules:
        chosen = np.flatnonzero(costs > most)
        if len(chosen):
            _alone(trial, states, costs, chosen, horizons)
    return _carried_on(trial, states)


def refit_every_run(trial: FittedHypothesis) -> FittedHypothesis:
    """Refit every run by multistart at the trial's shared values, conspicuous or not; then all of them together."""
    context, costs, states = trial.context, trial.costs, list(trial.fit.states)
    for run in context.design.runs:
        if run.count:
            way = best_start_of(context, trial.hypothesis, trial.values, run.index, np.inf)
            if way.chi2 < costs[run.index] - 1.0:
                states[run.index] = way.state
    return _carried_on(trial, states)


def restarted(trial: FittedHypothesis, hypothesis: Hypothesis) -> FittedHypothesis:
    """Fit a trial's hypothesis, or the same stepped otherwise, from its values and the data's own starts, over other
    segments of the runs; then with the states of whichever fits a run better. Where bodies collide, as `fit_near`."""
    context = trial.context
    if sensitive(context.design):
        return fit_near(context, hypothesis, trial.values, [profile.start_states(context.design), trial.fit.states])
    states = profile.start_states(context.design)
    again = context.fit(hypothesis, trial.values, states, horizons=profile.FINE_HORIZONS, iterations=REFIT.stepwise)
    again = again if again.fit.converged else context.refit(again)
    return min([again, _crossed(again, trial)], key=lambda t: t.chi2)


def fit_near(
    context: FitContext,
    hypothesis: Hypothesis,
    values: Array,
    starts: Sequence[Sequence[Array]],
    like: FittedHypothesis | None = None,
) -> FittedHypothesis:
    """Fit a hypothesis from shared values that are about right: every run by itself for these, from each of some
    initial states, a little more of it at a time, and where it still fits ill, by multistart; then all together.

    like: the hypothesis fitted from initial states with which a law like it fits; where it passes the gate from there,
    that is all.
    """
    if like is not None and like.passes and not np.any(_ill(like)):
        return profiled(like)
    horizons = profile.horizons_for(context.design)
    together = context.fit(hypothesis, values, starts[0], horizons=horizons, iterations=REFIT.stepwise)
    if together.passes and not np.any(_ill(together)):
        return profiled(together)
    forward = context.forward(hypothesis)
    best, costs = list(starts[0]), np.full(len(context.design.runs), np.inf)
    for states in starts:
        at = Estimate(values, tuple(states))
        at, found = profile.fit_per_run(forward, context.noise, at, horizons=horizons, iterations=REFIT.stepwise)
        for k in np.flatnonzero(found < costs):
            best[k], costs[k] = at.states[k], found[k]
    typical = middle(costs / context.counts)
    limits = _limits(context, typical)
    for k in np.flatnonzero(costs > limits) if typical < REFIT.explained else ():
        if context.design.runs[k].count:
            way = best_start_of(context, hypothesis, values, int(k), float(limits[k]))
            if way.chi2 < costs[k]:
                best[k] = way.state
    return profiled(context.fit(hypothesis, values, best))


def refused_by_most(trial: FittedHypothesis, best: FittedHypothesis) -> bool:
    """Return whether most runs speak against a trial that began where the best ended: no single run is to blame
    then."""
    worse = np.sort(trial.costs - best.costs)
    return 2.0 * float(worse[: (len(worse) + 1) // 2].sum()) > REFIT.behind


def _ill(trial: FittedHypothesis) -> NDArray[np.bool_]:
    """Return runs (R,) that fit much worse than the better half."""
    return trial.costs > _limits(trial.context, middle(trial.misfits))


def _crossed(one: FittedHypothesis, other: FittedHypothesis) -> FittedHypothesis:
    """Return the first of two fits with the other's states for runs that these fit better, fitted on."""
    use = other.misfits < one.misfits
    if not use.any() or use.all():
        return one
    states = [b if taken else a for a, b, taken in zip(one.fit.states, other.fit.states, use, strict=True)]
    values = one.values if one.chi2 < other.chi2 else other.values
    return one.context.fit(one.hypothesis, values, states)


def _carried_on(trial: FittedHypothesis, states: list[Array]) -> FittedHypothesis:
    """Return the trial fitted on from other states, where there are any and that was of use."""
    if all(a is b for a, b in zip(states, trial.fit.states, strict=True)):
        return trial
    return min([trial, trial.context.fit(trial.hypothesis, trial.values, states)], key=lambda t: t.chi2)


def _limits(context: FitContext, typical: float) -> Array:
    """Return chi2 (R,) beyond which runs are ill, where the worst of the better half has `typical` per measurement."""
    counts = context.counts
    if typical < REFIT.explained:
        above = REFIT.unlikely * np.sqrt(2.0 / counts)
        if not profile.collide(context.design):
            above = np.maximum(above, REFIT.odd)
        unlikely: Array = typical * (1.0 + above) * counts
        return unlikely
    worse: Array = max(REFIT.explained, REFIT.worse * typical) * counts
    return worse


def _alone(
    trial: FittedHypothesis, states: list[Array], costs: Array, chosen: NDArray[np.intp], horizons: tuple[float, ...]
) -> None:
    """Fit some runs each by itself; states and chi2 (R,) of those that are the better for it are put in place."""
    context = trial.context
    few, noise = context.design.only(chosen.tolist()), context.noise.only(chosen.tolist())
    world = trial.hypothesis.fitted_world(trial.values)
    forward = Forward(few, world, (), context.cancelled)
    starts = profile.start_states(few)
    found = profile.fit(forward, noise, np.zeros(0), starts, horizons=horizons, iterations=REFIT.iterations)
    context.forward(trial.hypothesis).rollouts += found.rollouts
    for k, own, r in zip(chosen, found.states, found.linear.r, strict=True):
        if float(r @ r) < costs[k] - 1.0:
            states[k], costs[k] = own, float(r @ r)
