"""Checksums of records: written with them in one transaction, verified whenever they are read.

A checksum is the SHA-256 of a table's name and a row's values. It shows damage to the file and changes made past
this package; it is no signature. The payload and the pictures of evidence have checksums of their own, which the one of
the row covers, so that a listing need not read them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from evidence_store.errors import RecordDamaged

Row = Mapping[str, Any]

COLUMNS: Mapping[str, tuple[str, ...]] = {
    "worlds": ("id", "document"),
    "world_parents": ("child", "parent", "how", "detail"),
    "observations": ("id", "kind", "inputs", "document", "arrays"),
    "rollouts": ("id", "kind", "inputs", "document", "arrays"),
    "fits": ("id", "kind", "inputs", "document", "arrays"),
    "cases": ("id", "content", "kind", "path", "facts", "committed_world", "seq"),
    "questions": ("seq", "case_id", "text"),
    "case_observations": ("seq", "case_id", "kind", "observation_id"),
    "case_worlds": ("seq", "case_id", "world_id", "origin", "observation_id"),
    "bindings": ("seq", "case_id", "name", "track", "object", "reason"),
    "answers": ("seq", "case_id", "question", "answer", "confidence", "evidence", "missing"),
    "evidence": (
        *("seq", "case_id", "tool", "arguments", "world_id", "rollout_id", "observation_id", "objects", "interval"),
        *("status", "summary", "payload_checksum", "attachments_checksum"),
    ),
}
"""Values that the checksum of each table's rows covers; the tables stand after those they refer to."""

PARTS = {"payload": "payload_checksum", "attachments": "attachments_checksum"}
"""Long values of a row of evidence and the values of the row that are their checksums."""


def checksum(table: str, values: Iterable[Any]) -> str:
    """SHA-256 of a table's name and of values as SQLite returns them, each with its type and length."""
    digest = hashlib.sha256(table.encode())
    for value in values:
        if value is None or value != value:  # SQLite stores NaN as NULL
            kind, data = b"n", b""
        elif isinstance(value, bytes):
            kind, data = b"b", value
        elif isinstance(value, str):
            kind, data = b"t", value.encode("utf-8", "surrogateescape")
        else:
            kind, data = b"r", repr(value).encode()
        digest.update(b"%b%d:" % (kind, len(data)))
        digest.update(data)
    return digest.hexdigest()


def stamped(table: str, row: Row) -> dict[str, Any]:
    """Return a row with its checksums; a row of evidence read without long values keeps theirs."""
    marked = dict(row)
    if table == "evidence":
        marked.update({kept: checksum(part, [row[part]]) for part, kept in PARTS.items() if part in row})
    marked["checksum"] = checksum(table, [marked[name] for name in COLUMNS[table]])
    return marked


def intact(table: str, row: Row) -> bool:
    """Whether all values that the row has are those that were written."""
    return stamped(table, row) == row


def verified(path: Path, table: str, rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows; raises RecordDamaged for the first one that is not intact."""
    checked = []
    for row in rows:
        if not intact(table, row):
            raise RecordDamaged(
                f"{label(table, row)} in the evidence store {path} is damaged (its checksum does not fit) and is not "
                f"returned. Next: `atw-mcp doctor --store {path}` lists what is damaged; with --repair it recovers "
                "all other records"
            )
        checked.append(row)
    return checked


def label(table: str, row: Row) -> str:
    """Name a record for readers, e.g. "evidence ev-12" or "a question of case 'ball'"."""
    if table == "evidence":
        return f"evidence ev-{row['seq']}"
    if table == "world_parents":
        return f"the origin of world {row['child']!r} from {row['parent']!r}"
    if "id" in COLUMNS[table]:
        return f"{table.removesuffix('s')} {row['id']!r}"
    kinds = {
        "questions": "a question",
        "case_observations": "an observation",
        "case_worlds": "a world",
        "bindings": "a binding",
        "answers": "an answer",
    }
    return f"{kinds[table]} (number {row['seq']}) of case {row['case_id']!r}"


def text_of(raw: bytes) -> str:
    """Text of a value; bytes that are no UTF-8, in a damaged row, become characters that its checksum does not fit."""
    return raw.decode("utf-8", "surrogateescape")
