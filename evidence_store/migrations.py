"""Steps that bring a store of an older version up to date, inside one transaction."""

from __future__ import annotations

import io
import json
import sqlite3
import zipfile
from collections.abc import Callable, Mapping
from typing import Any

from evidence_store.checksums import COLUMNS, PARTS, stamped
from evidence_store.schema import EVIDENCE_INDICES, TASKS

JSON_COLUMNS = ("facts", "inputs", "document", "detail", "arguments", "objects", "interval", "payload", "evidence")
PACKED_COLUMNS = ("arrays", "attachments")


def migrate(connection: sqlite3.Connection, version: int, target: int) -> None:
    """Bring the tables from `version` to `target`; the caller holds the write transaction."""
    for step in range(version, target):
        MIGRATIONS[step](connection)


def _add_checksums(connection: sqlite3.Connection) -> None:
    """Version 1 to 2. A record that cannot be read gets no valid checksum, so that it counts as damaged."""
    connection.execute(TASKS)
    for column in PARTS.values():
        connection.execute(f"ALTER TABLE evidence ADD COLUMN {column} TEXT NOT NULL DEFAULT ''")
    for table in COLUMNS:
        connection.execute(f"ALTER TABLE {table} ADD COLUMN checksum TEXT NOT NULL DEFAULT ''")
        rowids = [rowid for (rowid,) in connection.execute(f"SELECT rowid FROM {table}").fetchall()]
        for rowid in rowids:  # one row at a time: arrays may be large
            cursor = connection.execute(f"SELECT * FROM {table} WHERE rowid = ?", [rowid])
            row = dict(zip((column[0] for column in cursor.description), cursor.fetchone(), strict=True))
            if not readable(row):
                continue
            marked = stamped(table, row)
            columns = ["checksum", *(PARTS.values() if table == "evidence" else ())]
            connection.execute(
                f"UPDATE {table} SET {', '.join(f'{column} = ?' for column in columns)} WHERE rowid = ?",
                [*(marked[column] for column in columns), rowid],
            )


def _index_evidence(connection: sqlite3.Connection) -> None:
    """Version 2 to 3."""
    connection.execute("DROP INDEX IF EXISTS evidence_by_case")
    for statement in EVIDENCE_INDICES.split(";\n"):
        if statement.strip():
            connection.execute(statement)


def _add_curves(connection: sqlite3.Connection) -> None:
    """Version 3 to 4."""
    connection.execute("ALTER TABLE jobs ADD COLUMN curve TEXT")


def readable(row: Mapping[str, Any]) -> bool:
    """Whether the JSON of a row can be parsed and its packed arrays fit the CRC-32 that npz files carry."""
    try:
        for name, value in row.items():
            if value is None:
                continue
            if name in JSON_COLUMNS:
                json.loads(value)
            elif name in PACKED_COLUMNS:
                with zipfile.ZipFile(io.BytesIO(value)) as packed:
                    if packed.testzip() is not None:
                        return False
            elif isinstance(value, str):
                value.encode()
    except (ValueError, TypeError, zipfile.BadZipFile, OSError, EOFError, NotImplementedError):
        return False
    return True


MIGRATIONS: Mapping[int, Callable[[sqlite3.Connection], None]] = {1: _add_checksums, 2: _index_evidence, 3: _add_curves}
"""The step from each version to the next."""
