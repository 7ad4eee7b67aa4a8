"""Answer CLEVRER's and ContPhy's questions through the tools: `python -m tests.benchmarks.questions`.

Each scene is observed, a world is fitted to it, and the official question programs run on the world's rollouts and
branches. Scored as the papers score: per option, and per question (right when all its options are), by type, beside
two floors that need no world: always the majority answer, and straight lines through the observed tracks.
[--data DIR] takes a folder laid out like the official downloads (videos, annotations, questions; ContPhy's rope and
pulley group). Without it, scenes are drawn whose truth MuJoCo gives, cut before the collisions asked about
(`tests.benchmarks.question_clips`): [--solids A-B] and [--pulleys A-B] are their seeds, [--full] draws enough for 200
predictive and counterfactual questions. [--source video annotation] says what worlds are made from. Scenes run on
[--executor]; with [--out DIR] each finished scene is kept there with its evidence, and a second run goes on.
[--json] prints everything.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from polyworld.executors import Failure, add_executor_argument, executor_from
from tests.benchmarks import questions_clevrer, questions_pulleys
from tests.benchmarks.question_folders import CAMERA, Asked, AskedPulleys, Source, clevrer_scenes, pulley_scenes
from tests.benchmarks.question_scores import SceneRun, causes, print_rows, rows
from tests.scenes.clevrer_data import default_folder

SOLIDS, PULLEYS = "0-2", "0-2"
FULL_SOLIDS, FULL_PULLEYS = "0-39", "0-23"  # about 200 predictive and counterfactual questions about solids

Piece = tuple[Asked | AskedPulleys, Source, Path | None]


def run_piece(piece: Piece) -> SceneRun:
    """Answer the questions about one scene from one source."""
    scene, source, store = piece
    if isinstance(scene, AskedPulleys):
        return questions_pulleys.run_pulleys(scene, source, store)
    return questions_clevrer.run_clevrer(scene, source, store)


def pieces_of(folder: Path, sources: Sequence[Source], camera: Path, out: Path | None) -> dict[str, Piece]:
    """Return the scenes of a folder by key, each with each source that it has, and where its evidence is kept."""
    found: dict[str, tuple[Asked | AskedPulleys, Source]] = {}
    for scene in clevrer_scenes(folder, camera):
        given = {"video": scene.video, "annotation": scene.annotation}
        found |= {f"clevrer-{scene.number}-{s}": (scene, s) for s in sources if given[s] is not None}
    for video in pulley_scenes(folder):
        found |= {
            f"pulleys-{video.number}-{s}": (video, s) for s in sources if s == "annotation" or video.video is not None
        }
    stores = None if out is None else out / "stores"
    return {key: (*piece, None if stores is None else stores / f"{key}.db") for key, piece in found.items()}


def answer(pieces: Mapping[str, Piece], executor: str, out: Path | None) -> list[SceneRun]:
    """Run the scenes that `out` does not hold yet; a scene that fails as a whole is reported as failed."""
    done: dict[str, SceneRun] = {}
    if out is not None:
        for part in ("answers", "stores"):
            (out / part).mkdir(parents=True, exist_ok=True)
        for key in pieces:
            if (out / "answers" / f"{key}.json").exists():
                done[key] = SceneRun.from_dict(json.loads((out / "answers" / f"{key}.json").read_text()))
    left = {key: piece for key, piece in pieces.items() if key not in done}
    started = time.perf_counter()
    with executor_from(executor) as workers:
        for number, (key, outcome) in enumerate(workers.run(run_piece, left), start=1):
            if isinstance(outcome, Failure):
                outcome = _lost(pieces[key], outcome.error)
            elif out is not None:
                unfinished = out / "answers" / f"{key}.part"
                unfinished.write_text(json.dumps(outcome.to_dict()))
                unfinished.rename(unfinished.with_suffix(".json"))
            done[key] = outcome
            passed = time.perf_counter() - started
            print(f"[{passed:5.0f} s] {number} of {len(left)}: {_in_words(key, outcome)}", file=sys.stderr, flush=True)
    return [done[key] for key in pieces]


def _lost(piece: Piece, why: str) -> SceneRun:
    """Return a scene that failed as a whole: its questions count as not answered."""
    scene, source, _ = piece
    if isinstance(scene, AskedPulleys):
        return questions_pulleys.unanswered(scene, source, why)
    return questions_clevrer.unanswered(scene, source, why)


def _in_words(key: str, run: SceneRun) -> str:
    right = sum(q.correct for q in run.questions)
    failed = "" if run.failed is None else f", failed: {run.failed[:120]}"
    return f"{key}: {right} of {len(run.questions)} questions right, {run.seconds:.0f} s{failed}"


def report(runs: Sequence[SceneRun], source: str) -> dict[str, Any]:
    """Return all figures of one source."""
    own = [r for r in runs if r.source == source]
    asked = [q for r in own for q in r.questions]
    return {
        "scenes": len(own),
        "seconds_per_scene": sum(r.seconds for r in own) / max(len(own), 1),
        "rows": [row.to_dict() for row in rows(asked)],
        "wrong_by_cause": causes(asked),
        "failed": {f"{r.group} {r.scene}": r.failed for r in own if r.failed is not None},
    }


def _print(runs: Sequence[SceneRun], source: str) -> None:
    own = [r for r in runs if r.source == source]
    about = report(runs, source)
    print(f"\nfrom the {source}: {len(own)} scenes, {about['seconds_per_scene']:.0f} s a scene; 95% Wilson intervals")
    print_rows(rows([q for r in own for q in r.questions]), print)
    for kind, counts in about["wrong_by_cause"].items():
        print(f"wrong, {kind}: {', '.join(f'{n} {why}' for why, n in counts.most_common())}")
    for scene, why in about["failed"].items():
        print(f"failed, {scene}: {why}")


def _drawn(folder: Path, solids: str, pulleys: str) -> Path:
    draw = [sys.executable, "-m", "tests.benchmarks.question_clips", "--out", str(folder)]
    subprocess.run([*draw, "--solids", solids, "--pulleys", pulleys], check=True, cwd=Path(__file__).parents[2])
    return folder


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns the process's exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="laid out like the official downloads")
    parser.add_argument("--camera", type=Path, default=default_folder() / CAMERA, help="of folders without one")
    parser.add_argument("--solids", metavar="A-B", help=f"seeds of scenes of CLEVRER's kind (default: {SOLIDS})")
    parser.add_argument("--pulleys", metavar="A-B", help=f"seeds of rope and pulley scenes (default: {PULLEYS})")
    parser.add_argument("--full", action="store_true", help=f"seeds {FULL_SOLIDS} and {FULL_PULLEYS}")
    parser.add_argument("--source", nargs="+", choices=("video", "annotation"), default=["video"])
    parser.add_argument("--out", type=Path, metavar="DIR", help="keep drawn scenes and finished ones here")
    parser.add_argument("--json", action="store_true")
    add_executor_argument(parser)
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as scratch:
        folder: Path | None = chosen.data
        if folder is None:
            neither = chosen.solids is None and chosen.pulleys is None
            solids = chosen.solids or ((FULL_SOLIDS if chosen.full else SOLIDS) if neither else "")
            pulleys = chosen.pulleys or ((FULL_PULLEYS if chosen.full else PULLEYS) if neither else "")
            folder = _drawn((chosen.out or Path(scratch)) / "scenes", solids, pulleys)
        pieces = pieces_of(folder, chosen.source, chosen.camera, chosen.out)
        if not pieces:
            print(f"no scenes with questions in {folder}: {pieces_of.__doc__}", file=sys.stderr)
            return 2
        runs = answer(pieces, chosen.executor, chosen.out)
    if chosen.json:
        whole = {s: report(runs, s) for s in chosen.source} | {"runs": [r.to_dict() for r in runs]}
        print(json.dumps(whole))
        return 0
    for source in chosen.source:
        _print(runs, source)
    return 0


if __name__ == "__main__":
    sys.exit(main())
