"""Find runs that no fit follows as a whole, though all their segments are explained: sensitive ones, to be cut."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.predictability import extent_of
from polyworld.estimation.variable_projection import sensitive
from polyworld.gap.segment_context import SegmentContext

Array = NDArray[np.float64]

SENSITIVE = 4.0  # times the extent of the motion, that an ordinary change of the start would move something in it
UNLIKELY = 7.0  # standard deviations of chi2, by which a whole run is worse than its segments beyond what is ordinary
FEW = 0.25  # share of the runs that may be so: where more are, it is the law that lacks something


def sensitive_runs(whole: FittedHypothesis, cut: SegmentContext, on_segments: FittedHypothesis) -> tuple[str, ...]:
    """Return the runs that a fit of whole runs does not follow, where the same hypothesis explains all segments.

    Where bodies collide a whole run can lie in so narrow and bent a valley that no step leads along it. Only runs whose
    motion is so sensitive to their start are returned, and only few: a law that lacks something shows in most runs.
    """
    design = whole.context.design
    if whole.passes or not sensitive(design) or not on_segments.passes:
        return ()
    if any(r.run.part_of is not None for r in design.runs):
        return ()  # it was cut before: cutting ever more shows nothing
    behind = whole.costs - cut.run_costs(on_segments)
    added = cut.states_added
    worse = behind > np.median(behind) + UNLIKELY * np.sqrt(2.0 * np.maximum(added, 1))
    runs = [r.run for r in design.runs if worse[r.index] and _reach(whole, r.index) > SENSITIVE * extent_of(r.run)]
    return tuple(run.name for run in runs) if len(runs) <= max(1, FEW * len(design.runs)) else ()


def _reach(trial: FittedHypothesis, run: int) -> float:
    """Return how far [m, rad] an ordinary change of a run's start would move anything measured, were it to go on as a
    small one does."""
    own = trial.context.design.runs[run]
    moved = np.abs(trial.fit.linear.b[run] * own.typical) * trial.context.noise.sigma[run][:, None]
    return float(moved.max(initial=0.0))
