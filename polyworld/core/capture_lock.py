"""A lock that lets many threads launch kernels, or one thread capture a graph.

Warp keeps one capture a process: launches, allocations and copies of other threads would be recorded in it instead of
being run, and a second capture is refused.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager


class CaptureLock:
    """Shared by threads that launch, exclusive for the one that captures, which may launch as well."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._launching = 0
        self._capturing: int | None = None  # identifier of the thread
        self._waiting = 0  # threads that want to capture: launches let them go first
        self._within = threading.local()  # `held`: whether this thread has it

    @contextmanager
    def shared(self) -> Iterator[None]:
        """Wait until no other thread captures, or wants to. A thread may hold it more than once."""
        if getattr(self._within, "held", False) or self._capturing == threading.get_ident():
            yield
            return
        with self._changed:
            while self._capturing is not None or self._waiting:
                self._changed.wait()
            self._launching += 1
        self._within.held = True
        try:
            yield
        finally:
            self._within.held = False
            with self._changed:
                self._launching -= 1
                if not self._launching:
                    self._changed.notify_all()

    @contextmanager
    def exclusive(self) -> Iterator[None]:
        """Wait until no other thread launches or captures."""
        with self._changed:
            self._waiting += 1
            try:
                while self._capturing is not None or self._launching:
                    self._changed.wait()
            finally:
                self._waiting -= 1
            self._capturing = threading.get_ident()
        try:
            yield
        finally:
            with self._changed:
                self._capturing = None
                self._changed.notify_all()
