"""Interruption of a computation from outside, also while a kernel runs.

Who starts a computation makes it `active`; another thread may `request` its end. Solvers hand in what ends a running
kernel early (`stopping`), loops in Python ask (`check`); both raise `Interrupted` in the thread of the computation.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class Interrupted(Exception):
    """The computation was asked to end."""


class Interruption:
    """A request to end one computation."""

    def __init__(self) -> None:
        self._requested = threading.Event()
        self._stops: list[Callable[[], None]] = []
        self._guard = threading.Lock()

    @property
    def requested(self) -> bool:
        """Whether the computation should end."""
        return self._requested.is_set()

    def request(self) -> None:
        """Ask the computation to end, and end the kernels that run for it."""
        with self._guard:
            self._requested.set()
            for stop in self._stops:
                stop()

    @contextmanager
    def active(self) -> Iterator[None]:
        """Let this interrupt what the calling thread computes in the context."""
        token = _ACTIVE.set(self)
        try:
            yield
        finally:
            _ACTIVE.reset(token)

    def check(self) -> None:
        """Raise `Interrupted` where the computation should end."""
        if self.requested:
            raise Interrupted

    @contextmanager
    def stopping(self, stop: Callable[[], None]) -> Iterator[None]:
        """Have `stop` called when the end is requested while the context lasts; raises `Interrupted` then and after."""
        with self._guard:
            self.check()
            self._stops.append(stop)
        try:
            yield
        finally:
            with self._guard:
                self._stops.remove(stop)
        self.check()


_ACTIVE: ContextVar[Interruption] = ContextVar("interruption", default=Interruption())  # noqa: B039 nobody requests it


def current() -> Interruption:
    """Return what may interrupt the calling thread's computation."""
    return _ACTIVE.get()


def check() -> None:
    """Raise `Interrupted` where the calling thread's computation should end."""
    _ACTIVE.get().check()
