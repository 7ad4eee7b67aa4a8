"""Measure what executors cost a piece, and how they scale: `python -m tests.benchmarks.executor_scaling`.

Options: [--executors local dask ...], [--workers 1 2], [--pieces N] of each overhead, [--data DIR] of CLEVRER,
[--quick] leaves out the fits.

Start: seconds until each worker has answered once. Overhead: seconds by the clock between two pieces of a worker that
do nothing, and CPU seconds of the coordinating process (of Dask also the scheduler), which all workers share. Fits:
CLEVRER scenes fitted by CEM, all by the same workers, warmed up before; on a busy machine the speed-up says little.
The estimate beyond: W workers that each need t + o seconds a piece finish W / (t + o) pieces a second, until the
coordinator, which needs c a piece, is busy all the time: at t / c workers.
"""

from __future__ import annotations

import argparse
import os
import pickle
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from polyworld import Trajectory, World, rollout
from polyworld.executors import Executor, executor_from, results
from tests.benchmarks.clevrer_fit import Row
from tests.benchmarks.peers.identification import QUICK, fitted
from tests.benchmarks.peers.markdown import markdown
from tests.benchmarks.peers.table import Table
from tests.scenes.clevrer_data import available_scenes, default_folder

ESTIMATED = (2, 8, 32, 128, 512)  # workers that the estimate is given for
WARM = 1024  # rollouts of a fit before those that are measured


@dataclass(frozen=True)
class Loaded:
    """A piece as heavy as a case's: a world and a trajectory in it."""

    world: World
    motion: Trajectory


@dataclass(frozen=True)
class Cost:
    """Seconds a piece: by the clock on one worker, and of the coordinating process."""

    between: float
    coordinator: float


def nothing(piece: int) -> int:
    """Do nothing."""
    return piece


def carried(piece: Loaded) -> Loaded:
    """Return the piece."""
    return piece


def pause(piece: float) -> int:
    """Wait so long [s] that every worker is given a piece."""
    time.sleep(piece)
    return os.getpid()


def loaded() -> Loaded:
    """Return six balls that roll for 4 s, with their motion at 100 samples a second."""
    balls = [
        {
            "name": f"ball{k}",
            "shape": {"kind": "sphere", "radius": 0.1},
            "position": [0.3 * k, 0.0, 0.1],
            "velocity": [1.0 - 0.3 * k, 0.1 * k, 0.0],
        }
        for k in range(6)
    ]
    world = World.model_validate(
        {"objects": balls, "statics": [{"name": "floor", "shape": {"kind": "plane"}}], "time": {"substep": 0.002}}
    )
    return Loaded(world, rollout(world, 4.0).trajectory)


def start(executor: Executor, workers: int) -> float:
    """Return the seconds until each worker has answered."""
    begin = time.perf_counter()
    seen: set[int] = set()
    while len(seen) < workers:
        seen |= set(results(executor.run(pause, {str(k): 0.05 for k in range(workers)})).values())
    return time.perf_counter() - begin


def cost(executor: Executor, function: Callable[[Any], Any], piece: Any, count: int) -> Cost:
    """Return what pieces cost that do nothing."""
    begin, worked = time.perf_counter(), time.process_time()
    results(executor.run(function, {str(k): piece for k in range(count)}))
    return Cost(
        executor.workers * (time.perf_counter() - begin) / count,
        (time.process_time() - worked) / count,
    )


def fits(executor: Executor, scenes: Mapping[str, tuple[str, str, bool]], budget: int) -> tuple[float, dict[str, Row]]:
    """Return the seconds in which all scenes are fitted, and the fits."""
    work = partial(fitted, budget=budget)
    results(executor.run(partial(fitted, budget=WARM), dict(list(scenes.items())[: 2 * executor.workers])))
    begin = time.perf_counter()
    found = results(executor.map(work, scenes))
    return time.perf_counter() - begin, {name: last for name, (_, last) in found.items()}


def estimate(cost: Cost, seconds: float) -> list[tuple[str, ...]]:
    """Return rows: workers, pieces a second, share of what as many workers without any overhead would do."""
    rows = []
    for workers in ESTIMATED:
        rate = min(workers / (seconds + cost.between), 1.0 / cost.coordinator)
        rows.append((str(workers), f"{rate:.3g}", f"{100.0 * rate * seconds / workers:.1f}%"))
    return rows


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--executors", nargs="+", default=["local", "dask"], metavar="WHERE")
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 2], metavar="N")
    parser.add_argument("--pieces", type=int, default=300)
    parser.add_argument("--data", type=Path, default=default_folder(), help="a CLEVRER folder (default: %(default)s)")
    parser.add_argument("--quick", action="store_true")
    chosen = parser.parse_args()
    numbers = [] if chosen.quick else available_scenes(chosen.data)
    if not numbers:
        print(f"fits left out: {'--quick' if chosen.quick else f'no scenes in {chosen.data}'}", file=sys.stderr)
    scenes = {n: ("CEM", n, False) for n in numbers}
    heavy = loaded()
    print(f"load average {os.getloadavg()[0]:.1f} of {len(os.sched_getaffinity(0))} cores\n")
    rows: list[tuple[str, ...]] = []
    beyond: list[tuple[str, ...]] = []
    first: dict[str, Row] = {}
    for where in chosen.executors:
        alone = 0.0
        for workers in chosen.workers:
            begin = time.perf_counter()
            with executor_from(where, workers) as executor:
                made = time.perf_counter() - begin
                started = made + start(executor, workers)
                light = cost(executor, nothing, 0, chosen.pieces)
                full = cost(executor, carried, heavy, chosen.pieces)
                row = [where, str(workers), f"{started:.2f}", *_milliseconds(light), *_milliseconds(full)]
                if scenes:
                    seconds, found = fits(executor, scenes, QUICK)
                    first = first or found
                    same = all(_figures(found[n]) == _figures(first[n]) for n in scenes)
                    alone = alone or seconds * workers
                    each = sum(f.seconds for f in found.values()) / len(found)
                    row += [f"{seconds:.1f}", f"{alone / seconds:.2f}", f"{each:.2f}", "yes" if same else "NO"]
                    if workers == chosen.workers[-1]:
                        beyond += [(where, f"{each:.2f}", *r) for r in estimate(full, each)]
                        beyond += [(where, "0.10", *r) for r in estimate(full, 0.1)]
                rows.append(tuple(row))
                print(" ".join(row), file=sys.stderr, flush=True)
    columns = ("executor", "workers", "start [s]", "empty [ms]", "coordinator [ms]", "loaded [ms]", "coordinator [ms]")
    columns += (f"{len(scenes)} fits [s]", "speed-up", "CPU a fit [s]", "same figures") if scenes else ()
    note = (
        f"{chosen.pieces} pieces; loaded: a world and a trajectory, {len(pickle.dumps(heavy)) / 1e3:.0f} kB each way."
    )
    print(markdown(Table("Executors", note, columns, tuple(rows))))
    if beyond:
        note = "Estimated from the overheads of loaded pieces: of all workers, what share is at work."
        columns = ("executor", "piece [s]", "workers", "pieces a second", "efficiency")
        print("\n" + markdown(Table("Beyond this machine", note, columns, tuple(beyond))))


def _milliseconds(cost: Cost) -> tuple[str, str]:
    return f"{1e3 * cost.between:.2f}", f"{1e3 * cost.coordinator:.2f}"


def _figures(fit: Row) -> tuple[Any, ...]:
    return fit.rmse, fit.rollouts, fit.events


if __name__ == "__main__":
    main()
