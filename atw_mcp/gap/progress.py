"""Progress of the gap tools as people read it: the step, what was fitted last, and the best fit so far."""

from __future__ import annotations

import math

from atw_mcp.calls.error_curve import SIGMA, ErrorCurve, in_words
from atw_mcp.calls.jobs import Progress
from polyworld.estimation.fit_context import FittedHypothesis


class GapProgress:
    """Reports steps and fits of one piece of work, and keeps the curve of their errors.

    The error of a fit is the root mean square of its whitened residuals, in standard deviations of the noise: 1 where
    only noise is left.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress, self._share, self._step, self._batches = progress, 0.0, "", 0
        self._last, self._best = "", math.inf
        self.curve = progress.curve = ErrorCurve("fit", SIGMA)

    def report(self, share: float, step: str) -> None:
        """Report that a step begins or, in a search, is done; raises Cancelled where the work should stop."""
        self._share, self._step = share, step
        self._progress.report(share, 1.0, self._in_words())

    def fitted(self, trial: FittedHypothesis) -> None:
        """Report a fit of a hypothesis."""
        error = math.sqrt(trial.chi2 / trial.context.observations) if math.isfinite(trial.chi2) else math.nan
        if error < self._best:
            self._best = error
        self.curve.add(error, self._best if math.isfinite(self._best) else math.nan)
        self._last = f": {trial.hypothesis.title}, error {in_words(error, SIGMA)}, best {in_words(self._best, SIGMA)}"
        self._progress.note(self._share, 1.0, self._in_words())

    def cancelled(self) -> bool:
        """Return whether to stop; asked before each batch, which is reported too: a fit may take many seconds."""
        self._batches += 1
        self._progress.note(self._share, 1.0, self._in_words())
        return self._progress.cancelled()

    def _in_words(self) -> str:
        return f"{self._step}{self._last}; {self._batches} batches of simulations"
