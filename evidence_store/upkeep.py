"""Upkeep of a healthy store: copies of it while it is used, and removal of what nothing refers to."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from evidence_store.checksums import text_of
from evidence_store.connection import Connection
from evidence_store.errors import StoreError, StoreLocked, UnknownRecord
from evidence_store.references import CONTENTS, referred
from evidence_store.sqlite_errors import plain_errors

PATIENCE = 2.0  # [s] to wait for the file's other users to be done
RELATIONS = ("questions", "case_observations", "case_worlds", "bindings", "answers")


@dataclass(frozen=True)
class Pruned:
    """What was removed, or would be: records of each table, and the file's size before and after [bytes]."""

    removed: dict[str, int]
    before: int
    after: int | None


def backup(path: Path, target: Path) -> int:
    """Copy a store, also while servers use it; returns the copy's size [bytes]. Raises StoreError where target exists.

    The copy holds what was stored at one moment, the write-ahead log included.
    """
    if not path.exists():
        raise StoreError(f"there is no evidence store at {path}: check the path, which --store FILE gives")
    if target.exists():
        raise StoreError(f"{target} exists already: choose another name, or move it away first")
    Connection(path).close()  # raises where the file is no store that can be used
    part = target.with_name(target.name + ".part")
    try:
        with plain_errors(part, PATIENCE), closing(sqlite3.connect(part)) as copy:
            with plain_errors(path, PATIENCE), closing(sqlite3.connect(path, timeout=PATIENCE)) as source:
                source.backup(copy)
            copy.execute("PRAGMA journal_mode = DELETE")  # one file, with nothing beside it
            copy.execute("PRAGMA journal_mode = WAL")
        part.replace(target)
    except OSError as error:
        raise StoreError(f"{target} cannot be written ({error.strerror}): choose another place") from error
    finally:
        part.unlink(missing_ok=True)
    return target.stat().st_size


def prune(path: Path, *, cases: Iterable[str] = (), worlds: bool = False, dry_run: bool = False) -> Pruned:
    """Remove cached observations, rollouts and fits that nothing refers to, and whole cases that are named.

    `evidence_store.references` says what refers to what. Ids of evidence are never used again. worlds: also those that
    nothing refers to, as with the cases that are named. dry_run: only count.
    Raises UnknownRecord for a case that does not exist, StoreLocked while another process has the file open: what it
    computes is referred to only when it is done.
    """
    if not path.exists():
        raise StoreError(f"there is no evidence store at {path}: check the path, which --store FILE gives")
    Connection(path).close()  # raises where the file is no store that can be used; migrates an older one
    before, named = path.stat().st_size, list(cases)
    with plain_errors(path, PATIENCE), closing(sqlite3.connect(path, timeout=PATIENCE)) as database:
        database.text_factory = text_of
        database.execute("PRAGMA foreign_keys = ON")
        database.execute("PRAGMA locking_mode = EXCLUSIVE")  # before the first read: fails where others have it open
        try:
            database.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError as error:
            raise StoreLocked(f"another process uses {path} ({error}): end the servers first") from error
        removed = _remove_cases(database, named)
        removed |= _remove_unreferenced(database, with_worlds=worlds or bool(named))
        if dry_run:
            database.rollback()
            return Pruned(removed, before, None)
        database.commit()
        database.execute("VACUUM")
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
    return Pruned(removed, before, path.stat().st_size)


def _remove_cases(database: sqlite3.Connection, cases: list[str]) -> dict[str, int]:
    if not cases:
        return {}
    known = [name for (name,) in database.execute("SELECT id FROM cases ORDER BY seq")]
    for case in cases:
        if case not in known:
            raise UnknownRecord(f"no case {case!r}; cases: {known}")
    marks = ", ".join("?" * len(cases))
    database.execute(
        f"DELETE FROM jobs WHERE evidence_seq IN (SELECT seq FROM evidence WHERE case_id IN ({marks}))", cases
    )
    removed = {
        table: database.execute(f"DELETE FROM {table} WHERE case_id IN ({marks})", cases).rowcount
        for table in (*RELATIONS, "evidence")
    }
    removed["cases"] = database.execute(f"DELETE FROM cases WHERE id IN ({marks})", cases).rowcount
    return removed


def _remove_unreferenced(database: sqlite3.Connection, *, with_worlds: bool) -> dict[str, int]:
    used = referred(database)
    removed = {table: _keep(database, table, used.contents) for table in CONTENTS}
    if with_worlds:  # those of the cases that were removed; a world is no cache
        gone = [(world,) for (world,) in database.execute("SELECT id FROM worlds") if world not in used.worlds]
        database.executemany("DELETE FROM world_parents WHERE child = ?", gone)
        database.executemany("DELETE FROM world_parents WHERE parent = ?", gone)
        removed["worlds"] = _keep(database, "worlds", used.worlds)
    return removed


def _keep(database: sqlite3.Connection, table: str, kept: frozenset[str]) -> int:
    gone = [(identifier,) for (identifier,) in database.execute(f"SELECT id FROM {table}") if identifier not in kept]
    database.executemany(f"DELETE FROM {table} WHERE id = ?", gone)
    return len(gone)
