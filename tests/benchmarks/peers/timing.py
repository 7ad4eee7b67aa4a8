"""Times of engines on one scene, taken in turn."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from tests.benchmarks.peers.engine import Engine, Prepared, UnsupportedError
from tests.benchmarks.peers.machine import THREADS
from tests.benchmarks.peers.scenes import Scene


@dataclass(frozen=True)
class Times:
    """Median wall and CPU seconds of a call."""

    wall: float
    cpu: float


def interleaved(calls: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, Times]:
    """Return medians over repeats of calls that take turns, each called once before that is not counted."""
    for call in calls.values():
        call()
    wall: dict[str, list[float]] = {name: [] for name in calls}
    cpu: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            before, spent = time.perf_counter(), time.process_time()
            call()
            wall[name].append(time.perf_counter() - before)
            cpu[name].append(time.process_time() - spent)
    return {name: Times(statistics.median(wall[name]), statistics.median(cpu[name])) for name in calls}


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


def raced(ready: Mapping[str, Prepared], repeats: int) -> dict[str, Times]:
    """Return the times of runs that take turns."""
    return interleaved({name: run.run for name, run in ready.items()}, repeats)


def milliseconds(seconds: float) -> str:
    """Return a time as text [ms]."""
    return f"{1e3 * seconds:.3g}"


def advantage(times: Mapping[str, Times], name: str, peers: Sequence[str]) -> str:
    """Return how many times less wall time an engine takes than the fastest of its peers."""
    fastest = min((times[peer].wall for peer in peers if peer in times and peer != name), default=float("nan"))
    return f"{fastest / times[name].wall:.3g}"
