"""Progress of the gap tools as people read it: the step, what was fitted last, and the best fit so far."""

from __future__ import annotations

import math

from atw_mcp.calls.error_curve import SIGMA, ErrorCurve, in_words
from atw_mcp.calls.jobs import Progress
from polyworld.gap.fitting import Fitted


class GapProgress:
    """Reports steps and fits of one piece of work, and keeps the curve of their held-out errors.

    Errors are in standard deviations of the noise: 1 where only noise is left.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress, self._share, self._step, self._last, self._best = progress, 0.0, "", "", math.inf
        self.curve = progress.curve = ErrorCurve("fit", SIGMA)

    def report(self, share: float, step: str) -> None:
        """Report that a step begins or, in a search, is done; raises Cancelled where the work should stop."""
        self._share, self._step = share, step
        self._progress.report(share, 1.0, step + self._last)

    def fitted(self, one: Fitted) -> None:
        """Report a hypothesis that was fitted."""
        self._best = min(self._best, one.error)
        self.curve.add(one.error, self._best)
        errors = f"error {in_words(one.error, SIGMA)}, best {in_words(self._best, SIGMA)}"
        self._last = f": {one.hypothesis.title}, {errors}; {self.curve.count} fits"
        self._progress.note(self._share, 1.0, self._step + self._last)

    def cancelled(self) -> bool:
        """Return whether to stop."""
        return self._progress.cancelled()
