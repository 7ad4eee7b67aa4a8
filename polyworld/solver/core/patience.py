"""Wall-clock limit of a rollout: predicted from its first second, and kept while it runs."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

PATIENCE = 600.0  # [s] that a rollout may take unless its caller says otherwise: whoever waits longer means to
TRIAL = 1.0  # [s] after which the rest of a run is predicted: longer than what only its first steps do


class TooLong(ValueError):
    """A rollout that would take, or took, longer than its limit."""


class Watch:
    """The time that one run takes, held against its limit [s].

    cause: says, when asked, what makes the run slow and what would make it faster.
    """

    def __init__(self, limit: float, horizon: float, cause: Callable[[], str]) -> None:
        self.limit, self.horizon, self.cause = limit, horizon, cause
        self.begin()

    def begin(self) -> None:
        """Start to count."""
        self._began = time.perf_counter()
        self._predicted = False

    def used_up(self, share: float) -> str | None:
        """Say that and why the limit is reached, at a share of the run; None if it is not.

        Raises TooLong, once, where what was done in the first second predicts that it will be.
        """
        elapsed = time.perf_counter() - self._began
        if not self._predicted and elapsed > TRIAL and share > 0.0:
            self._predicted = True
            seconds = elapsed / share
            if seconds > self.limit:
                raise TooLong(too_long(self.horizon, seconds, self.limit, self.cause()))
        if elapsed <= self.limit:
            return None
        return f"it ran for its limit of {in_words(self.limit)} (patience). {self.cause()}"


def too_long(horizon: float, seconds: float, limit: float, cause: str) -> str:
    """Return the refusal of a run to `horizon` [s] that is predicted to take so many seconds."""
    fits = f"{horizon * limit / seconds:.2g} s would fit"
    return (
        f"a rollout to {horizon:g} s is predicted to take {in_words(seconds)} on this machine, more than the limit of "
        f"{in_words(limit)} (patience); a horizon of {fits}. {cause}"
    )


def in_words(seconds: float) -> str:
    """Return a time span as people say it."""
    for size, unit in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}" if seconds < 100.0 * size else f"{seconds / size:.0f} {unit}"
    return f"{seconds:.2g} s" if seconds < 10.0 else f"{seconds:.0f} s"


@contextmanager
def time_limit(seconds: float, stop: Callable[[], None]) -> Iterator[threading.Event]:
    """Have `stop` called after some seconds of the context; the event that is yielded is set by then."""
    reached = threading.Event()
    if not math.isfinite(seconds):
        yield reached
        return

    def end() -> None:
        reached.set()
        stop()

    timer = threading.Timer(seconds, end)
    timer.daemon = True
    timer.start()
    try:
        yield reached
    finally:
        timer.cancel()
