"""Who is working on what: progress, cancellation, and how a slow worker is distinguished from a dead one."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from evidence_store.connection import Connection
from evidence_store.evidence import sequence_number

SILENCE = 30.0  # [s] without a heartbeat after which a worker counts as dead; it beats every few seconds


@dataclass(frozen=True)
class Job:
    """Work under way for one evidence record.

    curve: the error so far as the worker reports it, JSON-ready; None where it reports none.
    """

    evidence: str
    key: str
    host: str
    pid: int
    heartbeat: float
    done: float
    total: float | None
    message: str
    cancel_requested: bool
    curve: dict[str, Any] | None = None

    def alive(self) -> bool:
        """Whether the process that works on it still shows signs of life."""
        if self.host == platform.node() and os.name == "posix" and not _process_exists(self.pid):
            return False
        return time.time() - self.heartbeat < SILENCE


class Jobs:
    """The jobs of a store."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def start(self, evidence: str, key: str) -> None:
        """Note that this process works on an evidence record."""
        with self._connection.write() as database:
            database.table("jobs").insert(
                {
                    "evidence_seq": sequence_number(evidence),
                    "key": key,
                    "host": platform.node(),
                    "pid": os.getpid(),
                    "heartbeat": time.time(),
                }
            )

    def beat(
        self,
        evidence: str,
        done: float,
        total: float | None,
        message: str,
        curve: Mapping[str, Any] | None = None,
    ) -> None:
        """Sign of life, with how far the work is and its error so far."""
        drawn = None if curve is None else json.dumps(curve, separators=(",", ":"))
        with self._connection.write() as database:
            database.conn.execute(
                "UPDATE jobs SET heartbeat = ?, done = ?, total = ?, message = ?, curve = ? WHERE evidence_seq = ?",
                [time.time(), done, total, message, drawn, sequence_number(evidence)],
            )

    def request_cancel(self, evidence: str) -> None:
        """Ask the worker, in whatever process it runs, to stop."""
        with self._connection.write() as database:
            database.conn.execute(
                "UPDATE jobs SET cancel_requested = 1 WHERE evidence_seq = ?", [sequence_number(evidence)]
            )

    def finish(self, evidence: str) -> None:
        """The work is over, however it ended."""
        with self._connection.write() as database:
            database.conn.execute("DELETE FROM jobs WHERE evidence_seq = ?", [sequence_number(evidence)])

    def get(self, evidence: str) -> Job | None:
        """The job of an evidence record, or None when nothing works on it."""
        with self._connection.read() as database:
            rows = list(database.query("SELECT * FROM jobs WHERE evidence_seq = ?", [sequence_number(evidence)]))
        return job_of(rows[0]) if rows else None

    def working_on(self, key: str) -> Job | None:
        """The living job that computes `key`, if there is one."""
        with self._connection.read() as database:
            rows = list(database.query("SELECT * FROM jobs WHERE key = ? ORDER BY evidence_seq", [key]))
        return next((job for job in map(job_of, rows) if job.alive() and not job.cancel_requested), None)

    def all(self) -> list[Job]:
        """Every job, living or not."""
        with self._connection.read() as database:
            return [job_of(row) for row in database.query("SELECT * FROM jobs ORDER BY evidence_seq")]


def job_of(row: dict[str, Any]) -> Job:
    """A row of the table, of this version or of the one before, as a job."""
    drawn = row.get("curve")
    return Job(
        evidence=f"ev-{row['evidence_seq']}",
        key=row["key"],
        host=row["host"],
        pid=row["pid"],
        heartbeat=row["heartbeat"],
        done=row["done"],
        total=row["total"],
        message=row["message"],
        cancel_requested=bool(row["cancel_requested"]),
        curve=None if drawn is None else json.loads(drawn),
    )


def _process_exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
