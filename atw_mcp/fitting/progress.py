"""Progress of a fit as people read it: which generation or iteration, the error now and the best so far."""

from __future__ import annotations

import math

from atw_mcp.calls.error_curve import ErrorCurve, in_words
from atw_mcp.calls.jobs import Progress
from polyworld.estimation.world_fit import DescentStep, FitProblem, SearchProgress

SEARCHED = 0.65
"""Share of the whole that a search takes: between 0.3 and 0.8 in fits of the demos' clips, most where it takes long."""
COUNTED = {"cem": "generation", "random_search": "generation", "prefixes": "iteration", "refine": "iteration"}


class FitProgress:
    """Collects the steps of one fit, reports each, and keeps the curve of its error.

    The best is that over all fitted frames as soon as a trial was compared with all, else over those compared so far.
    """

    def __init__(self, progress: Progress, problem: FitProblem, method: str) -> None:
        self._progress, self._all = progress, problem.samples
        self.curve = ErrorCurve(COUNTED.get(method, "generation or iteration"), problem.objective.error_unit)
        progress.curve = self.curve
        self._stage, self._share, self._next = "", 0.0, 0.0
        self._samples, self._loss, self._best = 0, math.inf, math.nan
        problem.watch = self.iteration

    def generation(self, step: SearchProgress) -> None:
        """Report a generation of a search; those of all its restarts are counted."""
        self._share = SEARCHED * step.done / step.total
        self._step(f"generation {step.done} of {step.total}", step.samples, step.error, step.best_error, step.loss)

    def start(self, number: int, of: int, stage: int, stages: int) -> None:
        """Report that a stretch of one of at most `of` starts begins."""
        length = SEARCHED / (of * stages)
        begin = length * ((number - 1) * stages + stage - 1)
        self.stage(f"start {number} of at most {of}", begin, begin + length)

    def stage(self, name: str, begin: float, end: float) -> None:
        """Report that a stage of the fit begins, which takes it from one share of the whole to another."""
        self._stage, self._share, self._next = name, max(begin, self._share), max(end, self._share)
        self._progress.note(self._share, 1.0, name)

    def iteration(self, step: DescentStep) -> None:
        """Report an iteration of least squares; how many descents a stage takes shows only in the end."""
        self._share += max(self._next - self._share, 0.0) / max(step.of, 2)
        self._step(
            f"{self._stage or 'refining'}, iteration {step.number}",
            step.samples,
            step.error,
            step.best_error,
            step.best_loss,
        )

    def _step(self, what: str, samples: int, error: float, best: float, loss: float) -> None:
        whole = self._samples == self._all
        if (loss < self._loss) if samples == self._samples else not whole:
            self._samples, self._loss, self._best = samples, loss, best
        self.curve.add(error, self._best)
        unit = self.curve.unit
        message = f"{what}, error {in_words(error, unit)}, best {in_words(self._best, unit)}"
        if samples < self._all:
            message += f" over {samples} of {self._all} frames"
        self._progress.note(self._share, 1.0, message)
