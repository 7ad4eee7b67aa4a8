"""Recovery of what can be read of a damaged store into a new one."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from evidence_store.checksums import COLUMNS, intact, label, stamped, text_of
from evidence_store.connection import Connection
from evidence_store.errors import StoreError
from evidence_store.migrations import readable
from evidence_store.sqlite_errors import plain_errors

MAGIC = b"SQLite format 3\0"
PROBED = 100_000  # rows asked for one by one where reading in order breaks off; a table of ours has fewer


@dataclass
class Recovery:
    """What became of the records of a damaged store: how many were kept, what was lost and what was changed."""

    path: Path
    kept: int = 0
    lost: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)


def recover(damaged: Path, target: Path) -> Recovery:
    """Copy every intact record of a store into a new one; the damaged file stays as it is.

    Relations to lost records are dropped. A case whose own record is lost is kept as a stand-in with its relations and
    evidence. Work that was running is marked failed. Raises StoreError where `target` exists or nothing can be read.
    """
    if target.exists():
        raise StoreError(f"{target} exists already: move it away first")
    copy = target.with_name(target.name + ".copy")
    recovery = Recovery(target)
    try:
        _copy(damaged, copy)
        with plain_errors(damaged, 0.0):
            source = sqlite3.connect(copy)
            source.text_factory = text_of
            source.execute("PRAGMA writable_schema = ON")  # else SQLite refuses a truncated file as a whole
            try:
                _fill(source, target, recovery)
            finally:
                source.close()
    except BaseException:
        _remove(target)
        raise
    finally:
        _remove(copy)
    return recovery


def _copy(damaged: Path, copy: Path) -> None:
    shutil.copyfile(damaged, copy)
    with copy.open("r+b") as file:
        if file.read(len(MAGIC)) != MAGIC:
            file.seek(0)
            file.write(MAGIC)
    log = damaged.with_name(damaged.name + "-wal")
    if log.exists():
        shutil.copyfile(log, copy.with_name(copy.name + "-wal"))


def _remove(path: Path) -> None:
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def _fill(source: sqlite3.Connection, target: Path, recovery: Recovery) -> None:
    connection = Connection(target)
    try:
        with connection.read() as database:
            database.conn.execute("PRAGMA foreign_keys = OFF")  # until the lost records are known
        with connection.write() as database:
            for table in COLUMNS:
                for row in _rows(source, table, recovery):
                    complete = _complete(table, row)
                    if complete is None:
                        recovery.lost.append(label(table, row))
                    else:
                        connection.insert(table, complete, ignore=True)
                        recovery.kept += 1
            _fail_running(connection, recovery)
            _keep_numbering(source, database.conn)
            _settle_references(connection, recovery)
        if not recovery.kept:
            raise StoreError(f"nothing can be read of the damaged store; restore a backup instead of {target}")
    finally:
        connection.close()


def _complete(table: str, row: dict[str, Any]) -> dict[str, Any] | None:
    """Return the row where it is intact, or, of version 1, where it can be read; else None."""
    if "checksum" in row:
        return row if intact(table, row) else None
    return stamped(table, row) if readable(row) else None


def _rows(source: sqlite3.Connection, table: str, recovery: Recovery) -> Iterator[dict[str, Any]]:
    """Rows of a table: from the start up to the damage, from the end back to it, and between them one by one."""
    seen: set[int] = set()
    broken = False
    for order in ("ASC", "DESC"):
        try:
            cursor = source.execute(f"SELECT rowid AS _rowid, * FROM {table} ORDER BY rowid {order}")
            for row in _dicts(cursor):
                if row["_rowid"] not in seen:
                    seen.add(row.pop("_rowid"))
                    yield row
        except sqlite3.Error:
            broken = True
        if not broken:
            return
    unreadable = 0
    for before, after in pairwise(sorted(seen)):
        for rowid in range(before + 1, min(after, before + PROBED)):
            try:
                yield from _dicts(source.execute(f"SELECT * FROM {table} WHERE rowid = ?", [rowid]))
            except sqlite3.Error:
                unreadable += 1
    recovery.lost.append(f"{unreadable or 'an unknown number of'} rows of the table {table} that cannot be read")


def _dicts(cursor: sqlite3.Cursor) -> Iterator[dict[str, Any]]:
    names = [column[0] for column in cursor.description]
    for values in cursor:
        yield dict(zip(names, values, strict=True))


def _fail_running(connection: Connection, recovery: Recovery) -> None:
    with connection.read() as database:
        rows = list(database.query("SELECT * FROM evidence WHERE status = 'running'"))
    for row in rows:
        summary = f"the store was damaged before this was done; call {row['tool']} again with the same arguments"
        connection.change("evidence", "seq", {**row, "status": "failed", "summary": summary})
        recovery.changed.append(f"evidence ev-{row['seq']} is failed")


def _keep_numbering(source: sqlite3.Connection, target: sqlite3.Connection) -> None:
    """Let no later evidence get the id of a lost one."""
    with suppress(sqlite3.Error):
        found = source.execute("SELECT seq FROM sqlite_sequence WHERE name = 'evidence'").fetchone()
        if found is not None:
            target.execute(
                "INSERT INTO sqlite_sequence SELECT 'evidence', 0 WHERE 'evidence' NOT IN "
                "(SELECT name FROM sqlite_sequence)"
            )
            target.execute("UPDATE sqlite_sequence SET seq = max(seq, ?) WHERE name = 'evidence'", found)


def _settle_references(connection: Connection, recovery: Recovery) -> None:
    with connection.read() as database:
        for table, rowid, parent, number in database.conn.execute("PRAGMA foreign_key_check").fetchall():
            keys = {row[0]: row[3] for row in database.conn.execute(f"PRAGMA foreign_key_list({table})")}
            rows = list(database.query(f"SELECT * FROM {table} WHERE rowid = ?", [rowid]))
            column = keys[number]
            if not rows or rows[0][column] is None:  # settled with another reference of the row
                continue
            row = rows[0]
            if parent == "cases":
                _stand_in(connection, row[column], recovery)
            elif column in ("committed_world", "observation_id") and table != "case_observations":
                key = "id" if table == "cases" else "seq"
                connection.change(table, key, {**row, column: None})
                recovery.changed.append(f"{label(table, row)} has no {column.replace('_', ' ')} any more")
            else:
                database.conn.execute(f"DELETE FROM {table} WHERE rowid = ?", [rowid])
                recovery.lost.append(label(table, row))


def _stand_in(connection: Connection, identifier: str, recovery: Recovery) -> None:
    with connection.read() as database:
        if database.conn.execute("SELECT 1 FROM cases WHERE id = ?", [identifier]).fetchone():
            return
        (last,) = database.conn.execute("SELECT coalesce(max(seq), 0) FROM cases").fetchone()
    connection.insert(
        "cases",
        {
            "id": identifier,
            "content": f"lost with the record of case {identifier}",
            "kind": "data",
            "path": "",
            "facts": '{"lost":true}',
            "committed_world": None,
            "seq": last + 1,
        },
    )
    recovery.changed.append(f"case {identifier!r} is a stand-in: its evidence can be read, its file is unknown")
