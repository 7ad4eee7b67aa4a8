"""Rows of the tables of speed: one engine on one scene."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

THREADS = len(os.sched_getaffinity(0))


@dataclass
class Row:
    """One measurement: wall and CPU seconds for `simulated` seconds of `worlds` worlds, in steps of dt [s].

    check: a length [m] in which all engines should agree.
    """

    name: str
    elements: int
    worlds: int
    dt: float
    simulated: float
    wall: float
    cpu: float
    check: float

    def text(self) -> str:
        """Return one line of the table."""
        steps = self.worlds * self.simulated / self.dt
        return (
            f"{self.name:34s} {self.elements:6d} {self.worlds:3d} {1e3 * self.dt:8.4f} "
            f"{self.wall / self.simulated / self.worlds:9.4f} {1e9 * self.wall / steps / self.elements:9.1f} "
            f"{1e9 * self.cpu / steps / self.elements:9.1f} {self.check:8.4f}"
        )


def header(element: str, check: str) -> str:
    """Head of a table whose elements and check are called so."""
    return (
        f"{'engine':34s} {element:>6s} {'W':>3s} {'dt ms':>8s} {'s / s':>9s} {'ns wall':>9s} {'ns cpu':>9s} "
        f"{check:>8s}\n  s / s: wall seconds per simulated second of one world; ns: per element and inner step; "
        f"{THREADS} threads"
    )


def timed(work: Callable[[], Any]) -> tuple[float, float]:
    """Wall and CPU seconds of one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def print_rows(rows: Iterable[tuple[str, Callable[[], Row]]]) -> None:
    """Measure and print; a peer that is absent or fails has a row that says why."""
    for name, measure in rows:
        try:
            print(measure().text(), flush=True)
        except ImportError as error:
            print(f"{name:34s} left out: {error}", flush=True)
        except Exception as error:  # a peer that fails is a finding, not the end of the comparison
            print(f"{name:34s} failed: {type(error).__name__}: {error}"[:200], flush=True)
