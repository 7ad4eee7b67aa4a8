"""Times of engines on one scene, taken in turn."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from tests.benchmarks.peers.engine import Engine, Prepared, UnsupportedError
from tests.benchmarks.peers.machine import THREADS
from tests.benchmarks.peers.scenes import Scene

LONG = 2.0  # a call that takes longer [CPU s] is timed once: noise is a small part of it


@dataclass(frozen=True)
class Times:
    """Median wall and CPU seconds of a call."""

    wall: float
    cpu: float


def timed(call: Callable[[], object]) -> Times:
    """Return the times of one call."""
    before, spent = time.perf_counter(), time.process_time()
    call()
    return Times(time.perf_counter() - before, time.process_time() - spent)


def interleaved(calls: Mapping[str, Callable[[], object]], repeats: int) -> tuple[dict[str, Times], dict[str, str]]:
    """Return medians over repeats of calls that take turns, and why those that fail do.

    The first round is not counted, except for calls that take longer than `LONG`: they are not called again.
    """
    failed: dict[str, str] = {}
    taken: dict[str, list[Times]] = {}
    for name, call in calls.items():
        try:
            first = timed(call)
        except Exception as error:  # a peer that fails is a finding, not the end of the comparison
            failed[name] = f"failed: {type(error).__name__}: {error}"[:120]
        else:
            taken[name] = [first] if first.cpu > LONG else []
    again = [name for name, times in taken.items() if not times]
    for _ in range(repeats):
        for name in again:
            taken[name].append(timed(calls[name]))
    medians = {
        name: Times(statistics.median(t.wall for t in times), statistics.median(t.cpu for t in times))
        for name, times in taken.items()
    }
    return medians, failed


def prepared(
    engines: Sequence[Engine], scene: Scene, worlds: int, interval: float
) -> tuple[dict[str, Prepared], dict[str, str]]:
    """Return the scene prepared by each engine that takes it, and why the others do not."""
    ready: dict[str, Prepared] = {}
    refused: dict[str, str] = {}
    for engine in engines:
        try:
            ready[engine.name] = engine.prepare(scene, worlds, interval, THREADS)
        except UnsupportedError as error:
            refused[engine.name] = str(error)
        except Exception as error:  # a peer that fails is a finding, not the end of the comparison
            refused[engine.name] = f"failed: {type(error).__name__}: {error}"[:120]
    return ready, refused


def milliseconds(seconds: float) -> str:
    """Return a time as text [ms]."""
    return f"{1e3 * seconds:.3g}" if seconds < 1.0 else f"{1e3 * seconds:.0f}"


def advantage(times: Mapping[str, Times], name: str, peers: Sequence[str]) -> str:
    """Return how many times less wall time an engine takes than the fastest of its peers."""
    fastest = min((times[peer].wall for peer in peers if peer in times and peer != name), default=float("nan"))
    return f"{fastest / times[name].wall:.3g}"
