"""One SQLite file: a connection for each thread, one transaction an operation, errors in plain words."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlite_utils import Database

from evidence_store.errors import NotAStore, StoreError, StoreLocked, StoreReadOnly, StoreTooNew
from evidence_store.schema import APPLICATION_ID, TABLES, VERSION

BUSY_TIMEOUT = 10.0  # [s] to wait for another writer; a transaction of ours takes milliseconds


class Connection:
    """Opens the file on first use in each thread, creating and stamping it where there is none.

    path: the file; its folder is created. busy_timeout [s]: how long to wait for another writer, default
    `BUSY_TIMEOUT`.
    Raises NotAStore, StoreTooNew, StoreReadOnly or StoreLocked.
    """

    def __init__(self, path: str | os.PathLike[str], *, busy_timeout: float | None = None) -> None:
        self.path = Path(path).expanduser().absolute()
        self._busy_timeout = BUSY_TIMEOUT if busy_timeout is None else busy_timeout
        self._local = threading.local()
        self._opened: list[sqlite3.Connection] = []
        self._guard = threading.Lock()
        self._prepare()

    @contextmanager
    def read(self) -> Iterator[Database]:
        """The calling thread's database, for reading."""
        with self._plain_errors():
            yield self._database()

    @contextmanager
    def write(self) -> Iterator[Database]:
        """One transaction: all of it is stored, or none of it."""
        with self._plain_errors():
            database = self._database()
            if database.conn.in_transaction:  # joins the transaction already open in this thread
                yield database
                return
            # IMMEDIATE: waits for its turn here, instead of failing half way when a read turns into a write.
            database.conn.execute("BEGIN IMMEDIATE")
            try:
                yield database
            except BaseException:
                database.conn.rollback()
                raise
            database.conn.commit()

    def close(self) -> None:
        """Close every thread's connection."""
        with self._guard:
            for connection in self._opened:
                connection.close()
            self._opened.clear()
            self._local = threading.local()

    def _database(self) -> Database:
        existing: Database | None = getattr(self._local, "database", None)
        if existing is not None:
            return existing
        # Each thread uses only its own connection; check_same_thread is off so that close() may close them all.
        connection = sqlite3.connect(self.path, timeout=self._busy_timeout, check_same_thread=False)
        connection.execute("PRAGMA foreign_keys = ON")
        connection.execute("PRAGMA synchronous = NORMAL")
        database = Database(connection)
        with self._guard:
            self._opened.append(connection)
        self._local.database = database
        return database

    def _prepare(self) -> None:
        if self.path.is_dir():
            raise NotAStore(
                f"{self.path} is a folder, not an evidence store: give a file name, e.g. {self.path}/atw.db"
            )
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreReadOnly(
                f"cannot create the folder {self.path.parent} for the evidence store ({error.strerror}): "
                "choose another place with --store PATH"
            ) from error
        with self._plain_errors():
            database = self._database()
            if self._is_blank(database):
                database.conn.execute("PRAGMA journal_mode = WAL")
                with self.write():
                    if self._is_blank(database):  # another process may have been faster
                        for statement in TABLES.split(";\n"):
                            if statement.strip():
                                database.conn.execute(statement)
                        database.conn.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                        database.conn.execute(f"PRAGMA user_version = {VERSION}")
            self._check_stamp(database)
            if not os.access(self.path, os.W_OK) or not os.access(self.path.parent, os.W_OK):
                raise StoreReadOnly(
                    f"the evidence store {self.path} cannot be written: give write permission to the file and "
                    "its folder, or choose another store with --store PATH"
                )

    @staticmethod
    def _is_blank(database: Database) -> bool:
        (stamp,) = database.conn.execute("PRAGMA application_id").fetchone()
        (tables,) = database.conn.execute("SELECT count(*) FROM sqlite_master").fetchone()
        return bool(stamp == 0 and tables == 0)

    def _check_stamp(self, database: Database) -> None:
        (stamp,) = database.conn.execute("PRAGMA application_id").fetchone()
        (version,) = database.conn.execute("PRAGMA user_version").fetchone()
        if stamp != APPLICATION_ID:
            raise NotAStore(
                f"{self.path} is an SQLite database of another program, left untouched: choose another file with "
                "--store PATH"
            )
        if version > VERSION:
            raise StoreTooNew(
                f"the evidence store {self.path} has version {version}, this program reads up to {VERSION}: update "
                "atw-mcp or choose another store with --store PATH"
            )

    @contextmanager
    def _plain_errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise StoreLocked(
                    f"the evidence store {self.path} is locked by another process for more than "
                    f"{self._busy_timeout:g} s: end that process, or call again when it is done; nothing was changed"
                ) from error
            if code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM, sqlite3.SQLITE_CANTOPEN):
                raise StoreReadOnly(
                    f"the evidence store {self.path} cannot be written ({error}): give write permission to the file "
                    "and its folder, or choose another store with --store PATH; nothing was changed"
                ) from error
            raise StoreError(f"the evidence store {self.path} failed ({error}); nothing was changed") from error
        except sqlite3.DatabaseError as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
                raise NotAStore(
                    f"{self.path} is not an evidence store ({error}), left untouched: choose another file with "
                    "--store PATH"
                ) from error
            raise StoreError(f"the evidence store {self.path} failed ({error}); nothing was changed") from error
