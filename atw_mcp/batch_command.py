"""`atw-mcp batch`: fit, probe and answer the cases of a manifest."""

from __future__ import annotations

import argparse
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from atw_mcp.allowed_paths import add_allow
from atw_mcp.printing import ProgressLine

if TYPE_CHECKING:
    from atw_mcp.batch.run import Outcome

OK, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130
LOOK_AGAIN = 1.0  # [s] between two looks at what is under way; its processes report once a second
HELP = """\
Model every case of a manifest, commit its world and ask it its questions, by the same tools as an agent. A line is
one case, a JSON object (`atw-mcp schema manifest`); paths are relative to the manifest:

  {"id": "drop", "tracks": "drop.csv", "objects": [{"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}}],
   "questions": [{"id": "lands", "text": "Does it land?", "predicate": {"predicate": "collides", "a": "ball"},
                  "edits": [], "horizon_seconds": 2, "how_sure": true}]}

A case that is done is not run again: after an interruption the same command goes on. FOLDER gets answers.jsonl,
failures.jsonl, times.jsonl, store.db with all evidence (`atw-mcp report CASE --store FOLDER/store.db`), and shards.
"""


def add_parser(commands: Any) -> None:
    """Declare the command."""
    batch = commands.add_parser(
        "batch",
        help="fit, probe and answer a list of cases, on this machine or on a cluster",
        description=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    batch.add_argument("manifest", type=Path, metavar="MANIFEST.jsonl")
    batch.add_argument("--out", type=Path, metavar="FOLDER", help="where results go, or are to be continued")
    batch.add_argument("--check", action="store_true", help="only say what is wrong with the manifest")
    batch.add_argument(
        "--redo",
        action="append",
        default=[],
        choices=("changed", "failed"),
        help="also run again the cases whose entry or files have changed, or that failed; repeatable",
    )
    batch.add_argument("--limits", type=Path, metavar="FILE.toml", help="limits of what one call may ask for")
    batch.add_argument(  # not by `polyworld.executors`, which needs NumPy: every command declares this one
        "--executor",
        default="local",
        metavar="WHERE",
        help="local:WORKERS, dask, dask:ADDRESS, or serial, in this process (default: local, a worker a core)",
    )
    add_allow(batch)
    batch.set_defaults(command=run)


def run(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code: 0 all cases ran, 1 some failed, 2 the manifest cannot be run."""
    from atw_mcp.batch.manifest import ManifestError, read_manifest
    from atw_mcp.batch.run import Batch, BatchRefused, run_batch
    from atw_mcp.calls.files import allowed_folders
    from atw_mcp.calls.limits import Limits, LimitsError
    from evidence_store import StoreError
    from polyworld.executors import executor_from

    if options.out is None and not options.check:
        return _refused("--out FOLDER is needed: where the results go")
    try:
        cases = read_manifest(options.manifest, look_for_files=options.check)
    except ManifestError as error:
        return _refused(*(f"{options.manifest}: {finding}" for finding in error.findings))
    except (OSError, UnicodeDecodeError) as error:
        return _refused(f"{options.manifest}: {error}")
    if options.check:
        asked = sum(len(case.entry.questions) for case in cases)
        print(f"{options.manifest}: {len(cases)} cases with {asked} questions, nothing wrong")
        return OK
    line = _Progress(options.out / "shards")
    try:
        limits = Limits.read(options.limits).model_dump(exclude_unset=True)
        folder = options.manifest.absolute().parent
        allow = tuple(path.absolute() for path in allowed_folders([folder, *options.allow]))
        options.out.mkdir(parents=True, exist_ok=True)
        with executor_from(options.executor) as executor:
            outcome = run_batch(
                Batch(cases, options.out.absolute(), allow, limits), executor, options.redo, line.report
            )
    except (BatchRefused, LimitsError, StoreError, ValueError, RuntimeError, OSError) as error:
        line.clear()
        return _refused(str(error))
    except KeyboardInterrupt:
        line.clear()
        print("atw-mcp: interrupted; the cases that are done are kept, and the same command goes on", file=sys.stderr)
        return INTERRUPTED
    line.clear()
    for row in _table(outcome):
        print(row)
    kept = len(outcome.results) - outcome.ran
    print(
        f"{len(outcome.results)} cases ({kept} done before), {len(outcome.answers)} answers, "
        f"{len(outcome.failures)} failures: {options.out}"
    )
    if outcome.left_out:
        print(f"not merged, because the manifest does not have them: {', '.join(outcome.left_out)}")
    return FAILED if outcome.failures else OK


class _Progress:
    """Cases done, the time left, and what is under way: a line kept up to date on a terminal, else a line a case."""

    def __init__(self, shards: Path) -> None:
        self._shards, self._line, self._ended = shards, ProgressLine(), threading.Event()
        self._state: tuple[int, int, float | None] | None = None
        self._since = time.monotonic()
        self._thread = threading.Thread(target=self._follow, daemon=True, name="batch-progress")
        if sys.stderr.isatty():
            self._thread.start()

    def report(self, done: int, total: int, seconds: float | None, last: str) -> None:
        """Take note of how far the batch is."""
        if last and not sys.stderr.isatty():
            print(last, file=sys.stderr)
        self._state, self._since = (done, total, seconds), time.monotonic()

    def clear(self) -> None:
        """Stop, and remove the line."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self._line.clear()

    def _follow(self) -> None:
        from atw_mcp.batch.shards import under_way
        from polyworld.solver.core.patience import in_words

        while not self._ended.wait(LOOK_AGAIN):
            if self._state is None:
                continue
            done, total, seconds = self._state
            rest = None if seconds is None or done == total else seconds - (time.monotonic() - self._since)
            left = f", about {in_words(rest)} left" if rest is not None and rest > 1.0 else ""
            now = "".join(f"; {case}: {message}" for case, message in sorted(under_way(self._shards).items()))
            self._line.show(done, total, f"{done} of {total} cases{left}{now}")


def _table(outcome: Outcome) -> Iterator[str]:
    """Yield a line for each answer and failure, in the order of the manifest."""
    rows = [("case", "question", "answer", "fit", "seconds")]
    for result in outcome.results:
        said = {**{row["question"]: _answer(row) for row in result.answers}}
        said |= {row["question"]: f"FAILED at {row['step']}: {row['reason']}" for row in result.failures}
        for question, text in said.items() or [(None, "modelled, nothing asked")]:
            seconds = result.seconds if question is None else result.question_seconds.get(question, 0.0)
            rows.append((result.case, question or "", text, result.verdict or "", f"{seconds:.3g}"))
    rows = [(a, b, textwrap.shorten(c, 80, placeholder=" ..."), d, e) for a, b, c, d, e in rows]
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    for row in rows:
        yield "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()


def _answer(row: dict[str, Any]) -> str:
    answer = row["answer"]
    if answer is None:
        return f"unknown: {row['missing']}"
    said = str(answer).lower() if isinstance(answer, bool) else answer if isinstance(answer, str) else f"{answer:.4g}"
    unit = f" {row['unit']}" if row["unit"] else ""
    chance = "" if row["probability"] is None else f", probability of true {row['probability']:.2f}"
    return f"{said}{unit}{chance}"


def _refused(*sentences: str) -> int:
    for sentence in sentences:
        print(f"atw-mcp: {sentence}", file=sys.stderr)
    return USAGE
