"""Cases of several stores brought together in one: every record as it was written, evidence under its own ids."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sqlite_utils import Database

from evidence_store.checksums import COLUMNS
from evidence_store.connection import next_number
from evidence_store.errors import StoreError
from evidence_store.references import CONTENTS
from evidence_store.store import EvidenceStore

Rows = Mapping[str, list[dict[str, Any]]]
"""Rows of each table, the tables in the order of `COLUMNS`."""


def merge(parts: Iterable[Path], target: Path) -> int:
    """Write a new store with the records of others, in their order; returns the number of records of evidence.

    Equal inputs give equal records. Raises StoreError where `target` exists, where a part has unfinished work, or where
    two parts have a case or evidence of the same id, and RecordDamaged; nothing is left of `target` then.
    """
    if target.exists():
        raise StoreError(f"{target} exists already: choose another name, or move it away first")
    count = 0
    store = EvidenceStore(target)
    try:
        for part in parts:
            rows = _all_rows(part)
            count += len(rows["evidence"])
            with store.connection.write() as database:
                _refuse_taken(store, database, rows)
                insert_rows(store, rows)
        store.close()
    except BaseException:
        store.close()
        for name in (target.name, f"{target.name}-wal", f"{target.name}-shm"):
            target.with_name(name).unlink(missing_ok=True)
        raise
    return count


def copy_contents(store: EvidenceStore, part: Path) -> None:
    """Copy the worlds, observations, rollouts and fits of another store, so that none is computed again.

    Nothing refers to them until the same is asked for; `upkeep.prune` removes those of which that is still true.
    """
    rows = _all_rows(part)
    contents = {table: rows[table] for table in ("worlds", *CONTENTS)}
    insert_rows(store, contents)


def insert_rows(store: EvidenceStore, rows: Rows) -> None:
    """Store verified rows of other stores, all or none; evidence keeps its ids, other running numbers are continued."""
    with store.connection.write() as database:
        for table, found in rows.items():
            for row in found:
                if "seq" in row and table != "evidence":
                    row = {**row, "seq": next_number(database, table)}
                store.connection.insert(table, row, ignore="seq" not in row)


def _all_rows(part: Path) -> dict[str, list[dict[str, Any]]]:
    store = EvidenceStore.to_read(part)
    try:
        with store.connection.snapshot() as database:
            rows = {
                table: store.connection.verified(
                    table, database.query(f"SELECT * FROM {table} ORDER BY {'seq' if 'seq' in columns else 'rowid'}")
                )
                for table, columns in COLUMNS.items()
            }
    finally:
        store.close()
    running = [f"ev-{row['seq']}" for row in rows["evidence"] if row["status"] == "running"]
    if running:
        raise StoreError(f"{part} has unfinished work ({', '.join(running[:5])}): wait until it is done, or cancel it")
    return rows


def _refuse_taken(store: EvidenceStore, database: Database, rows: Rows) -> None:
    cure = "give every store evidence ids of its own (`EvidenceTable.number_from`)"
    for row in rows["cases"]:
        if database.conn.execute("SELECT 1 FROM cases WHERE id = ?", [row["id"]]).fetchone():
            raise StoreError(f"{store.path} has a case {row['id']!r} already: {cure}")
    taken = [
        f"ev-{row['seq']}"
        for row in rows["evidence"]
        if database.conn.execute("SELECT 1 FROM evidence WHERE seq = ?", [row["seq"]]).fetchone()
    ]
    if taken:
        raise StoreError(
            f"{store.path} has other evidence of the ids {', '.join(taken[:5])}{' ...' if len(taken) > 5 else ''}, and "
            f"answers refer to evidence by its id: {cure}"
        )
