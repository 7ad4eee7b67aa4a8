"""A world's own best fit to a recording, and the noise as that fit leaves it: what every search starts from."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from polyworld.estimation import profile
from polyworld.estimation.design import Design
from polyworld.estimation.fit_context import FitContext, Fitted, FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.noise import Noise, measured_noise, refined_noise
from polyworld.estimation.refitting import refit_every_run, refit_ill_runs
from polyworld.estimation.settings import REFIT
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.variable_projection import middle, sensitive
from polyworld.gap.settings import BaseSettings

BASE = BaseSettings()


def fitted_base(
    plan: Design,
    base: Sequence[Unknown],
    candidates: int = 1,
    cancelled: Callable[[], bool] | None = None,
    fitted: Fitted | None = None,
) -> FittedHypothesis:
    """Fit initial states and base unknowns over growing horizons, refining the noise by what is left.

    candidates: how many effects a search will choose from. cancelled: asked between batches; where it says so
    `InterruptedError` is raised. fitted: called with each fit, also of those that go on in the context of this one.
    """
    context = FitContext(plan, measured_noise(plan), candidates, cancelled, fitted)
    nothing = Hypothesis(plan.world, tuple(base))
    starts = np.array([u.start for u in base])
    states = profile.start_states(plan)
    horizons = profile.horizons_for(plan)
    if profile.collide(plan):  # from collision to collision, none of which may be missed
        trial = context.fit(nothing, starts, states, horizons=horizons, iterations=BASE.iterations)
        trial = refit_ill_runs(trial)
    else:
        trial = _first(context.fit(nothing, starts, states, horizons=horizons, iterations=BASE.rough))
    trial = with_refined_noise(trial)
    if trial.passes or not any(r.spread.any() for r in plan.runs):
        return trial
    # Spins that were not measured: which way they turn is a choice among many, and more than one way is tried.
    if sensitive(plan) and middle(trial.misfits) < REFIT.explained:
        return with_refined_noise(refit_ill_runs(refit_every_run(trial)))
    turned = profile.flip_spins(trial.context.forward(nothing), trial.context.noise, trial.fit)
    trial = _better(trial, trial.context.fit(nothing, trial.values, turned, iterations=BASE.iterations))
    if trial.passes or profile.collide(plan):
        return trial  # or it was fitted so already
    other = context.fit(nothing, starts, states, horizons=profile.FINE_HORIZONS, iterations=BASE.iterations)
    return _better(trial, with_refined_noise(other))


def _first(trial: FittedHypothesis) -> FittedHypothesis:
    """Return a rough fit taken to the end, or only until it gains little where it is far off."""
    while far_off(trial):
        onward = trial.context.refit(trial, iterations=BASE.rough)
        if not onward.chi2 < BASE.halved * trial.chi2:
            return onward
        trial = onward
    return trial.context.refit(trial, iterations=BASE.iterations)


def far_off(trial: FittedHypothesis) -> bool:
    """Return whether a fit is so far from the data that where exactly it ends means nothing."""
    return trial.chi2 > BASE.far_off * trial.context.observations


def refitted(trial: FittedHypothesis, context: FitContext) -> FittedHypothesis:
    """Continue a fit under a context's noise; hardly so where it is far off."""
    return context.refit(trial, iterations=BASE.barely if far_off(trial) else BASE.refit)


def _better(one: FittedHypothesis, other: FittedHypothesis) -> FittedHypothesis:
    return other if other.chi2 / other.context.observations < one.chi2 / one.context.observations else one


def with_refined_noise(trial: FittedHypothesis) -> FittedHypothesis:
    """Refit the trial under the noise estimated from its own residuals."""
    for _ in range(BASE.refinements):
        before = trial
        noise = refined_noise(trial.context.design, trial.context.noise, trial.context.raw_residuals(trial))
        trial = refitted(trial, trial.context.with_noise(noise))
        if abs(trial.chi2 - before.chi2) < BASE.changed * before.chi2:
            break
    return trial


def differs(one: Noise, other: Noise) -> bool:
    """Return whether two estimates of the noise are so different that fits would weigh the data otherwise."""
    levels = max(float(np.max(np.abs(a / b - 1.0))) for a, b in zip(one.sigma, other.sigma, strict=True))
    linked = max(float(np.max(np.abs(a - b))) for a, b in zip(one.rho, other.rho, strict=True))
    kept = sum(int(np.sum(a != b)) for a, b in zip(one.kept, other.kept, strict=True))
    return levels > BASE.level or linked > BASE.correlation or kept > BASE.outliers * one.count
