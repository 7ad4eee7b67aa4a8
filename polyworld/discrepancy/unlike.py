"""Hypotheses that are names for the same motion: a further effect on top of each would be tried twice."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld.discrepancy.trial import Trial

SAME_PATH = 0.05  # of chi2, by which the residuals of two parents differ if they are names for the same motion


def unlike(parents: Sequence[Trial]) -> list[Trial]:
    """The parents less those that leave nearly the same residuals as one before them: another name for it."""
    kept: list[Trial] = []
    for trial in parents:
        if not any(_apart(trial, other) < SAME_PATH * min(trial.chi2, other.chi2) for other in kept):
            kept.append(trial)
    return kept


def _apart(one: Trial, other: Trial) -> float:
    return sum(float(np.sum((a - b) ** 2)) for a, b in zip(one.fit.linear.r, other.fit.linear.r, strict=True))
