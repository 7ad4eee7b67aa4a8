"""Runs cut into windows, each with an initial state of its own: where a model that lacks something stays near the data.

Multiple shooting (Bock 1983, in Numerical Treatment of Inverse Problems, p. 95) without conditions of continuity. Over
a whole run a missing effect adds up, and behind a few bounces the slopes foretell nothing; over a window it does not.
Values of shared unknowns that fit the windows, and the states of the first ones, are where fits of whole runs begin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.design import Design, RunDesign, design
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.mending import searched
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.parts import FEWEST, is_seen, roughness, smooth_near, starts_anywhere
from polyworld.estimation.score_test import ScoreTestStart
from polyworld.estimation.trial import FitContext, FittedHypothesis, Start
from polyworld.recording import Recording, Run

Array = NDArray[np.float64]

LONG_RUN = 512  # samples of a run; one that is so many times as long is cut into so many times the windows
GROUND_ITERATIONS = 8


class Windows:
    """Hypotheses fitted to the windows of a design."""

    def __init__(self, bench: FitContext, plan: Design, first: tuple[int, ...]) -> None:
        self.bench = FitContext(plan, measured_noise(plan), bench.candidates, bench.cancelled)
        self._runs = bench.design.runs
        self._first = first
        self._recording = bench.design.recording

    def holds(self, hypothesis: Hypothesis) -> bool:
        """Whether a hypothesis can be fitted to windows: a body that was added and is not seen starts where a run does,
        and so does a clock that slips within one."""
        return {o.name for o in hypothesis.world.objects} == {o.name for o in self.bench.design.world.objects} and (
            hypothesis.world.observer is None or hypothesis.world.observer.shift_run is None
        )

    def ground(self, hypothesis: Hypothesis, values: Array) -> FittedHypothesis:
        """A hypothesis fitted to the windows from the data's own starts; those that are lost, along several ways: they
        would hide what others tell."""
        found = self.bench.fit(
            hypothesis,
            values,
            profile.start_states(self.bench.design),
            horizons=profile.horizons_for(self.bench.design),
            iterations=GROUND_ITERATIONS,
        )
        return searched(found) if profile.collide(self.bench.design) else found

    def nearest(self, ways: Sequence[tuple[FittedHypothesis, ScoreTestStart]]) -> tuple[Hypothesis, Start]:
        """Of leads to one hypothesis, as the score test foretells or not yet moved, the one nearest to the data: with
        the parent's states, or in each window where that is nearer, those that the data's first samples tell."""
        _, hypothesis, start = self._nearest(ways)
        return hypothesis, start

    def seen(self, parent: FittedHypothesis, lead: ScoreTestStart) -> ScoreTestStart:
        """A lead with the chi2 that it has there, if that is less than what the slope foretells: of a wall that the
        path has not come to, no slope tells."""
        return replace(lead, chi2=min(lead.chi2, self._nearest([(parent, lead)])[0]))

    def _nearest(self, ways: Sequence[tuple[FittedHypothesis, ScoreTestStart]]) -> tuple[float, Hypothesis, Start]:
        """As `nearest`, with the chi2 there."""
        data = profile.start_states(self.bench.design)
        found: list[tuple[float, Hypothesis, Start]] = []
        for parent, lead in ways:
            for values in (lead.values,) if lead.before is None else (lead.values, lead.before):
                both = (parent.fit.states, data)
                costs = self.bench.run_costs(lead.hypothesis, [Start(values, states) for states in both])
                states = tuple(both[k][i] for i, k in enumerate(np.argmin(costs, axis=0)))
                found.append((float(costs.min(axis=0).sum()), lead.hypothesis, Start(values, states)))
        return min(found, key=lambda f: f[0])

    def run_costs(self, trial: FittedHypothesis) -> Array:
        """chi2 (R,) of all windows of each whole run."""
        return np.add.reduceat(trial.costs, self._first)

    @property
    def states_added(self) -> NDArray[np.int64]:
        """How many initial-state coordinates (R,) more the windows of each whole run have than the run itself."""
        counts = np.add.reduceat([r.count for r in self.bench.design.runs], self._first)
        return np.array(counts - [r.count for r in self._runs])

    def start(self, fit: profile.Fit) -> Start:
        """Where a fit to whole runs begins: the windows' shared values, and the states of the first windows."""
        return Start(fit.values, tuple(self._whole(r, fit) for r in self._runs))

    def _whole(self, run: RunDesign, fit: profile.Fit) -> Array:
        own = self.bench.design.runs[self._first[run.index]]
        known = dict(zip(own.labels, fit.states[own.index], strict=True))
        return np.array([known.get(label, value) for label, value in zip(run.labels, run.start, strict=True)])


def windows(bench: FitContext, pieces: int) -> Windows | None:
    """The windows of a design, so many of each run; None where what was measured in a window does not tell its initial
    state."""
    plan = bench.design
    if not starts_anywhere(plan.world, plan.recording):
        return None
    cut: list[Run] = []
    first: list[int] = []
    for run in plan.recording.runs:
        first.append(len(cut))
        parts = _cut(run, pieces)
        if not parts:
            return None
        cut += parts
    made = design(plan.world, Recording(tuple(cut)))
    return Windows(bench, made, tuple(first))


def _cut(run: Run, most: int) -> list[Run]:
    """At most so many windows of equal length, more of a long run; none where a component that was measured is missing
    in one of them."""
    count = len(run.times)
    most *= max(count // LONG_RUN, 1)
    size = count // min(most, max(count // FEWEST, 1))  # all alike, to be rolled out together
    rough = roughness(run)
    pieces: list[Run] = []
    for begin in range(0, count - size + 1, size):
        moved = range(-size // 4, size // 4 + 1) if begin else (0,)
        first = smooth_near(rough, begin, [begin + m for m in moved if begin + m + size <= count])
        keep = np.zeros(count, dtype=bool)
        keep[first : first + size] = True
        pieces.append(replace(run.rows(keep), name=f"{run.name} from {begin}", window_of=run.name))
    return pieces if all(is_seen(run, p) for p in pieces) else []
