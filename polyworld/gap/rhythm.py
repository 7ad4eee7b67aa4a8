"""Find the frequencies of residuals, where fits of a forcing begin: a least-squares spectrum (Lomb 1976)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from polyworld.effects.absence import MOST_FREQUENCIES
from polyworld.estimation.candidate import Variant
from polyworld.estimation.fit_context import FitContext, FittedHypothesis

Array = NDArray[np.float64]

OVERSAMPLING = 4.0  # frequencies for each that a run resolves: between two of them no line loses a tenth of its power
MOST = 4096  # frequencies, whose cost grows with their number
BATCH = 256  # at a time, for the memory
FIRST = 6  # frequencies that fits begin at, beside those of the grid


def rhythm_starts(
    frequency: str, context: FitContext, trial: FittedHypothesis, variant: Variant
) -> tuple[Mapping[str, float], ...]:
    """Return starts at the frequencies at which residuals swing most, where those of the grid are too far apart, or
    end.

    frequency: the unknown that is one; the others that starts of the grid differ in are tried with each.
    """
    grid = sorted({start[frequency] for start in variant.starts})
    if len(grid) < MOST_FREQUENCIES:
        return ()
    highest = next(u.upper for u in variant.unknowns if u.name == frequency)
    others = [start for start in variant.starts if start[frequency] == grid[0]]
    return tuple({**start, frequency: f} for f in rhythms(context, trial, grid[0], highest, FIRST) for start in others)


def rhythms(context: FitContext, trial: FittedHypothesis, low: float, high: float, count: int) -> tuple[float, ...]:
    """Find the `count` frequencies [Hz] from low to high that explain most of a fit's position residuals.

    One oscillation at all times and in all runs (the clock is the recording's) along each axis, beside what initial
    states can take up: a least-squares spectrum (Lomb 1976, Astrophys. Space Sci. 39, 447), whitened as the fit was. A
    forcing moves a free body so, and any other at the same frequency once its own motion has died down.
    """
    runs = context.design.runs
    first = min(float(r.run.times[0]) for r in runs)
    spans: dict[str, list[float]] = {}
    for r in runs:
        spans.setdefault(r.run.part_of or r.run.name, []).extend((float(r.run.times[0]), float(r.run.times[-1])))
    span = max(max(s) - min(s) for s in spans.values())
    number = int(np.clip(np.ceil((high - low) * span * OVERSAMPLING), 2, MOST))
    frequencies = np.linspace(low, high, number)
    gain = np.concatenate([_gains(context, trial, frequencies[k : k + BATCH], first) for k in range(0, number, BATCH)])
    chosen: list[float] = []
    for k in np.argsort(-gain, kind="stable"):
        if all(abs(frequencies[k] - f) >= 1.0 / span for f in chosen):
            chosen.append(float(frequencies[k]))
        if len(chosen) == count:
            break
    return tuple(chosen)


def _gains(context: FitContext, trial: FittedHypothesis, frequencies: Array, first: float) -> Array:
    """Predict the fall (K,) of chi2 for an oscillation of each frequency (K,)."""
    k = len(frequencies)
    gain = np.zeros(k)
    for axis in range(3):
        gradient, information = np.zeros((k, 2)), np.zeros((k, 2, 2))
        for r in context.design.runs:
            wave = np.zeros((k, 2, r.length))
            for s in r.series:
                if s.kind == "position" and s.axis == axis:
                    angle = 2.0 * np.pi * frequencies[:, None] * (r.run.times[s.rows] - first)
                    wave[:, 0, s.where], wave[:, 1, s.where] = np.sin(angle), np.cos(angle)
            if not wave.any():
                continue
            slopes = trial.nuisance.off(r.index, context.noise.whiten(r.index, wave))
            rest = trial.nuisance.off(r.index, trial.fit.linear.r[r.index])
            gradient += slopes @ rest
            information += slopes @ np.swapaxes(slopes, 1, 2)
        inverse = np.linalg.pinv(information, rcond=1e-9, hermitian=True)
        gain += np.einsum("ki,kij,kj->k", gradient, inverse, gradient)
    return gain
