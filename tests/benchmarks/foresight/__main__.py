"""Measure how well worlds predict rendered clips: `python -m tests.benchmarks.foresight`.

Clips end before much of what happens (`tests.benchmarks.video_clips`). Of each a world is made with no human help:
from the video by one call of ModelVideo, and from true tracks with 5 mm noise by import, BuildWorld and FitWorld, so
that what perception costs and what prediction costs are separated. Scored: where every body is 2 s after the clip,
beside a straight line and beside staying; where it is after up to ten edits; yes/no questions near the boundary, with
the probability that an ensemble of 40 gives. What the tools cannot express is counted and listed.
Options: [--clips DIR] takes a folder drawn before, else clips are drawn: [--count K], [--seed S]; [--tracks-only] draws
without rendering and skips the videos; [--quick] is ten clips, their edits left out; [--executor WHERE];
[--json] prints all figures.
"""

from __future__ import annotations

import argparse
import json
import secrets
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from polyworld.executors import (
    FailedPiecesError,
    Failure,
    add_executor_argument,
    executor_from,
    print_progress,
)
from tests.benchmarks.foresight.draw import draw_all
from tests.benchmarks.foresight.run import Answered, ClipRun, Ending, Source, run_clip
from tests.benchmarks.foresight.scene import read_clips

COUNT, QUICK = 60, 10
BINS = np.linspace(0.5, 1.0, 6)  # of the probability of the answer given


def calibration_error(answers: Sequence[Answered]) -> float | None:
    """Mean over answers of |stated probability - share that is right|, in five bins of the stated probability."""
    asked = [a for a in answers if a.probability is not None]
    if not asked:
        return None
    stated = np.array([max(a.probability or 0.0, 1.0 - (a.probability or 0.0)) for a in asked])
    right = np.array([_right(a) for a in asked])
    place = np.clip(np.digitize(stated, BINS) - 1, 0, len(BINS) - 2)
    gaps = [abs(stated[place == k].mean() - right[place == k].mean()) * np.sum(place == k) for k in np.unique(place)]
    return float(np.sum(gaps) / len(asked))


def _right(answer: Answered) -> float:
    """Return 1 if an answer is right, 0 if wrong, 0.5 where it is evenly divided or was not given."""
    if answer.probability is None or answer.probability == 0.5:
        return 0.5
    return float((answer.probability > 0.5) == answer.truth)


def summary(runs: Sequence[ClipRun]) -> dict[str, Any]:
    """Figures over clips; distances are medians [m] of the bodies that move after the clip."""
    endings = [e for r in runs for e in r.endings if e.edit is None]
    stirring = [e for e in endings if e.stirs and e.predicted is not None]
    edited = [e for r in runs for e in r.endings if e.edit is not None and e.predicted is not None]
    answers = [a for r in runs for a in r.answers]
    predicted, straight, stays = (
        _median([getattr(e, k) for e in stirring]) for k in ("predicted", "straight", "stays")
    )
    return {
        "clips": len(runs),
        "failed": sum(r.failed is not None for r in runs),
        "bodies": len(endings),
        "moving": len(stirring),
        "end_error": predicted,
        "straight": straight,
        "stays": stays,
        "of_straight": _share(predicted, straight),
        "of_stays": _share(predicted, stays),
        "still_error": _median([e.predicted for e in endings if not e.stirs and e.predicted is not None]),
        "edit_error": _median([e.predicted for e in edited]),
        "edits": len({(r.clip, e.edit) for r in runs for e in r.endings if e.edit is not None}),
        "inexpressible": sum(len(r.inexpressible) for r in runs),
        "questions": len(answers),
        "unasked": sum(a.probability is None for a in answers),
        "right": None if not answers else float(np.mean([_right(a) for a in answers])),
        "calibration_error": calibration_error(answers),
        "seconds": float(np.mean([r.seconds for r in runs])) if runs else None,
    }


