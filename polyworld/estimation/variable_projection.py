"""Step shared values with every run's initial state fitted again at each step, where bodies collide.

Behind collisions a small change makes another motion, so that a fit of everything together stops where one run that is
ill-conditioned lies in a narrow valley of its own, however plainly the others ask for other values. Here shared values
take the step that all runs ask for once initial states are projected out (variable projection: Golub & Pereyra 1973,
SIAM J. Numer. Anal. 10, 413), or that all but one ask for; every run follows by itself, and one that gets worse is
fitted by multistart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.descent import Estimate, standard_steps, trial_costs
from polyworld.estimation.design import Design
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.multistart import RunFit, best_of_starts
from polyworld.estimation.normal_equations import within_reach
from polyworld.estimation.per_run_descent import descend_per_run
from polyworld.estimation.score_test import bounded_step
from polyworld.estimation.settings import PROJECTION, REFIT

Array = NDArray[np.float64]


@dataclass
class _Followed:
    """Shared values (S,), states[run] (N,) that have followed them, and chi2 (R,) of the runs there."""

    values: Array
    states: list[Array]
    costs: Array

    def worse(self, before: Array) -> list[int]:
        """Return runs that fit much worse than before."""
        return [int(k) for k in np.flatnonzero(self.costs > before + REFIT.worth)]

    def expected_chi2(self, before: Array, worse: float = 0.0) -> float:
        """Return chi2 if runs that got worse come back to what they were, or to so much more."""
        return float(np.minimum(self.costs, before + worse).sum())


def sensitive(design: Design) -> bool:
    """Return whether bodies may collide, and nothing is coupled to them that would take long."""
    return profile.collide(design) and not design.world.coupled


def profiled(trial: FittedHypothesis) -> FittedHypothesis:
    """Improve a fit by steps of the shared values that initial states follow run by run.

    As it is where bodies do not collide, nothing is shared, or the better half of the runs is far from explained: then
    it is not a run that holds up the others.
    """
    if not len(trial.values) or not sensitive(trial.context.design) or middle(trial.misfits) > PROJECTION.hopeless:
        return trial
    searches = PROJECTION.searches
    for _ in range(PROJECTION.steps):
        before = trial.costs
        if not np.all(np.isfinite(before)):
            return trial
        followed = sorted(
            (_followed(trial, v) for v in asked_for(trial)), key=lambda f: f.expected_chi2(before, REFIT.worth)
        )
        further: FittedHypothesis | None = None
        for one in followed[: PROJECTION.followed]:
            worse = one.worse(before)
            if worse and middle(one.costs / trial.context.counts) > REFIT.explained:
                continue  # it is the law that fails
            if one.expected_chi2(before) < trial.chi2 - PROJECTION.gain and len(worse) <= searches:
                searches -= len(worse)
                _refit(trial, one, worse, before)
                further = _together(trial, one)
            if further is not None:
                break
        if further is None:
            return trial
        trial = further
    return trial


def middle(misfits: Array) -> float:
    """Return the lower median of chi2 per measurement (R,) of the runs; of two runs the better one's."""
    return float(np.sort(misfits)[(len(misfits) - 1) // 2])


def best_start_of(context: FitContext, hypothesis: Hypothesis, values: Array, run: int, below: float) -> RunFit:
    """Fit one run by multistart at shared values (S,); `below` as in `best_of_starts`."""
    world = hypothesis.fitted_world(values, context.design.runs[run].run)
    found = best_of_starts(world, context.design, context.noise, run, below, context.cancelled)
    context.forward(hypothesis).rollouts += found.rollouts
    return found


def asked_for(trial: FittedHypothesis) -> list[Array]:
    """Shared values (S,) that all runs ask for, and that all but one do, where that is something else."""
    slopes, residuals = trial.nuisance.slopes, trial.fit.linear.r
    own = [a.T @ a for a in slopes]
    pull = [a.T @ r for a, r in zip(slopes, residuals, strict=True)]
    errors = np.maximum(np.sqrt(np.maximum(np.diag(trial.fit.covariance), 0.0)), 1e-300)

    def towards(left_out: int | None) -> Array:
        taking_part = [k for k in range(len(own)) if k != left_out]
        information = sum((own[k] for k in taking_part), np.zeros_like(own[0]))
        gradient = sum((pull[k] for k in taking_part), np.zeros_like(pull[0]))
        return trial.values + bounded_step(information, gradient, trial.hypothesis.unknowns, trial.values)

    first = towards(None)
    others = [towards(k) for k in range(len(own))] if len(own) > 1 else []
    others.sort(key=lambda v: -float(np.max(np.abs(v - first) / errors)))
    chosen: list[Array] = []
    for v in (first, *others[: PROJECTION.asked]):
        moved = np.abs(v - trial.values) > PROJECTION.little * errors
        if moved.any() and all(np.any(np.abs(v - c) > PROJECTION.alike * errors) for c in chosen):
            chosen.append(v)
    return chosen


def _followed(trial: FittedHypothesis, values: Array) -> _Followed:
    """Fit every run by itself at other shared values, from where the slopes have it and from where it was."""
    context, linear = trial.context, trial.fit.linear
    forward = context.forward(trial.hypothesis)
    shift = values - trial.values
    predicted = tuple(
        state + within_reach(answer @ (r + a @ shift), own.typical)
        for own, state, answer, r, a in zip(
            context.design.runs, trial.fit.states, trial.nuisance.answers, linear.r, linear.a, strict=True
        )
    )
    steps = standard_steps(forward, linear)
    best = _Followed(values, list(trial.fit.states), np.full(len(linear.r), np.inf))
    for states in (predicted, trial.fit.states):
        at = Estimate(values, states)
        at, *_ = descend_per_run(forward, context.noise, at, 1.0, steps, PROJECTION.iterations, PROJECTION.rough)
        costs = trial_costs(forward, context.noise, [at], 1.0)[0]
        for k in np.flatnonzero(costs < best.costs):
            best.states[k], best.costs[k] = at.states[k], costs[k]
    return best


def _refit(trial: FittedHypothesis, one: _Followed, worse: list[int], before: Array) -> None:
    """Fit runs that got worse by multistart, in place."""
    for k in worse:
        if trial.context.design.runs[k].count:
            found = best_start_of(trial.context, trial.hypothesis, one.values, k, float(before[k]) + PROJECTION.gain)
            if found.chi2 < one.costs[k]:
                one.states[k], one.costs[k] = found.state, found.chi2


def _together(trial: FittedHypothesis, one: _Followed) -> FittedHypothesis | None:
    """Fit all runs together from what was found; None where that is no better."""
    if one.costs.sum() > trial.chi2 - PROJECTION.gain:
        return None
    found = trial.context.fit(trial.hypothesis, one.values, one.states, iterations=PROJECTION.together)
    return found if found.chi2 < trial.chi2 - PROJECTION.gain else None
