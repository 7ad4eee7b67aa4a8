"""Stores of earlier versions are brought up to date when they are opened, wholly or not at all."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from evidence_store import EvidenceStore, RecordDamaged, StoreError
from evidence_store.checksums import COLUMNS, intact
from evidence_store.schema import VERSION

VERSION_1 = Path(__file__).parent / "version_1.sql"


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "old.db"
    database = sqlite3.connect(path)
    database.executescript(VERSION_1.read_text())
    database.close()
    return path


def columns(path: Path) -> dict[str, set[tuple[str, str]]]:
    database = sqlite3.connect(path)
    tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    found = {table: {row[1:3] for row in database.execute(f"PRAGMA table_info({table})")} for table in tables}
    database.close()
    return found


def test_a_store_of_version_1_opens_with_all_it_holds(old: Path, tmp_path: Path) -> None:
    store = EvidenceStore(old)
    assert store.cases.get("ball").committed_world == "world-b"
    assert store.cases.questions("ball") == ["will it bounce?"]
    assert store.cases.bindings("ball")["the ball"].track == "track-1"
    assert store.cases.answers("ball")[0].confidence == 0.9
    assert [world for world, _ in store.cases.worlds("ball")] == ["world-a", "world-b"]
    assert store.worlds.parents("world-b")[0].parent == "world-a"
    rollout = store.rollouts.find("rollout", {"world": "world-b"})
    assert rollout is not None
    assert np.array_equal(rollout.arrays["x"], [1.0, np.nan], equal_nan=True)
    first = store.read_evidence("ev-1")
    assert (first.summary, first.pictures) == ("fällt", {"a.png": b"\x89PNG"})
    assert store.read_evidence("ev-3").status == "failed", "its worker is long gone"
    EvidenceStore(tmp_path / "new.db").close()
    assert columns(old) == columns(tmp_path / "new.db")
    with store.connection.read() as database:
        assert database.conn.execute("PRAGMA user_version").fetchone() == (VERSION,)
        for table in COLUMNS:
            assert all(intact(table, row) for row in database.query(f"SELECT * FROM {table}"))


def test_a_store_of_version_1_gets_the_indices_of_a_new_one(old: Path, tmp_path: Path) -> None:
    def indices(path: Path) -> dict[str, str]:
        with closing(sqlite3.connect(path)) as database:
            return dict(
                database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'index' AND sql IS NOT NULL")
            )

    for path in (old, tmp_path / "new.db"):
        EvidenceStore(path).close()
    assert indices(old) == indices(tmp_path / "new.db")


def test_what_cannot_be_read_counts_as_damaged_afterwards(old: Path) -> None:
    database = sqlite3.connect(old)
    with database:
        database.execute("UPDATE evidence SET payload = '{\"data\": ' WHERE seq = 1")
        database.execute("UPDATE rollouts SET arrays = substr(arrays, 1, 60) || x'00' || substr(arrays, 62)")
        database.execute("UPDATE worlds SET document = CAST(x'ff' AS TEXT) WHERE id = 'world-a'")
    database.close()
    store = EvidenceStore(old)
    with pytest.raises(RecordDamaged, match="ev-1"):
        store.read_evidence("ev-1")
    with pytest.raises(RecordDamaged, match="rollout-"):
        store.rollouts.find("rollout", {"world": "world-b"})
    with pytest.raises(RecordDamaged, match="world-a"):
        store.worlds.document("world-a")
    assert store.read_evidence("ev-2").tool == "OpenCase"


def test_a_migration_that_fails_leaves_the_store_as_it_was(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise sqlite3.OperationalError("half way")

    before = columns(old)
    monkeypatch.setattr("evidence_store.migrations.readable", fail)
    with pytest.raises(StoreError, match="half way"):
        EvidenceStore(old)
    monkeypatch.undo()
    assert columns(old) == before
    assert EvidenceStore(old).read_evidence("ev-2").tool == "OpenCase"