def _median(values: Sequence[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.median(known)) if known else None


def _share(value: float | None, of: float | None) -> float | None:
    return value / of if value is not None and of else None


def describe(run: ClipRun) -> str:
    """Return one clip in a line."""
    if run.failed is not None:
        return f"{run.clip} ({run.source}): no world: {run.failed[:200]}"
    ends = ", ".join(f"{e.body} {_ending(e)}" for e in run.endings if e.edit is None)
    right = sum(_right(a) for a in run.answers)
    return (
        f"{run.clip} ({run.source}) {run.verdict}: {ends}; {right:g} of {len(run.answers)} right, "
        f"{len(run.inexpressible)} not expressible, {run.calls} calls, {run.seconds:.0f} s"
    )


def _ending(e: Ending) -> str:
    predicted = "-" if e.predicted is None else f"{e.predicted:.3f}"
    return predicted if not e.stirs else f"{predicted} (line {e.straight or 0.0:.2f}, stays {e.stays or 0.0:.2f})"


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=Path, metavar="DIR", help="folder with public and private, drawn before")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="clips whose names begin so")
    parser.add_argument("--count", type=int, help=f"clips to draw (default: {COUNT})")
    parser.add_argument("--seed", type=int, help="default: from the operating system")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} clips, without edits")
    parser.add_argument("--tracks-only", action="store_true", help="true tracks alone; nothing is rendered")
    add_executor_argument(parser)
    parser.add_argument("--workers", type=int, default=2, help="clips at once")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    seed = secrets.randbits(32) if chosen.seed is None else chosen.seed
    count = chosen.count or (QUICK if chosen.quick else COUNT)
    sources: list[Source] = ["tracks"] if chosen.tracks_only else ["tracks", "video"]
    with tempfile.TemporaryDirectory() as made:
        folder = chosen.clips or Path(made)
        if chosen.clips is None and chosen.tracks_only:
            draw_all(folder, seed, count)
        elif chosen.clips is None:
            draw = [sys.executable, "-m", "tests.benchmarks.video_clips", "--out", made, "--seed", str(seed)]
            subprocess.run([*draw, "--count", str(count), "--quiet"], check=True, cwd=Path(__file__).parents[3])
        clips = [c for c in read_clips(folder) if not chosen.only or c.name.startswith(tuple(chosen.only))]
        if chosen.quick or chosen.count:
            clips = clips[:count]
        by_source: dict[str, list[ClipRun]] = {}
        failures = []
        with executor_from(chosen.executor, chosen.workers) as executor:
            for source in sources:
                there = {c.name: c for c in clips if source == "tracks" or c.video is not None or c.inexpressible}
                work = partial(run_clip, source=source, edits=not chosen.quick)
                for _, run in executor.map(work, there, progress=print_progress(f"clips from {source}")):
                    if isinstance(run, Failure):
                        failures.append(run)
                        continue
                    by_source.setdefault(source, []).append(run)
                    print(describe(run), file=sys.stderr, flush=True)
        if failures:
            raise FailedPiecesError(failures)
    rows = [run for runs in by_source.values() for run in runs]
    figures: dict[str, Any] = {source: summary(runs) for source, runs in by_source.items()}
    kinds = sorted({run.kind for run in rows})
    by_kind = {
        source: {kind: summary([r for r in runs if r.kind == kind]) for kind in kinds}
        for source, runs in by_source.items()
    }
    if chosen.json:
        print(json.dumps({"seed": seed, **figures, "kinds": by_kind, "rows": [run.to_dict() for run in rows]}))
        return
    for title, table in by_kind.items():
        _print_table(title, {**table, "all": figures[title]})
    listed: dict[str, int] = {}
    for why in (why for run in rows for why in run.inexpressible):
        listed[why] = listed.get(why, 0) + 1
    for why, times in sorted(listed.items(), key=lambda item: -item[1]):
        print(f"not expressible, {times} times: {why[:160]}")
    print(f"seed {seed}")


def _print_table(title: str, table: dict[str, dict[str, Any]]) -> None:
    columns = list(next(iter(table.values())))
    print("\t".join([title, *columns]))
    for name, figures in table.items():
        cells = ["-" if figures[c] is None else f"{figures[c]:.3g}" for c in columns]
        print("\t".join([name, *cells]))


if __name__ == "__main__":
    main()
