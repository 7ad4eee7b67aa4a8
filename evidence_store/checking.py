"""Examination of a store that may be damaged, and repair of what needs no other file."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evidence_store.checksums import COLUMNS, intact, label, text_of
from evidence_store.errors import StoreError
from evidence_store.jobs import Job, job_of
from evidence_store.schema import APPLICATION_ID, VERSION
from evidence_store.sqlite_errors import plain_error
from evidence_store.store import EvidenceStore

NAMED_AT_MOST = 20  # findings of one kind named one by one
BUSY_TIMEOUT = 10.0  # [s] to wait for a writer


@dataclass(frozen=True)
class Finding:
    """Result of one examination: what was looked at, whether it is as it should be, and what was found."""

    subject: str
    good: bool
    text: str


def check(path: Path) -> list[Finding]:
    """Examine a store without changing it: its form, its rows, its indices, its jobs and its write-ahead log.

    A file that does not exist is no fault: the first server makes it.
    """
    if not path.exists():
        return [Finding("store", True, f"{path} does not exist yet: a server makes it when it starts")]
    if path.is_dir():
        return [Finding("store", False, _NO_STORE.format(path))]
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=BUSY_TIMEOUT)
    connection.text_factory = text_of
    try:
        (stamp,) = connection.execute("PRAGMA application_id").fetchone()
        if stamp != APPLICATION_ID:
            return [Finding("store", False, _NO_STORE.format(path))]
        return [Finding("store", True, str(path)), *_findings(connection, path)]
    except sqlite3.Error as error:
        return [Finding("store", False, str(plain_error(path, error, BUSY_TIMEOUT)))]
    finally:
        connection.close()


def mend(path: Path) -> list[str]:
    """Repair a store in place, as far as that loses nothing; returns what was done.

    Brings an older version up to date, marks running work of ended processes failed, rebuilds the indices from the
    tables and brings the write-ahead log into the file. Raises StoreError where the store cannot be opened.
    """
    done = []
    store = EvidenceStore(path)
    try:
        with store.connection.read() as database:
            running = [f"ev-{seq}" for (seq,) in database.conn.execute(_RUNNING).fetchall()]
            broken_indices = not _integrity(database.conn).good
        failed = [name for name in running if _is_failed(store, name)]
        if failed:
            done.append(f"marked failed, because its process has ended: {_named(failed)}")
        for job in store.jobs.all():
            if not job.alive():
                store.jobs.finish(job.evidence)
                done.append(f"removed the job of {job.evidence}, whose process has ended")
        if broken_indices:
            with store.connection.write() as database:
                database.conn.execute("REINDEX")
            done.append("rebuilt the indices from the tables")
    finally:
        store.close()
    return done


_NO_STORE = "{} is not an evidence store, or an empty file: choose another with --store PATH"
_RUNNING = "SELECT seq FROM evidence WHERE status = 'running' ORDER BY seq"


def _is_failed(store: EvidenceStore, identifier: str) -> bool:
    try:
        return store.read_evidence(identifier).status == "failed"
    except StoreError:
        return False


def _findings(connection: sqlite3.Connection, path: Path) -> list[Finding]:
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version > VERSION:
        newer = f"version {version}, this program reads up to {VERSION}: update atw-mcp"
        return [Finding("version", False, newer)]
    older = "" if version == VERSION else f"; a server or --repair brings it to version {VERSION}"
    found = [Finding("version", True, f"{version}{older}"), _integrity(connection), _references(connection)]
    if version == VERSION:
        found.append(_checksums(connection))
    return [*found, _jobs(connection), _log(path)]


def _integrity(connection: sqlite3.Connection) -> Finding:
    try:
        rows = [text for (text,) in connection.execute(f"PRAGMA integrity_check({NAMED_AT_MOST})").fetchall()]
    except sqlite3.Error as error:
        rows = [str(error)]
    # a message of several lines names a place first and then what is wrong there
    return Finding("integrity", rows == ["ok"], "; ".join(" ".join(str(text).split()) for text in rows))


def _references(connection: sqlite3.Connection) -> Finding:
    rows = connection.execute("PRAGMA foreign_key_check").fetchall()
    broken = [f"{table} row {rowid} refers to a missing record of {parent}" for table, rowid, parent, _ in rows]
    return Finding("references", not broken, _named(broken) if broken else "every record referred to is there")


def _checksums(connection: sqlite3.Connection) -> Finding:
    count, damaged = 0, []
    for table in COLUMNS:
        try:
            cursor = connection.execute(f"SELECT * FROM {table}")
            names = [column[0] for column in cursor.description]
            for values in cursor:
                row: dict[str, Any] = dict(zip(names, values, strict=True))
                count += 1
                if not intact(table, row):
                    damaged.append(label(table, row))
        except sqlite3.Error as error:
            damaged.append(f"part of the table {table} ({error})")
    return Finding("checksums", not damaged, f"damaged: {_named(damaged)}" if damaged else f"{count} records intact")


def _jobs(connection: sqlite3.Connection) -> Finding:
    cursor = connection.execute("SELECT * FROM jobs ORDER BY evidence_seq")
    names = [column[0] for column in cursor.description]
    jobs: list[Job] = [job_of(dict(zip(names, row, strict=True))) for row in cursor]
    alive = {job.evidence for job in jobs if job.alive()}
    running = {f"ev-{seq}" for (seq,) in connection.execute(_RUNNING)}
    orphaned = sorted(({job.evidence for job in jobs} | running) - alive, key=lambda name: int(name[3:]))
    text = f"running without a living process: {_named(orphaned)}" if orphaned else f"{len(alive)} running"
    return Finding("jobs", not orphaned, text)


def _log(path: Path) -> Finding:
    log = path.with_name(path.name + "-wal")
    size = log.stat().st_size if log.exists() else 0
    text = f"{size / 1e6:.2f} MB not yet in the file: copy a store with `atw-mcp backup`, not by its file alone"
    return Finding("write-ahead log", True, text if size else "empty")


def _named(items: list[str]) -> str:
    more = f" and {len(items) - NAMED_AT_MOST} more" if len(items) > NAMED_AT_MOST else ""
    return ", ".join(items[:NAMED_AT_MOST]) + more
