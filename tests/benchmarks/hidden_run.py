"""The runner: the library's verdict on public files. It never sees the truth, and opens held-out runs at the very end.

`python -m tests.benchmarks.hidden_run --public DIR --share I/N [--until SECONDS]` takes every N-th case folder as it
appears, in the order of `order.json`, until `complete` stands in the folder or the time is over; each verdict goes to
`verdict.json`, or where `more.csv` is there, a second one on the enlarged data to `verdict_more.json`. Where there are
as many runners as cores, each keeps to one core, so the seconds of a verdict are those on one core.
"""

from __future__ import annotations

import argparse
import os
import time
import traceback
from pathlib import Path
from typing import Any

from polyworld.data.recording import Recording, Run
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.held_out import held_out_gap
from polyworld.world import World
from tests.benchmarks.hidden_files import read_json, read_runs, write_json

WAIT = 0.2


def recording_of(*paths: Path) -> Recording:
    """Return all runs of some files."""
    runs = [
        Run(name, objects, stamps, positions, orientations)
        for path in paths
        for name, objects, stamps, positions, orientations in read_runs(path)
    ]
    return Recording(tuple(runs))


def judge(folder: Path, *data: str) -> dict[str, Any]:
    """Return the report on a case folder, with the seconds it took by the clock and of work.

    The held-out runs are read once it stands.
    """
    world = World.model_validate(read_json(folder / "world.json"))
    recording = recording_of(*(folder / name for name in data))
    begin, worked = time.perf_counter(), time.process_time()
    report = find_gap(world, recording, settings=GapSettings(null_control=False))
    summary = report.to_dict()
    summary["seconds"], summary["cpu_seconds"] = time.perf_counter() - begin, time.process_time() - worked
    summary["rollouts"] = report.context.rollouts
    if (folder / "sealed.csv").exists() and report.world is not None:
        before = report.base.hypothesis.fitted_world(report.base.values)
        summary["sealed"] = held_out_gap(before, report.world, recording_of(folder / "sealed.csv")).to_dict()
    return summary


def judged(folder: Path, *data: str) -> dict[str, Any]:
    """Return the report, or what went wrong."""
    try:
        return judge(folder, *data)
    except Exception:
        return {"verdict": "crashed", "effects": [], "credible_set": [], "error": traceback.format_exc()}


def main() -> None:
    """Judge this process's share of the cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--public", type=Path, required=True)
    parser.add_argument("--share", required=True, help="I/N: cases I, I + N, ... of the order")
    parser.add_argument("--until", type=float, help="no case is started after this many seconds")
    chosen = parser.parse_args()
    mine, shares = (int(v) for v in chosen.share.split("/"))
    cores = sorted(os.sched_getaffinity(0))
    if shares >= len(cores) > 1:  # a core each: threads of several runners on one core only wait for each other
        os.sched_setaffinity(0, {cores[mine % len(cores)]})
    begin = time.monotonic()
    for name in read_json(chosen.public / "order.json")[mine::shares]:
        folder = chosen.public / name
        while not (folder / "world.json").exists() and not (chosen.public / "complete").exists():
            time.sleep(WAIT)
        if chosen.until is not None and time.monotonic() - begin > chosen.until:
            return
        if not (folder / "world.json").exists():
            continue  # it could not be drawn
        if not (folder / "verdict.json").exists():
            write_json(folder / "verdict.json", judged(folder, "data.csv"))
        if (folder / "more.csv").exists() and not (folder / "verdict_more.json").exists():
            write_json(folder / "verdict_more.json", judged(folder, "data.csv", "more.csv"))


if __name__ == "__main__":
    main()
