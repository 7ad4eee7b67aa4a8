"""A world's own best fit to a recording, and the noise as that fit leaves it: what every search starts from."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from polyworld.estimation import profile
from polyworld.estimation.design import Design
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.noise import measured_noise, refined_noise
from polyworld.estimation.refitting import refit_every_run, refit_ill_runs
from polyworld.estimation.trial import FitContext, FittedHypothesis
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.variable_projection import ILL, middle, sensitive

REFINEMENTS = 2  # of the noise after a fit, each followed by a fit
ITERATIONS = 40  # of the fit that all others begin from
ROUGH_ITERATIONS = 5  # of the same, at each horizon, after which it is seen how far off it is
FAR_OFF = 1000.0  # chi2 per measurement beyond which a fit that has nearly come to rest is left
HALVED = 0.5  # of chi2, that rough iterations have to take off a fit for more of them
REFITTED, LEFT = 12, 2  # iterations of a refit, and of one that is far off
CHANGED = 0.02  # relative change of chi2 below which no further fit is needed


def fitted_base(
    plan: Design, base: Sequence[Unknown], candidates: int = 1, cancelled: Callable[[], bool] | None = None
) -> FittedHypothesis:
    """Fit initial states and base unknowns over growing horizons, refining the noise by what is left.

    candidates: how many effects a search will choose from. cancelled: asked between batches; where it says so
    `InterruptedError` is raised.
    """
    bench = FitContext(plan, measured_noise(plan), candidates, cancelled)
    nothing = Hypothesis(plan.world, tuple(base))
    starts = np.array([u.start for u in base])
    states = profile.start_states(plan)
    horizons = profile.horizons_for(plan)
    if profile.collide(plan):  # from collision to collision, none of which may be missed
        trial = bench.fit(nothing, starts, states, horizons=horizons, iterations=ITERATIONS)
        trial = refit_ill_runs(trial)
    else:
        trial = _first(bench.fit(nothing, starts, states, horizons=horizons, iterations=ROUGH_ITERATIONS))
    trial = with_refined_noise(trial)
    if trial.passes or not any(r.spread.any() for r in plan.runs):
        return trial
    # Spins that were not measured: which way they turn is a choice among many, and more than one way is tried.
    if sensitive(plan) and middle(trial.misfits) < ILL:
        return with_refined_noise(refit_ill_runs(refit_every_run(trial)))
    turned = profile.flip_spins(trial.bench.forward(nothing), trial.bench.noise, trial.fit)
    trial = _better(trial, trial.bench.fit(nothing, trial.values, turned, iterations=ITERATIONS))
    if trial.passes or profile.collide(plan):
        return trial  # or it was fitted so already
    other = bench.fit(nothing, starts, states, horizons=profile.FINE_HORIZONS, iterations=ITERATIONS)
    return _better(trial, with_refined_noise(other))


def _first(trial: FittedHypothesis) -> FittedHypothesis:
    """A rough fit taken to the end, or only until it gains little where it is far off."""
    while far_off(trial):
        onward = trial.bench.refit(trial, iterations=ROUGH_ITERATIONS)
        if not onward.chi2 < HALVED * trial.chi2:
            return onward
        trial = onward
    return trial.bench.refit(trial, iterations=ITERATIONS)


def far_off(trial: FittedHypothesis) -> bool:
    """Whether a fit is so far from the data that where exactly it ends tells nothing."""
    return trial.chi2 > FAR_OFF * trial.bench.observations


def refitted(trial: FittedHypothesis, bench: FitContext) -> FittedHypothesis:
    """A fit carried on under a bench's noise; hardly so where it is far off."""
    return bench.refit(trial, iterations=LEFT if far_off(trial) else REFITTED)


def _better(one: FittedHypothesis, other: FittedHypothesis) -> FittedHypothesis:
    return other if other.chi2 / other.bench.observations < one.chi2 / one.bench.observations else one


def with_refined_noise(trial: FittedHypothesis) -> FittedHypothesis:
    """The trial refitted under the noise that its own residuals tell."""
    for _ in range(REFINEMENTS):
        before = trial
        noise = refined_noise(trial.bench.design, trial.bench.noise, trial.bench.raw_residuals(trial))
        trial = refitted(trial, trial.bench.with_noise(noise))
        if abs(trial.chi2 - before.chi2) < CHANGED * before.chi2:
            break
    return trial
