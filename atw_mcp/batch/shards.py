"""Shards: the store of one case with, in a table beside the records, what the batch needs to know of it.

A shard is written under another name and renamed when it is complete, so that there is none of a case whose process
was killed.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from evidence_store import StoreError

TABLE = "batch"
UNFINISHED = ".unfinished-"  # begins the names of folders of shards under way
LOCK = ".lock"  # a database that one run holds; SQLite frees it when its process ends, however it ends


@dataclass
class CaseResult:
    """Result of one case. digest: that of its entry. answers, failures: rows as they are written for the user.

    verdict: of its fit. seconds: of the whole case; question_seconds: of each question, by its id.
    """

    case: str
    digest: str
    verdict: str | None = None
    doubts: list[str] = field(default_factory=list)
    answers: list[dict[str, Any]] = field(default_factory=list)
    failures: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0
    question_seconds: dict[str, float] = field(default_factory=dict)


def shard_file(folder: Path, case: str) -> Path:
    """Return where the shard of a case is, or is to be."""
    return folder / f"{case}.db"


@contextmanager
def new_shard(folder: Path, case: str) -> Iterator[Path]:
    """Yield the path of a store to fill and close, which becomes the shard of the case once `keep_note` was called."""
    folder.mkdir(parents=True, exist_ok=True)
    own = Path(tempfile.mkdtemp(prefix=f"{UNFINISHED}{case}.", dir=folder))
    try:
        yield own / "case.db"
        os.replace(own / "case.db", shard_file(folder, case))
    finally:
        shutil.rmtree(own, ignore_errors=True)


@contextmanager
def held(folder: Path) -> Iterator[bool]:
    """Hold a folder of results, and yield whether no other process does; raises StoreError where none can."""
    alone = True
    with ExitStack() as opened:
        try:
            database = sqlite3.connect(folder / LOCK, timeout=0.0, isolation_level=None)
            opened.enter_context(closing(database)).execute("BEGIN EXCLUSIVE")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY:
                raise StoreError(f"{folder} cannot be written ({error}): choose another --out") from error
            alone = False
        yield alone


def remove_unfinished(folder: Path) -> None:
    """Remove what killed processes left."""
    for left in folder.glob(f"{UNFINISHED}*"):
        shutil.rmtree(left, ignore_errors=True)


def under_way(folder: Path) -> dict[str, str]:
    """Return how far the cases are that processes work on now: what they report, by case, where they do."""
    found = {}
    for own in folder.glob(f"{UNFINISHED}*"):
        case = own.name.removeprefix(UNFINISHED).rpartition(".")[0]
        try:
            with closing(sqlite3.connect(f"{(own / 'case.db').absolute().as_uri()}?mode=ro", uri=True)) as database:
                rows = database.execute("SELECT message FROM jobs WHERE message != '' ORDER BY evidence_seq").fetchall()
        except sqlite3.Error:  # not made yet, or complete by now
            continue
        if rows:
            found[case] = str(rows[0][0])  # of the outermost piece of work
    return found


def result_of(folder: Path, case: str) -> CaseResult | None:
    """Return the result that the shard of a case holds; None where there is no shard."""
    file = shard_file(folder, case)
    note = read_note(file) if file.exists() else None
    if note is None:
        return None
    return CaseResult(**note)


def keep_result(store: Path, result: CaseResult) -> None:
    """Write the result of a case into its closed store, which is only read from then on."""
    keep_note(store, asdict(result))
    with closing(sqlite3.connect(store)) as database:  # with a log, SQLite would keep files beside one that is read
        database.execute("PRAGMA journal_mode = DELETE")


def keep_note(store: Path, note: dict[str, Any]) -> None:
    """Write a JSON object beside the records of a closed store."""
    with closing(sqlite3.connect(store)) as database, database:
        database.execute(f"CREATE TABLE {TABLE} (note TEXT NOT NULL)")
        database.execute(f"INSERT INTO {TABLE} VALUES (?)", [json.dumps(note)])


def read_note(store: Path) -> dict[str, Any] | None:
    """Return what `keep_note` wrote; None where it wrote nothing. Raises StoreError for a file that is no store."""
    try:
        with closing(sqlite3.connect(f"{store.absolute().as_uri()}?mode=rw", uri=True)) as database:
            if not database.execute("SELECT 1 FROM sqlite_master WHERE name = ?", [TABLE]).fetchone():
                return None
            (note,) = database.execute(f"SELECT note FROM {TABLE}").fetchone()
    except sqlite3.Error as error:
        raise StoreError(f"{store} cannot be read ({error}): move it away, and its case is run again") from error
    found: dict[str, Any] = json.loads(note)
    return found
