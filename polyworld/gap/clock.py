"""Watch a time limit and a request to stop, between batches of simulations."""

from __future__ import annotations

import time
from collections.abc import Callable


class TimeLimitReached(Exception):
    """The time given to a search is over; what was fitted so far is judged."""


class Clock:
    """Is asked between batches: true where the work was cancelled; raises `TimeLimitReached` once time is over.

    seconds: wall-clock time from now on; None for no limit.
    """

    def __init__(self, seconds: float | None = None, cancelled: Callable[[], bool] | None = None) -> None:
        if seconds is not None and not seconds > 0.0:
            raise ValueError(f"the time limit must be positive seconds, got {seconds}")
        self.seconds = seconds
        self._end = None if seconds is None else time.monotonic() + seconds
        self._cancelled = cancelled

    def __call__(self) -> bool:
        """Return whether the work was cancelled."""
        if self._end is not None and time.monotonic() > self._end:
            raise TimeLimitReached
        return self._cancelled is not None and self._cancelled()

    @property
    def over(self) -> bool:
        """Whether the time is over."""
        return self._end is not None and time.monotonic() > self._end

    def lift(self) -> None:
        """Let what remains to be done, the judgement of what was fitted, end."""
        self._end = None
