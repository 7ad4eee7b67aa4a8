"""Runs that a fit has lost: their states were bent to a law that lacked something, or to a collision that was not,
and no slope leads back.

With the law right, few runs fit ill while all others are explained. Each is then fitted anew by itself from the data's
own start, with the shared values kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.discrepancy import profile
from polyworld.discrepancy.forward import Forward
from polyworld.discrepancy.hypothesis import Hypothesis
from polyworld.discrepancy.trial import Trial

Array = NDArray[np.float64]

ILL = 1.5  # chi2 per measurement of a run beyond which it may be lost
WORSE = 3.0  # times the chi2 per measurement of the better half beyond which it is
UNLIKELY = 4.0  # standard deviations of chi2 above that of the better half: where bodies collide, lost already so
ITERATIONS = 12
ANEW_ITERATIONS = 6  # at each of many horizons


def mended(trial: Trial) -> Trial:
    """The trial, with runs that fit much worse than the better half fitted anew, and all of it fitted on where that
    was of use."""
    bench = trial.bench
    misfits = trial.misfits
    middle = float(np.sort(misfits)[(len(misfits) - 1) // 2])  # of two the better one
    lost = misfits > max(ILL, WORSE * middle)
    schedules = [profile.horizons_for(bench.design)]
    if profile.collide(bench.design) and middle < ILL:
        counts = np.array([max(int(kept.sum()), 1) for kept in bench.noise.kept])
        lost = misfits > middle * (1.0 + UNLIKELY * np.sqrt(2.0 / counts))
        schedules.append(profile.OTHER_HORIZONS)
    states: tuple[Array, ...] = trial.fit.states
    for horizons in schedules:
        if lost.any():
            states, better = _alone(trial, states, np.flatnonzero(lost), horizons)
            lost &= ~better
    if all(a is b for a, b in zip(states, trial.fit.states, strict=True)):
        return trial
    again = bench.fit(trial.hypothesis, trial.values, states)
    return min([trial, again], key=lambda t: t.chi2)


def searched(trial: Trial) -> Trial:
    """The trial, with every run fitted anew by itself over other parts of its time: another way past the collisions."""
    every = np.arange(len(trial.bench.design.runs))
    states, better = _alone(trial, trial.fit.states, every, profile.OTHER_HORIZONS)
    if not better.any():
        return trial
    return min([trial, trial.bench.fit(trial.hypothesis, trial.values, states)], key=lambda t: t.chi2)


def anew(trial: Trial, hypothesis: Hypothesis) -> Trial:
    """A trial's hypothesis, or the same stepped otherwise, fitted from its values and the data's own starts, over other
    parts of the runs; then with the states of whichever fits a run better."""
    bench = trial.bench
    horizons = profile.OTHER_HORIZONS if profile.collide(bench.design) else profile.FINE_HORIZONS
    begun = profile.start_states(bench.design)
    again = bench.fit(hypothesis, trial.values, begun, horizons=horizons, iterations=ANEW_ITERATIONS)
    return min([again, _crossed(again, trial)], key=lambda t: t.chi2)


def _crossed(one: Trial, other: Trial) -> Trial:
    """The first of two fits with the other's states for runs that these fit better, fitted on."""
    use = other.misfits < one.misfits
    if not use.any() or use.all():
        return one
    states = [b if taken else a for a, b, taken in zip(one.fit.states, other.fit.states, use, strict=True)]
    values = one.values if one.chi2 < other.chi2 else other.values
    return one.bench.fit(one.hypothesis, values, states)


def _alone(
    trial: Trial, states: Sequence[Array], chosen: NDArray[np.intp], horizons: tuple[float, ...]
) -> tuple[tuple[Array, ...], NDArray[np.bool_]]:
    """States of all runs, those of some as fits of each by itself find them where that is better, and which (R,)."""
    bench = trial.bench
    few, noise = bench.design.only(chosen.tolist()), bench.noise.only(chosen.tolist())
    world = trial.hypothesis.fitted_world(trial.values)
    forward = Forward(few, world, (), bench.cancelled)
    begun = profile.start_states(few)
    found = profile.fit(forward, noise, np.zeros(0), begun, horizons=horizons, iterations=ITERATIONS)
    bench.forward(trial.hypothesis).rollouts += found.rollouts
    better = np.zeros(len(states), dtype=bool)
    kept = list(states)
    for k, own, r in zip(chosen, found.states, found.linear.r, strict=True):
        old = trial.fit.linear.r[k]
        if float(r @ r) < float(old @ old) - 1.0:
            kept[k], better[k] = own, True
    return (tuple(kept) if better.any() else tuple(states)), better
