"""On top of which hypotheses a further effect is tried."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld.estimation.trial import FittedHypothesis
from polyworld.gap.predicted_gains import identity
from polyworld.gap.window_search import WindowSearch

SAME_PATH = 0.05  # of chi2, by which the residuals of two parents differ if they are names for the same motion


def nearest(ranked: Sequence[FittedHypothesis], on_windows: WindowSearch | None, count: int) -> list[FittedHypothesis]:
    """The first `count` of hypotheses of equally many effects, and the one that leads on windows.

    Over whole runs what is still missing adds up, and a wrong effect that happens to bend paths alike comes nearer than
    a right one beside which another lacks.
    """
    chosen = list(ranked[:count])
    if on_windows is None or not ranked:
        return chosen
    there = {identity(t.hypothesis): t for t in ranked}
    led = [t for key, t in on_windows.trials.items() if key in there]
    if led:
        leader = there[identity(min(led, key=lambda t: t.ebic).hypothesis)]
        if leader not in chosen:
            chosen.append(leader)
    return chosen


def unlike(parents: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
    """The parents less those that leave nearly the same residuals as one before them: another name for it."""
    kept: list[FittedHypothesis] = []
    for trial in parents:
        if not any(_apart(trial, other) < SAME_PATH * min(trial.chi2, other.chi2) for other in kept):
            kept.append(trial)
    return kept


def _apart(one: FittedHypothesis, other: FittedHypothesis) -> float:
    return sum(float(np.sum((a - b) ** 2)) for a, b in zip(one.fit.linear.r, other.fit.linear.r, strict=True))
