"""Runs that no fit follows as a whole, though every window of them is explained: so touchy that they are to be cut."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.predictability import extent_of
from polyworld.estimation.trial import FittedHypothesis
from polyworld.estimation.variable_projection import sensitive
from polyworld.gap.segment_context import SegmentContext

Array = NDArray[np.float64]

TOUCHY = 4.0  # times the extent of the motion, that an ordinary change of the start would move something in it
UNLIKELY = 7.0  # standard deviations of chi2, by which a whole run is worse than its windows beyond what is ordinary
FEW = 0.25  # share of the runs that may be so: where more are, it is the law that lacks something


def sensitive_runs(whole: FittedHypothesis, cut: SegmentContext, on_windows: FittedHypothesis) -> tuple[str, ...]:
    """The names of runs that are lost in a fit of whole runs, where the same hypothesis explains all windows.

    Where bodies collide a whole run can lie in so narrow and bent a valley that no step leads along it. Only runs whose
    motion hangs so much on their start are told, and only few: a law that lacks something shows in most runs.
    """
    design = whole.bench.design
    if whole.passes or not sensitive(design) or not on_windows.passes:
        return ()
    if any(r.run.part_of is not None for r in design.runs):
        return ()  # it was cut before: what still does not fit is not told by cutting ever more
    behind = whole.costs - cut.run_costs(on_windows)
    added = cut.states_added
    lost = behind > np.median(behind) + UNLIKELY * np.sqrt(2.0 * np.maximum(added, 1))
    runs = [r.run for r in design.runs if lost[r.index] and _reach(whole, r.index) > TOUCHY * extent_of(r.run)]
    return tuple(run.name for run in runs) if len(runs) <= max(1, FEW * len(design.runs)) else ()


def _reach(trial: FittedHypothesis, run: int) -> float:
    """How far [m, rad] an ordinary change of a run's start would move anything measured, were it to go on as a small
    one does."""
    own = trial.bench.design.runs[run]
    moved = np.abs(trial.fit.linear.b[run] * own.typical) * trial.bench.noise.sigma[run][:, None]
    return float(moved.max(initial=0.0))
