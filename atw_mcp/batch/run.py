"""A batch: what is left of it is run by an executor, and the shards of all cases are put together."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from atw_mcp.batch.case import CasePiece, run_case
from atw_mcp.batch.manifest import ManifestCase
from atw_mcp.batch.shards import CaseResult, held, keep_note, read_note, remove_unfinished, result_of, shard_file
from evidence_store.merge import merge
from polyworld.executors import Executor, Failure

Redo = Literal["changed", "failed"]
Report = Callable[[int, int, float | None, str], None]
"""Called with the cases done, the cases to run, the estimated seconds left, and what became of the last one."""


class BatchRefused(Exception):
    """A folder of results that this batch would have to overwrite; nothing was run."""


@dataclass(frozen=True)
class Batch:
    """A manifest's cases and where their results go. allow: folders that may be read. limits: those set, by name."""

    cases: Sequence[ManifestCase]
    out: Path
    allow: tuple[Path, ...] = ()
    limits: Mapping[str, Any] | None = None

    @property
    def shards(self) -> Path:
        """Folder of the shards."""
        return self.out / "shards"

    @property
    def store(self) -> Path:
        """The store of all cases together."""
        return self.out / "store.db"

    def piece(self, case: ManifestCase) -> CasePiece:
        """Return a case with all that determines its shard."""
        limits = dict(self.limits or {})
        return CasePiece(case, case.digest(limits), self.shards.absolute(), self.allow, limits)


@dataclass(frozen=True)
class Outcome:
    """Results in the order of the manifest. ran: cases run now. left_out: shards of cases the manifest has not."""

    results: tuple[CaseResult, ...]
    ran: int
    left_out: tuple[str, ...]

    @property
    def answers(self) -> list[dict[str, Any]]:
        """Rows of all answers."""
        return [row for result in self.results for row in result.answers]

    @property
    def failures(self) -> list[dict[str, Any]]:
        """Rows of all failures."""
        return [row for result in self.results for row in result.failures]


def run_batch(batch: Batch, executor: Executor, redo: Iterable[Redo] = (), report: Report | None = None) -> Outcome:
    """Run the cases that have no shard yet and put all shards together.

    redo: also those whose entry, place or files have changed since, or that failed, changed or not. Writes `store.db`,
    `answers.jsonl`, `failures.jsonl` and `times.jsonl` into the folder of results. Raises BatchRefused where others
    have changed, or another process runs a batch there; StoreError where a shard cannot be read or the stores cannot
    be merged.
    """
    batch.out.mkdir(parents=True, exist_ok=True)
    with held(batch.out) as alone:
        if not alone:
            raise BatchRefused(f"another batch is running into {batch.out}. Nothing was run. Next: wait until it ends")
        return _run(batch, executor, set(redo), report)


def _run(batch: Batch, executor: Executor, again: set[Redo], report: Report | None) -> Outcome:
    """Run a batch in a folder that this process alone works on."""
    pieces = {case.entry.id: batch.piece(case) for case in batch.cases}
    kept = {name: result for name in pieces if (result := result_of(batch.shards, name)) is not None}
    failed = {name for name, result in kept.items() if result.failures and "failed" in again}
    changed = [name for name, result in kept.items() if result.digest != pieces[name].digest and name not in failed]
    if changed and "changed" not in again:
        raise BatchRefused(_changed(changed, batch))
    repeated = {*changed, *failed}
    waiting = {name: piece for name, piece in pieces.items() if name not in kept or name in repeated}
    if waiting or _stamps(batch, pieces) != _merged(batch.store):
        _refuse_worked_on(batch.store)
    remove_unfinished(batch.shards)
    results = {name: result for name, result in kept.items() if name not in waiting}
    lost: set[str] = set()
    left: list[float | None] = [None]
    if report is not None and waiting:
        report(0, len(waiting), None, "")
    run = executor.run(run_case, waiting, progress=lambda _done, _all, seconds: left.__setitem__(0, seconds))
    for done, (name, outcome) in enumerate(run, start=1):
        if isinstance(outcome, Failure):
            lost.add(name)
            outcome = _lost(pieces[name], outcome)
        results[name] = outcome
        if report is not None:
            report(done, len(waiting), left[0], _in_a_line(results[name]))
    whole = Outcome(
        tuple(results[name] for name in pieces),
        len(waiting),
        tuple(sorted(path.stem for path in batch.shards.glob("*.db") if path.stem not in pieces)),
    )
    _merge(batch, [name for name in pieces if name not in lost])
    _write(batch.out, whole)
    return whole


