"""Runs that a fit has lost: their states were bent to a law that lacked something, or to a collision that was not,
and no slope leads back.

With the law right, few runs fit ill while all others are explained. Each is then fitted anew by itself from the data's
own start, with the shared values kept. And whole fits begun anew, over other parts of the runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.descent import Point
from polyworld.estimation.forward import Forward
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.settings import GATE, REFIT
from polyworld.estimation.trial import FitContext, FittedHypothesis
from polyworld.estimation.variable_projection import best_start_of, middle, profiled, sensitive

Array = NDArray[np.float64]


def refit_ill_runs(trial: FittedHypothesis) -> FittedHypothesis:
    """The trial, with runs that fit much worse than the better half fitted anew, and all of it fitted on where that
    was of use."""
    bench = trial.bench
    typical = middle(trial.misfits)
    most = _limits(bench, typical)
    schedules = [profile.horizons_for(bench.design)]
    if profile.collide(bench.design) and typical < REFIT.explained:
        schedules.append(profile.thinned(profile.OTHER_HORIZONS, bench.design))
    states, costs = list(trial.fit.states), trial.costs
    for horizons in schedules:
        chosen = np.flatnonzero(costs > most)
        if len(chosen):
            _alone(trial, states, costs, chosen, horizons)
    return _carried_on(trial, states)


def refit_by_multistart(
    trial: FittedHypothesis, level: float = np.inf, doubt: float = REFIT.unlikely
) -> FittedHypothesis:
    """The trial mended, and where bodies collide with runs that still fit ill fitted along several ways at once.

    level: EBIC above which the trial is of no interest even if such runs came to fit as well as any does. doubt:
    standard deviations of chi2 above that of the better half, beyond which a run is ill.
    """
    trial = refit_ill_runs(trial)
    bench = trial.bench
    typical = middle(trial.misfits)
    if not sensitive(bench.design) or typical >= REFIT.explained:
        return trial
    costs = trial.costs
    limits = _limits(bench, typical, doubt)
    hoped = np.minimum(costs, _limits(bench, typical, -REFIT.unlikely))
    if float(hoped.sum()) + trial.ebic - trial.chi2 > level:
        return trial
    ill = {int(k): float(limits[k]) for k in np.flatnonzero(costs > limits)}
    trial, asked = _by_other_ways(trial, ill)
    while not trial.passes and (blamed := _blamed(trial)) is not None and blamed not in asked:
        before = trial
        trial, more = _by_other_ways(trial, {blamed: float(trial.costs[blamed]) - REFIT.worth})
        if trial is before:
            break
        asked |= more
    return trial


def refit_every_run(trial: FittedHypothesis) -> FittedHypothesis:
    """The trial, with every run fitted along several ways, whether or not it is conspicuous."""
    return _by_other_ways(trial, dict.fromkeys(range(len(trial.bench.design.runs)), np.inf))[0]


def _blamed(trial: FittedHypothesis) -> int | None:
    """The run of the series that fits worst, where that alone would fail the gate: it may be stuck where no chi2 is
    conspicuous."""
    worst = trial.goodness.worst
    if worst is None or GATE.tests * worst.p * len(trial.goodness.series) > GATE.level:
        return None
    return next(r.index for r in trial.bench.design.runs if r.run.name == worst.run)


def _by_other_ways(trial: FittedHypothesis, runs: Mapping[int, float]) -> tuple[FittedHypothesis, set[int]]:
    """The trial, with some runs fitted along several ways at its shared values, each until its chi2 is below a level,
    and all of it fitted on where that was of use; and which runs were looked for: the worst come first, and a few that
    come not even halfway there end it."""
    bench, costs, states = trial.bench, trial.costs, list(trial.fit.states)
    asked: set[int] = set()
    vain = 0
    for k in sorted(runs, key=lambda k: runs[k] - costs[k]):
        if bench.design.runs[k].count and vain < REFIT.vain:
            way = best_start_of(bench, trial.hypothesis, trial.values, k, runs[k])
            asked.add(k)
            vain += way.chi2 > max(runs[k], 0.5 * (runs[k] + costs[k]))
            if way.chi2 < costs[k] - 1.0:
                states[k] = way.state
    return _carried_on(trial, states), asked


def restarted(trial: FittedHypothesis, hypothesis: Hypothesis) -> FittedHypothesis:
    """A trial's hypothesis, or the same stepped otherwise, fitted from its values and the data's own starts, over other
    parts of the runs; then with the states of whichever fits a run better. Where bodies collide, `begun`."""
    bench = trial.bench
    if sensitive(bench.design):
        return fit_near(bench, hypothesis, trial.values, [profile.start_states(bench.design), trial.fit.states])
    states = profile.start_states(bench.design)
    again = bench.fit(hypothesis, trial.values, states, horizons=profile.FINE_HORIZONS, iterations=REFIT.stepwise)
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
    together = bench.fit(hypothesis, values, starts[0], horizons=horizons, iterations=REFIT.stepwise)
    if together.passes and not np.any(_lost(together)):
        return profiled(together)
    forward = bench.forward(hypothesis)
    best, costs = list(starts[0]), np.full(len(bench.design.runs), np.inf)
    for states in starts:
        at = Point(values, tuple(states))
        at, found = profile.fit_per_run(forward, bench.noise, at, horizons=horizons, iterations=REFIT.stepwise)
        for k in np.flatnonzero(found < costs):
            best[k], costs[k] = at.states[k], found[k]
    typical = middle(costs / bench.counts)
    limits = _limits(bench, typical)
    for k in np.flatnonzero(costs > limits) if typical < REFIT.explained else ():
        if bench.design.runs[k].count:
            way = best_start_of(bench, hypothesis, values, int(k), float(limits[k]))
            if way.chi2 < costs[k]:
                best[k] = way.state
    return profiled(bench.fit(hypothesis, values, best))


def refused_by_most(trial: FittedHypothesis, best: FittedHypothesis) -> bool:
    """Whether most runs speak against a trial that began where the best ended: no run that is lost is to blame then."""
    worse = np.sort(trial.costs - best.costs)
    return 2.0 * float(worse[: (len(worse) + 1) // 2].sum()) > REFIT.behind


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


def _limits(bench: FitContext, typical: float, doubt: float = REFIT.unlikely) -> Array:
    """chi2 (R,) beyond which runs may be lost, where the worst of the better half has `typical` per measurement."""
    counts = bench.counts
    if typical < REFIT.explained:
        above = doubt * np.sqrt(2.0 / counts)
        if not profile.collide(bench.design):
            above = np.maximum(above, REFIT.odd)
        unlikely: Array = typical * (1.0 + above) * counts
        return unlikely
    worse: Array = max(REFIT.explained, REFIT.worse * typical) * counts
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
    found = profile.fit(forward, noise, np.zeros(0), begun, horizons=horizons, iterations=REFIT.iterations)
    bench.forward(trial.hypothesis).rollouts += found.rollouts
    for k, own, r in zip(chosen, found.states, found.linear.r, strict=True):
        if float(r @ r) < costs[k] - 1.0:
            states[k], costs[k] = own, float(r @ r)
