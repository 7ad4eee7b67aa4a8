"""Hypotheses fitted to segments of the runs, and what whole runs take over from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.fit_context import FitContext, FittedHypothesis, Start
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.refitting import refit_ill_runs
from polyworld.estimation.segments import Segments, segments

Array = NDArray[np.float64]

BASE_ITERATIONS = 8


@dataclass(frozen=True)
class SegmentContext:
    """The segments of a design, and the context in which hypotheses are fitted to them."""

    context: FitContext
    segments: Segments

    def holds(self, hypothesis: Hypothesis) -> bool:
        """Return whether a hypothesis can be fitted to segments: a body that was added and is not seen starts where a
        run does, and so does a clock that slips within one."""
        return {o.name for o in hypothesis.world.objects} == {o.name for o in self.context.design.world.objects} and (
            hypothesis.world.observer is None or hypothesis.world.observer.shift_run is None
        )

    def fit_base(self, hypothesis: Hypothesis, values: Array) -> FittedHypothesis:
        """Fit a hypothesis to the segments from the data's own starts; refit those that fit ill, which would hide what
        others show."""
        found = self.context.fit(
            hypothesis,
            values,
            profile.start_states(self.context.design),
            horizons=profile.horizons_for(self.context.design),
            iterations=BASE_ITERATIONS,
        )
        return refit_ill_runs(found) if profile.collide(self.context.design) else found

    def run_costs(self, trial: FittedHypothesis) -> Array:
        """Return chi2 (R,) of all segments of each whole run."""
        return self.segments.per_run(trial.costs)

    @property
    def states_added(self) -> NDArray[np.int64]:
        """How many initial-state coordinates (R,) more the segments of each whole run have than the run itself."""
        return self.segments.states_added

    def start(self, fit: profile.Fit) -> Start:
        """Return where a fit to whole runs begins: the shared values, and the states of the first segments."""
        return Start(fit.values, self.segments.states_of_runs(fit.states))


def segment_context(context: FitContext, pieces: int) -> SegmentContext | None:
    """Cut every run into at most so many segments; None where that cannot be."""
    cut = segments(context.design, pieces)
    if cut is None:
        return None
    return SegmentContext(FitContext(cut.parts, measured_noise(cut.parts), context.candidates, context.cancelled), cut)
