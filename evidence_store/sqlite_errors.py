"""SQLite's errors in plain words, with what to do next."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evidence_store.errors import (
    NotAStore,
    StoreDamaged,
    StoreDiskError,
    StoreError,
    StoreFull,
    StoreLocked,
    StoreReadOnly,
)
from evidence_store.schema import APPLICATION_ID

NO_ROOM = 1 << 20  # [bytes] free on a disk that is as good as full: SQLite writes its log in pieces of some 100 kB
APPLICATION_ID_AT = 68  # [bytes] from the start of an SQLite file, https://www.sqlite.org/fileformat2.html


@contextmanager
def plain_errors(path: Path, busy_timeout: float) -> Iterator[None]:
    """Raise the fitting StoreError for an error of SQLite; busy_timeout [s]: how long a lock was waited for."""
    try:
        yield
    except sqlite3.Error as error:
        raise plain_error(path, error, busy_timeout) from error


def plain_error(path: Path, error: sqlite3.Error, busy_timeout: float) -> StoreError:
    """The StoreError that says what an error of SQLite means for the store at `path`."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return StoreLocked(
            f"the evidence store {path} is locked by another process for more than {busy_timeout:g} s: end that "
            "process, or call again when it is done; nothing was changed"
        )
    if code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM, sqlite3.SQLITE_CANTOPEN):
        return StoreReadOnly(
            f"the evidence store {path} cannot be written ({error}): give write permission to the file and its "
            "folder, or choose another store with --store PATH; nothing was changed"
        )
    if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
        return _disk_error(path, error, code)
    if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
        if is_stamped(path):
            return StoreDamaged(
                f"the evidence store {path} is damaged ({error}). Next: end the servers that use it; `atw-mcp doctor "
                f"--store {path} --repair` writes what can be read of it to a new file"
            )
        return NotAStore(
            f"{path} is not an evidence store ({error}), left untouched: choose another file with --store PATH"
        )
    return StoreError(f"the evidence store {path} failed ({error}); nothing was changed")


def is_stamped(path: Path) -> bool:
    """Whether a file has a store's stamp, looked for without SQLite, which reads no damaged file."""
    try:
        with path.open("rb") as file:
            file.seek(APPLICATION_ID_AT)
            return file.read(4) == APPLICATION_ID.to_bytes(4, "big")
    except OSError:
        return False


def _disk_error(path: Path, error: sqlite3.Error, code: int) -> StoreDiskError:
    try:
        free = shutil.disk_usage(path.parent).free
    except OSError:
        free = 0
    if code == sqlite3.SQLITE_FULL or free < NO_ROOM:
        return StoreFull(
            f"the evidence store {path} cannot grow ({error}; {free / 1e6:.1f} MB free on its disk): free space "
            f"there, or `atw-mcp prune --store {path}` drops cached results that no evidence refers to; nothing was "
            "changed"
        )
    return StoreDiskError(
        f"the evidence store {path} could not be read or written ({error}; {free / 1e6:.1f} MB free on its disk): "
        "check the disk, and the limit of file sizes with `ulimit -f`; nothing was changed"
    )
