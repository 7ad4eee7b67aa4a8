"""One SQLite file: a connection for each thread, one transaction an operation, errors in plain words."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from sqlite_utils import Database

from evidence_store.checksums import stamped, text_of, verified
from evidence_store.errors import NotAStore, StoreError, StoreReadOnly, StoreTooNew
from evidence_store.migrations import migrate
from evidence_store.schema import APPLICATION_ID, TABLES, VERSION
from evidence_store.sqlite_errors import plain_errors

BUSY_TIMEOUT = 10.0  # [s] to wait for another writer; a transaction of ours takes milliseconds


class Connection:
    """Opens the file on first use in each thread, creating and stamping it where there is none, migrating an older one.

    path: the file; its folder is created. busy_timeout [s]: how long to wait for another writer, default
    `BUSY_TIMEOUT`.
    Raises NotAStore, StoreTooNew, StoreDamaged, StoreReadOnly, StoreDiskError or StoreLocked.
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
                database.conn.commit()  # where that fails (a full disk), no later write may join what is left open
            except BaseException:
                database.conn.rollback()
                raise

    @contextmanager
    def snapshot(self) -> Iterator[Database]:
        """One reading transaction: all that is read inside is of one moment, and keeps no writer waiting."""
        with self._plain_errors():
            database = self._database()
            database.conn.execute("BEGIN")
            try:
                yield database
            finally:
                database.conn.rollback()

    def insert(self, table: str, row: Mapping[str, Any], *, ignore: bool = False) -> None:
        """Store a row with its checksums; ignore: leave a row that is there already. Inside `write`."""
        marked = stamped(table, row)
        verb = "INSERT OR IGNORE" if ignore else "INSERT"
        marks = ", ".join("?" * len(marked))
        self._database().conn.execute(
            f"{verb} INTO {table} ({', '.join(marked)}) VALUES ({marks})", list(marked.values())
        )

    def change(self, table: str, key: str, row: Mapping[str, Any]) -> None:
        """Replace the values of the row whose `key` is the same, and its checksums. Inside `write`."""
        marked = stamped(table, row)
        values = ", ".join(f"{name} = ?" for name in marked)
        self._database().conn.execute(f"UPDATE {table} SET {values} WHERE {key} = ?", [*marked.values(), row[key]])

    def verified(self, table: str, rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """Return the rows; raises RecordDamaged naming the first that is not as it was written."""
        return verified(self.path, table, rows)

    def close(self) -> None:
        """Bring what the write-ahead log holds into the file, as far as other processes let it, and close."""
        # Where this fails (a full disk, a busy reader), the log stays and whoever opens the store next reads it.
        with suppress(StoreError), self._plain_errors():
            self._database().conn.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        self._close_all()

    def _close_all(self) -> None:
        with self._guard:
            for connection in self._opened:
                connection.close()
            self._opened.clear()
            self._local = threading.local()

    def _database(self) -> Database:
        existing: Database | None = getattr(self._local, "database", None)
        if existing is not None:
            return existing
        connection = self._connect()
        connection.text_factory = text_of
        connection.execute("PRAGMA foreign_keys = ON")
        connection.execute("PRAGMA synchronous = NORMAL")
        database = Database(connection)
        with self._guard:
            self._opened.append(connection)
        self._local.database = database
        return database

    def _connect(self) -> sqlite3.Connection:
        # Each thread uses only its own connection; check_same_thread is off so that close() may close them all.
        return sqlite3.connect(self.path, timeout=self._busy_timeout, check_same_thread=False)

    def _prepare(self) -> None:
        self._refuse_folder()
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
            self._migrate()

    def _refuse_folder(self) -> None:
        if self.path.is_dir():
            raise NotAStore(
                f"{self.path} is a folder, not an evidence store: give a file name, e.g. {self.path}/atw.db"
            )

    def _migrate(self) -> None:
        if self._version(self._database()) == VERSION:
            return
        with self.write() as database:
            migrate(database.conn, self._version(database), VERSION)  # nothing where another process was faster
            database.conn.execute(f"PRAGMA user_version = {VERSION}")

    @staticmethod
    def _version(database: Database) -> int:
        (version,) = database.conn.execute("PRAGMA user_version").fetchone()
        return int(version)

    @staticmethod
    def _is_blank(database: Database) -> bool:
        (stamp,) = database.conn.execute("PRAGMA application_id").fetchone()
        (tables,) = database.conn.execute("SELECT count(*) FROM sqlite_master").fetchone()
        return bool(stamp == 0 and tables == 0)

    def _check_stamp(self, database: Database) -> None:
        (stamp,) = database.conn.execute("PRAGMA application_id").fetchone()
        version = self._version(database)
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

    def _plain_errors(self) -> AbstractContextManager[None]:
        return plain_errors(self.path, self._busy_timeout)


def next_number(database: Database, table: str) -> int:
    """The `seq` of the next row; that of evidence is never used twice, even where the last record was deleted."""
    if table == "evidence":
        found = database.conn.execute("SELECT seq FROM sqlite_sequence WHERE name = 'evidence'").fetchone()
        return 1 + (0 if found is None else int(found[0]))
    (last,) = database.conn.execute(f"SELECT coalesce(max(seq), 0) FROM {table}").fetchone()
    return 1 + int(last)
