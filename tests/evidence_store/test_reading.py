"""A store opened to be read only shows what it holds and what others add, and is never made, migrated or written."""

from __future__ import annotations

import hashlib
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from evidence_store import (
    ChangeWatch,
    Evidence,
    EvidenceStore,
    NotAStore,
    StoreError,
    StoreReadOnly,
    StoreTooNew,
    StoreTooOld,
)
from evidence_store.schema import RECORDS, VERSION
from tests.evidence_store.records import filled

VERSION_1 = Path(__file__).parent / "version_1.sql"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    filled(tmp_path / "a.db").close()
    return tmp_path / "a.db"


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_reading_shows_records_and_leaves_the_file_as_it_is(path: Path) -> None:
    before = digest(path)
    store = EvidenceStore.to_read(path)
    assert store.read_evidence("ev-1").summary == "fällt"
    assert store.cases.get("ball").committed_world == "world-b"
    with pytest.raises(StoreReadOnly, match="read only"):
        store.cases.add_question("ball", "when?")
    with pytest.raises(StoreReadOnly):
        store.evidence.add(Evidence("OpenCase", {}))
    store.close()
    assert digest(path) == before


def test_work_of_an_ended_process_reads_as_failed_and_is_not_marked(path: Path) -> None:
    writer = EvidenceStore(path)
    work = writer.evidence.add(Evidence("FitWorld", {}, case="ball", status="running"))
    store = EvidenceStore.to_read(path)
    assert store.read_evidence(work.id).status == "failed", "nothing works on it"
    assert writer.evidence.get(work.id).status == "running"
    store.close()
    writer.close()


def test_a_watch_notices_what_another_connection_commits_and_nothing_else(path: Path) -> None:
    writer = EvidenceStore(path)
    watch = ChangeWatch(path)
    assert watch.changed()
    assert not watch.changed()
    writer.evidence.add(Evidence("Rollout", {}, case="ball"))
    assert watch.changed()
    assert not watch.changed()
    watch.close()
    writer.close()


def test_an_absent_store_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="there is no evidence store"):
        EvidenceStore.to_read(tmp_path / "none" / "a.db")
    assert not list(tmp_path.iterdir())


def test_stores_of_other_versions_and_other_files_are_refused_unchanged(path: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute(f"PRAGMA user_version = {VERSION + 1}")
    with pytest.raises(StoreTooNew, match="update atw-mcp"):
        EvidenceStore.to_read(path)
    old = tmp_path / "old.db"
    with closing(sqlite3.connect(old)) as database:
        database.executescript(VERSION_1.read_text())
    before = digest(old)
    with pytest.raises(StoreTooOld, match="doctor"):
        EvidenceStore.to_read(old)
    assert digest(old) == before
    other = tmp_path / "other.db"
    with closing(sqlite3.connect(other)) as database:
        database.execute("CREATE TABLE t (x)")
    with pytest.raises(NotAStore):
        EvidenceStore.to_read(other)
    other.write_text("no database, but long enough to be one" * 40)
    with pytest.raises(NotAStore):
        EvidenceStore.to_read(other)


def test_a_store_before_error_curves_can_be_read(path: Path) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute("ALTER TABLE jobs DROP COLUMN curve")
        database.execute("INSERT INTO jobs (evidence_seq, key, host, pid, heartbeat) VALUES (2, 'k', 'h', 1, 0.0)")
        database.execute(f"PRAGMA user_version = {RECORDS}")
        database.commit()
    store = EvidenceStore.to_read(path)
    assert [job.curve for job in store.jobs.all()] == [None]
    store.close()
    store = EvidenceStore(path)
    store.jobs.beat("ev-2", 1.0, 2.0, "half", {"best": [0.5]})
    (job,) = store.jobs.all()
    assert job.curve == {"best": [0.5]}
    store.close()
