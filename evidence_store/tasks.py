"""Tasks: unguessable handles by which clients follow running work, kept for as long as its evidence."""

from __future__ import annotations

import json
import secrets
import time
from dataclasses import dataclass
from typing import Any

from sqlite_utils import Database

from evidence_store.connection import Connection
from evidence_store.errors import UnknownRecord
from evidence_store.evidence import sequence_number

SECRET_BYTES = 16  # 128 bits: whoever knows a task's id may read and cancel it


@dataclass(frozen=True)
class Task:
    """Handle of the work for one evidence record.

    created, ended: Unix times [s]; ended None while it runs. error: code and message where the work ended without
    an answer of its tool.
    """

    evidence: str
    secret: str
    created: float
    ended: float | None = None
    error: dict[str, Any] | None = None

    @property
    def id(self) -> str:
        """Id of the task: that of its evidence, and the secret."""
        return f"{self.evidence}.{self.secret}"


class Tasks:
    """The tasks of a store."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def open(self, evidence: str) -> Task:
        """Return the task of an evidence record, made where there is none yet."""
        with self._connection.write() as database:
            database.conn.execute(
                "INSERT OR IGNORE INTO tasks (evidence_seq, secret, created) VALUES (?, ?, ?)",
                [sequence_number(evidence), secrets.token_urlsafe(SECRET_BYTES), time.time()],
            )
            task = _of(database, evidence)
        assert task is not None
        return task

    def get(self, identifier: str) -> Task:
        """Return the task of an id; raises UnknownRecord."""
        evidence, _, secret = identifier.partition(".")
        with self._connection.read() as database:
            task = _of(database, evidence)
        if task is None or not secrets.compare_digest(task.secret.encode(), secret.encode()):
            raise UnknownRecord(f"no task has the id {identifier[:80]!r}")
        return task

    def end(self, evidence: str, error: dict[str, Any] | None = None) -> None:
        """Record that the work of an evidence record has ended; nothing happens where it has no task."""
        with self._connection.write() as database:
            database.conn.execute(
                "UPDATE tasks SET ended = ?, error = ? WHERE evidence_seq = ?",
                [time.time(), None if error is None else json.dumps(error), sequence_number(evidence)],
            )


def _of(database: Database, evidence: str) -> Task | None:
    rows = list(database.query("SELECT * FROM tasks WHERE evidence_seq = ?", [sequence_number(evidence)]))
    if not rows:
        return None
    row = rows[0]
    error = None if row["error"] is None else json.loads(row["error"])
    return Task(f"ev-{row['evidence_seq']}", row["secret"], row["created"], row["ended"], error)