def _changed(names: list[str], batch: Batch) -> str:
    listed = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    return (
        f"{batch.shards} has results of {listed} from before the manifest, their files or the limits changed, or from "
        "another place in the manifest (the ids of evidence follow the place: append new cases at the end). Nothing "
        "was run. Next: --redo changed runs them again, in place of those results; or choose another --out"
    )


def _refuse_worked_on(store: Path) -> None:
    """Refuse to replace a store that holds more than was merged into it."""
    if not store.exists():
        return
    note = read_note(store)
    count = _evidence_in(store)
    if note is None or count != note["evidence"]:
        more = "is not from a batch" if note is None else f"has {count - note['evidence']} records of later work"
        raise BatchRefused(
            f"{store} {more}, and merging would replace it. Nothing was run. Next: move it away; the shards have all "
            "that the batch itself found"
        )


def _evidence_in(store: Path) -> int:
    with closing(sqlite3.connect(f"{store.absolute().as_uri()}?mode=rw", uri=True)) as database:
        (count,) = database.execute("SELECT count(*) FROM evidence").fetchone()
    return int(count)


def _lost(piece: CasePiece, failure: Failure) -> CaseResult:
    """Return the result of a case whose worker died or could not write; it has no shard and is run again next time."""
    row = {"case": piece.case.entry.id, "question": None, "step": "worker", "reason": failure.error, "evidence": None}
    return CaseResult(piece.case.entry.id, piece.digest, failures=[row])


def _in_a_line(result: CaseResult) -> str:
    said = f"{len(result.answers)} answered" if result.answers or not result.failures else "failed"
    more = f", {len(result.failures)} failed" if result.failures and result.answers else ""
    return f"{result.case}: {said}{more} in {result.seconds:.3g} s"


def _stamps(batch: Batch, names: Iterable[str]) -> dict[str, int]:
    """Return when each shard there is was written, in the order of the names."""
    files = [shard_file(batch.shards, name) for name in names]
    return {file.stem: file.stat().st_mtime_ns for file in files if file.exists()}


def _merged(store: Path) -> dict[str, int] | None:
    """Return the shards of which the store was made, as `_stamps` does; None where a batch made none."""
    note = read_note(store) if store.exists() else None
    return None if note is None else note["shards"]


def _merge(batch: Batch, names: Iterable[str]) -> None:
    """Merge shards in the order of the names, unless the store has just these."""
    stamps = _stamps(batch, names)
    if list(stamps.items()) == list((_merged(batch.store) or {}).items()) and batch.store.exists():
        return
    part = batch.store.with_name(f"{batch.store.name}.part")
    for ending in ("", "-wal", "-shm"):
        part.with_name(part.name + ending).unlink(missing_ok=True)
    count = merge([shard_file(batch.shards, name) for name in stamps], part)
    keep_note(part, {"evidence": count, "shards": stamps})
    os.replace(part, batch.store)


def _write(out: Path, outcome: Outcome) -> None:
    times = [
        {"case": result.case, "question": question, "seconds": seconds}
        for result in outcome.results
        for question, seconds in [(None, result.seconds), *result.question_seconds.items()]
    ]
    for name, rows in (("answers", outcome.answers), ("failures", outcome.failures), ("times", times)):
        part = out / f"{name}.jsonl.part"
        part.write_text("".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows), encoding="utf-8")
        os.replace(part, out / f"{name}.jsonl")
