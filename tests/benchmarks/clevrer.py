"""How well worlds follow CLEVRER videos: `python -m tests.benchmarks.clevrer [--data DIR] [--scenes N ...] [--json]`.

Tracks and fits from video, and scenes worked on through the tools; fits of annotations: `peers.identification`. Every
figure is measured in the run. Scenes run several at a time through `--executor`, whose workers must see the folder.
Progress goes to stderr, the table (or JSON) to stdout.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from polyworld.executors import Failure, add_executor_argument, executor_from, print_progress
from tests.benchmarks.clevrer_fit import Budget, Row, rows
from tests.benchmarks.clevrer_tools import ToolRun, through_tools
from tests.benchmarks.clevrer_video import TrackScore, observe_scene
from tests.scenes.clevrer_data import Scene, available_scenes, default_folder, default_world, read_scene
from tests.scenes.clevrer_events import EventScore


@dataclass(frozen=True)
class Work:
    """What is to be done with a scene of a folder, which every worker must see."""

    scene: Scene
    folder: Path
    budget: Budget
    tools: bool
    video: bool


@dataclass(frozen=True)
class Measured:
    """The figures of a scene."""

    run: ToolRun | None
    score: TrackScore | None
    fits: tuple[Row, ...]


def measured(work: Work) -> Measured:
    """Measure a scene."""
    started = time.perf_counter()

    def say(text: str) -> None:
        print(f"[{time.perf_counter() - started:6.1f} s] {text}", file=sys.stderr, flush=True)

    scene = work.scene
    run = through_tools(scene, work.folder, say) if work.tools else None
    if scene.video is None or not work.video:
        return Measured(run, None, ())
    fits: list[Row] = []
    video, score = observe_scene(scene, work.folder, say)
    world = default_world(video.tracks, video.kinds)
    for holdout in (None, int(0.75 * len(scene.tracks.frames))):
        fits += rows(
            scene.number, "video", world, video.tracks, video.truth, video.collisions, work.budget, holdout, say
        )
    return Measured(run, score, tuple(fits))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns the process's exit status."""
    options = _options(arguments)
    folder: Path = options.data.resolve()  # workers may stand elsewhere
    numbers = options.scenes or available_scenes(folder)
    if not numbers:
        print(f"no annotation_NNNNN.json in {folder}", file=sys.stderr)
        return 2
    started = time.perf_counter()
    budget = Budget(generations=options.generations, population=options.population)
    try:
        scenes = [read_scene(folder, number) for number in numbers]
    except FileNotFoundError as error:
        print(error, file=sys.stderr)
        return 2
    pieces = {s.number: Work(s, folder, budget, not options.no_tools, not options.no_video) for s in scenes}
    found: list[Measured] = []
    failures: list[Failure] = []
    with executor_from(options.executor) as executor:
        for _, outcome in executor.map(measured, pieces, progress=print_progress("scenes")):
            if isinstance(outcome, Failure):
                print(f"scene {outcome.key} failed: {outcome.error}\n{outcome.traceback}", file=sys.stderr)
                failures.append(outcome)
            else:
                found.append(outcome)
    scores = [m.score for m in found if m.score is not None]
    table = [row for m in found for row in m.fits]
    runs = [m.run for m in found if m.run is not None]
    if options.json:
        data = {
            "tracks": [_finite(asdict(s)) for s in scores],
            "fits": [_json(row) for row in table],
            "tools": [_json(run) for run in runs],
            "seconds": time.perf_counter() - started,
        }
        print(json.dumps(data, indent=1))
    else:
        print_tracks(scores, print)
        print_fits(table, print)
        print_tools(runs, print)
        print(f"\n{time.perf_counter() - started:.0f} s in all")
    return 1 if failures else 0


