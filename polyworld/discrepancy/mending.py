"""Runs that a fit has lost: their states were bent to a law that lacked something, and no slope leads back.

With the law right, few runs fit ill while all others are explained. Each is then fitted anew by itself from the data's
own start, with the shared values kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.discrepancy import profile
from polyworld.discrepancy.forward import Forward
from polyworld.discrepancy.trial import Trial

Array = NDArray[np.float64]

ILL = 1.5  # chi2 per measurement of a run beyond which it may be lost
WORSE = 3.0  # times the chi2 per measurement of the better half beyond which it is
ITERATIONS = 12


def mended(trial: Trial) -> Trial:
    """The trial, with runs that fit much worse than the better half fitted anew, and all of it fitted on where that
    was of use."""
    bench = trial.bench
    misfits = trial.misfits
    middle = float(np.sort(misfits)[(len(misfits) - 1) // 2])  # of two the better one
    lost = np.flatnonzero(misfits > max(ILL, WORSE * middle))
    if not len(lost):
        return trial
    few, noise = bench.design.only(lost.tolist()), bench.noise.only(lost.tolist())
    world = trial.hypothesis.fitted_world(trial.values)
    forward = Forward(few, world, (), bench.cancelled)
    horizons = profile.horizons_for(bench.design)
    found = profile.fit(
        forward, noise, np.zeros(0), profile.start_states(few), horizons=horizons, iterations=ITERATIONS
    )
    bench.forward(trial.hypothesis).rollouts += found.rollouts
    states = list(trial.fit.states)
    before = [trial.fit.linear.r[k] for k in lost]
    better = [float(r @ r) < float(old @ old) - 1.0 for old, r in zip(before, found.linear.r, strict=True)]
    if not any(better):
        return trial
    for k, own, use in zip(lost, found.states, better, strict=True):
        states[k] = own if use else states[k]
    return bench.fit(trial.hypothesis, trial.values, states)
