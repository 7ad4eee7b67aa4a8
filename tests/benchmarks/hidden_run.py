"""The runner: the library's verdict on public files. It never sees the truth, and opens held-out runs at the very end.

`python -m tests.benchmarks.hidden_run --public DIR [--executor WHERE] [--jobs N] [--until SECONDS]` takes the case
folders as they appear, in the order of `order.json`, until all have or `complete` stands in the folder, and begins none
after the time is over. Each verdict goes to `verdict.json`, or where `more.csv` is there, a second one on the enlarged
data to `verdict_more.json`. What is there already is not judged again.
"""

from __future__ import annotations

import argparse
import os
import time
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polyworld.core import interruption
from polyworld.data.recording import Recording, Run
from polyworld.executors import Failure, add_executor_argument, executor_from, print_progress
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.held_out import held_out_gap
from polyworld.world import World
from tests.benchmarks.hidden_files import read_json, runs_of, write_json

WAIT = 0.2


@dataclass(frozen=True)
class Files:
    """The texts of a case's public files, so that a worker needs no folder of this machine."""

    world: dict[str, Any]
    data: tuple[str, ...]
    held_out: str | None


class Pieces(Mapping[str, Files | None]):
    """Cases to judge by the name of the verdict's file, each read when a worker is free for it.

    None: it could not be drawn, or the time is over.
    """

    def __init__(self, public: Path, until: float | None) -> None:
        self._public = public
        self._end = None if until is None else time.monotonic() + until
        names = read_json(public / "order.json")
        asked = [f"{n}/verdict.json" for n in names]
        asked += [f"{n}/verdict_more.json" for n in names if (public / n / "more.csv").exists()]
        self._asked = [a for a in asked if not (public / a).exists()]

    def __getitem__(self, verdict: str) -> Files | None:
        folder = (self._public / verdict).parent
        while not (folder / "world.json").exists() and not (self._public / "complete").exists():
            interruption.check()
            time.sleep(WAIT)
        over = self._end is not None and time.monotonic() > self._end
        if over or not (folder / "world.json").exists():
            return None
        data = ["data.csv"] + (["more.csv"] if verdict.endswith("verdict_more.json") else [])
        held_out = folder / "sealed.csv"
        return Files(
            read_json(folder / "world.json"),
            tuple((folder / name).read_text() for name in data),
            held_out.read_text() if held_out.exists() else None,
        )

    def __iter__(self) -> Iterator[str]:
        return iter(self._asked)

    def __len__(self) -> int:
        return len(self._asked)


def recording_of(*texts: str) -> Recording:
    """Return all runs of some files' texts."""
    runs = [
        Run(name, objects, stamps, positions, orientations)
        for text in texts
        for name, objects, stamps, positions, orientations in runs_of(text)
    ]
    return Recording(tuple(runs))


def judge(case: Files) -> dict[str, Any]:
    """Return the report on a case, with the seconds it took by the clock and of work.

    The held-out runs are read once it stands.
    """
    world = World.model_validate(case.world)
    recording = recording_of(*case.data)
    begin, worked = time.perf_counter(), time.process_time()
    report = find_gap(world, recording, settings=GapSettings(null_control=False))
    summary = report.to_dict()
    summary["seconds"], summary["cpu_seconds"] = time.perf_counter() - begin, time.process_time() - worked
    summary["rollouts"] = report.context.rollouts
    if case.held_out is not None and report.world is not None:
        before = report.base.hypothesis.fitted_world(report.base.values)
        summary["sealed"] = held_out_gap(before, report.world, recording_of(case.held_out)).to_dict()
    return summary


def judged(case: Files | None) -> dict[str, Any] | None:
    """Return the report, or what went wrong."""
    if case is None:
        return None
    try:
        return judge(case)
    except Exception:
        return crashed(traceback.format_exc())


def crashed(error: str) -> dict[str, Any]:
    """Return the report on a case that none was made of."""
    return {"verdict": "crashed", "effects": [], "credible_set": [], "error": error}


def main() -> None:
    """Judge the cases of a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--public", type=Path, required=True)
    add_executor_argument(parser)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="cases at a time")
    parser.add_argument("--until", type=float, help="no case is started after this many seconds")
    chosen = parser.parse_args()
    pieces = Pieces(chosen.public, chosen.until)
    if not pieces:
        return
    with executor_from(chosen.executor, chosen.jobs) as executor:
        for verdict, found in executor.run(judged, pieces, progress=print_progress("cases")):
            if isinstance(found, Failure):
                write_json(chosen.public / verdict, crashed(f"{found.error}\n{found.traceback}"))
            elif found is not None:
                write_json(chosen.public / verdict, found)


if __name__ == "__main__":
    main()
