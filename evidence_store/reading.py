"""A store opened to be read only: never made, never migrated, never written."""

from __future__ import annotations

import hashlib
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlite_utils import Database

from evidence_store.connection import Connection
from evidence_store.errors import StoreError, StoreReadOnly, StoreTooOld
from evidence_store.schema import RECORDS, VERSION


class ReadOnlyConnection(Connection):
    """Opens an existing store of this version, or of one whose records are the same; writing raises StoreReadOnly.

    SQLite keeps two small files, `-wal` and `-shm`, beside a store that is read; the store's own file stays as it is.
    Raises StoreError where there is none, StoreTooOld, and the errors of `Connection`.
    """

    @contextmanager
    def write(self) -> Iterator[Database]:
        """Refuse to."""
        raise StoreReadOnly(f"the evidence store {self.path} was opened to be read only")
        yield  # a context manager, although no block is ever entered

    def close(self) -> None:
        """Close the connections of all threads."""
        self._close_all()

    def _connect(self) -> sqlite3.Connection:
        return connect_to_read(self.path, self._busy_timeout)

    def _prepare(self) -> None:
        if not self.path.exists():
            raise StoreError(f"there is no evidence store at {self.path}: check the path, which --store FILE gives")
        self._refuse_folder()
        with self._plain_errors():
            database = self._database()
            self._check_stamp(database)
            version = self._version(database)
        if version < RECORDS:
            raise StoreTooOld(
                f"the evidence store {self.path} has version {version}, which can be read once it was brought to "
                f"version {VERSION}: `atw-mcp doctor --store {self.path} --repair` does that"
            )


class ChangeWatch:
    """Says whether other connections have changed a store since it was last asked. For one thread at a time."""

    def __init__(self, path: Path, busy_timeout: float = 1.0) -> None:
        self._connection = connect_to_read(path, busy_timeout)
        self._seen: int | None = None

    def changed(self) -> bool:
        """Whether anything was committed since the last call; True at the first. Costs one read of the file's header.

        Raises sqlite3.Error where the file cannot be read.
        """
        (version,) = self._connection.execute("PRAGMA data_version").fetchone()
        before, self._seen = self._seen, int(version)
        return before != self._seen

    def close(self) -> None:
        """Close its connection."""
        self._connection.close()


def connect_to_read(path: Path, busy_timeout: float) -> sqlite3.Connection:
    """Return a connection that cannot write, usable from any thread.

    In a folder where SQLite may not keep its files beside the store nobody of this user can write either: there the
    file is taken to be unchanging, if no log of unfinished writing lies beside it.
    """
    log = path.with_name(path.name + "-wal")
    quiet = not os.access(path.parent, os.W_OK) and not (log.exists() and log.stat().st_size)
    mode = "immutable=1" if quiet else "mode=ro"
    return sqlite3.connect(f"{path.as_uri()}?{mode}", uri=True, timeout=busy_timeout, check_same_thread=False)


REVISED = (
    "SELECT checksum FROM cases WHERE id = :case",
    "SELECT count(*), max(seq), sum(status = 'running') FROM evidence WHERE case_id = :case",
    "SELECT count(*), max(seq) FROM questions WHERE case_id = :case",
    "SELECT count(*), max(seq) FROM case_observations WHERE case_id = :case",
    "SELECT count(*), max(seq) FROM case_worlds WHERE case_id = :case",
    "SELECT checksum FROM bindings WHERE case_id = :case ORDER BY seq",
    "SELECT checksum FROM answers WHERE case_id = :case ORDER BY seq",
)
"""What changes whenever a record of a case does: records are added, and evidence ends, cases and bindings change."""


def revision(connection: Connection, case: str) -> str:
    """Return a digest of which records a case has: equal as long as none was added or changed. Reads few pages."""
    with connection.read() as database:
        rows = [database.conn.execute(statement, {"case": case}).fetchall() for statement in REVISED]
    return hashlib.sha256(repr(rows).encode()).hexdigest()[:16]
