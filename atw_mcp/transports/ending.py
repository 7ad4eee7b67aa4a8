"""The end of a serving process: by signal or because its client left, in order and within a bounded time."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from atw_mcp.transports.limits import LIMITS

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class Ending:
    """How and when this process ends.

    stop: asks the server to end; called once, from a signal handler in the main thread. seconds: the time that the
    end may take. last_resort: closes what must not be lost, in a thread of its own, where that time is over.
    """

    def __init__(self, stop: Callable[[], object], seconds: float) -> None:
        self.last_resort: Callable[[], None] = lambda: None
        self._stop = stop
        self._seconds = seconds
        self._started = False
        self._signal = 0

    @property
    def exit_code(self) -> int:
        """0, or 128 and the number of the signal that ended the process."""
        return 128 + self._signal if self._signal else 0

    def begin(self) -> None:
        """End the process after the time allowed, even where a thread or the interpreter's own end is stuck."""
        if not self._started:
            self._started = True
            timer = threading.Timer(self._seconds, self._force)
            timer.daemon = True
            timer.start()

    def on_signal(self, number: int, _frame: FrameType | None) -> None:
        """Note the first signal and ask the server to end; later ones change nothing."""
        if not self._signal:
            self._signal = number
            self.begin()
            self._stop()

    def _force(self) -> None:
        try:
            self.last_resort()
            print("atw-mcp: ended with calls unfinished", file=sys.stderr, flush=True)
        finally:
            os._exit(self.exit_code)


@contextmanager
def ending_in_order(stop: Callable[[], object], seconds: float = LIMITS.shutdown_seconds) -> Iterator[Ending]:
    """Handle the signals that end a process as `Ending` says. Outside the main thread signals are left alone."""
    ending = Ending(stop, seconds)
    if threading.current_thread() is not threading.main_thread():
        yield ending
        return
    before = {number: signal.signal(number, ending.on_signal) for number in SIGNALS}
    try:
        yield ending
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