def print_tracks(scores: list[TrackScore], out: Callable[[str], None]) -> None:
    """The table of tracks from video."""
    if not scores:
        return
    out(
        f"{'scene':>7} {'median error m':>14} {'own sizes m':>11} {'worst object m':>14} "
        f"{'swaps':>5} {'objects':>7} {'found':>5} "
        f"{'extra':>5} {'colour':>6} {'shape':>5} {'material':>8} {'coverage':>8} {'seconds':>7}"
    )
    for s in scores:
        out(
            f"{s.scene:>7} {s.median_error:14.4f} {s.median_error_own_sizes:11.4f} {s.worst_object:14.4f} "
            f"{s.swaps:5d} {s.objects:7d} {s.found:5d} "
            f"{s.extra:5d} {s.colours:6d} {s.shapes:5d} {s.materials:8d} {s.coverage:8.2f} {s.seconds:7.1f}"
        )
    out("")


def print_fits(table: list[Row], out: Callable[[str], None]) -> None:
    """The table of fits, and medians over scenes."""
    out(
        f"{'scene':>7} {'tracks':>11} {'fitted':>7} {'method':>14} {'RMSE m':>8} {'held out m':>10} "
        f"{'collisions P':>12} {'R':>5} {'rollouts':>8} {'seconds':>7}"
    )
    for row in table:
        out(_line(row.scene, row, row.rmse, row.held_out, row.events))
    out("")
    for key in dict.fromkeys((r.source, r.fitted, r.method) for r in table):
        same = [r for r in table if (r.source, r.fitted, r.method) == key]
        if len(same) > 1:
            total = EventScore(0, 0, 0)
            for row in same:
                total = total + row.events
            rmse = float(np.median([r.rmse for r in same]))
            held = float(np.median([r.held_out for r in same]))
            middle = replace(
                same[0],
                rollouts=int(np.median([r.rollouts for r in same])),
                seconds=float(np.median([r.seconds for r in same])),
            )
            out(_line("median", middle, rmse, held, total))


def print_tools(runs: list[ToolRun], out: Callable[[str], None]) -> None:
    """Scenes worked on by nothing but MCP tools, and the answers read off the tools' events."""
    if not runs:
        return
    out("\nthrough the MCP tools")
    out(f"{'scene':>7} {'from':>11} {'RMSE m':>8} {'collisions P':>12} {'R':>5} {'calls':>5}")
    for run in runs:
        p, r = run.events.precision, run.events.recall
        out(f"{run.scene:>7} {run.source:>11} {run.rmse:8.4f} {p:12.2f} {r:5.2f} {run.calls:5d}")
    for run in runs:
        for question in dict.fromkeys(a.question for a in run.answers):
            mine = [a for a in run.answers if a.question == question]
            right = sum(a.answered == a.right for a in mine)
            out(f"{run.scene}: {question}: {right} of {len(mine)} choices right")
            for a in mine:
                said = {True: "correct", False: "wrong", None: "cannot be answered"}[a.answered]
                truth = "correct" if a.right else "wrong"
                out(f"    {a.choice}: {said} (reference: {truth}){'; ' + a.note if a.note else ''}")


def _line(label: str, row: Row, rmse: float, held_out: float, events: EventScore) -> str:
    held = f"{held_out:10.4f}" if np.isfinite(held_out) else f"{'':>10}"
    return (
        f"{label:>7} {row.source:>11} {row.fitted:>7} {row.method:>14} {rmse:8.4f} {held} "
        f"{events.precision:12.2f} {events.recall:5.2f} {row.rollouts:8d} {row.seconds:7.1f}"
    )


def _json(row: Row | ToolRun) -> Any:
    data = asdict(row)
    data["events"] |= {"precision": row.events.precision, "recall": row.events.recall}
    return _finite(data)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.clevrer", description=__doc__)
    parser.add_argument("--data", type=Path, default=default_folder(), help="a CLEVRER folder (default: %(default)s)")
    parser.add_argument("--scenes", nargs="+", metavar="N", help="five-digit scene numbers (default: all there are)")
    parser.add_argument("--generations", type=int, default=240, help="generations of a search (default: %(default)s)")
    parser.add_argument("--population", type=int, default=320, help="rollouts a generation (default: %(default)s)")
    parser.add_argument("--no-tools", action="store_true", help="leave out the runs through the MCP tools")
    parser.add_argument("--no-video", action="store_true", help="leave out tracks and fits of videos")
    add_executor_argument(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
