"""What is not as it was written is never returned as fact, and does not hide what is."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from evidence_store import (
    Case,
    Evidence,
    EvidenceStore,
    RecordDamaged,
    StoreDamaged,
    StoreDiskError,
    StoreError,
    StoreFull,
)
from evidence_store.checksums import COLUMNS
from tests.evidence_store.records import filled, tamper

READERS: dict[str, Callable[[EvidenceStore], object]] = {
    "cases": lambda store: store.cases.get("ball"),
    "questions": lambda store: store.cases.questions("ball"),
    "observations": lambda store: store.observations.find("tracks", {"video": "ball"}),
    "case_observations": lambda store: store.cases.observations("ball"),
    "worlds": lambda store: store.worlds.document("world-b"),
    "world_parents": lambda store: store.worlds.parents("world-b"),
    "case_worlds": lambda store: store.cases.worlds("ball"),
    "rollouts": lambda store: store.rollouts.find("rollout", {"world": "world-b"}),
    "fits": lambda store: store.fits.find("fit", {"world": "world-b", "start": "world-a"}),
    "evidence": lambda store: store.read_evidence("ev-1"),
    "bindings": lambda store: store.cases.bindings("ball"),
    "answers": lambda store: store.cases.answers("ball"),
}
KEYS = {"id", "case_id", "seq", "child"}  # with another key a record is another one, or none


def damage_cases() -> list[tuple[str, str]]:
    values = [(table, column) for table in COLUMNS for column in COLUMNS[table] if column not in KEYS]
    return [*values, ("evidence", "payload"), ("evidence", "attachments"), *((table, "checksum") for table in COLUMNS)]


def test_every_table_has_a_reader_here(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    assert set(READERS) == set(COLUMNS)
    for read in READERS.values():
        assert read(store)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = filled(tmp_path_factory.mktemp("store") / "atw.db")
    store.close()
    return store.path


@pytest.mark.parametrize(("table", "column"), damage_cases())
def test_a_changed_value_is_reported_instead_of_returned(whole: Path, tmp_path: Path, table: str, column: str) -> None:
    path = tmp_path / "atw.db"
    path.write_bytes(whole.read_bytes())
    first, last = ("'failed'", "'failed'") if column == "status" else ("x'ff41'", "x'ff42'")
    database = sqlite3.connect(path)
    with database:
        database.execute(f"UPDATE {table} SET {column} = {first} WHERE rowid = (SELECT min(rowid) FROM {table})")
        database.execute(f"UPDATE {table} SET {column} = {last} WHERE rowid = (SELECT max(rowid) FROM {table})")
    database.close()
    with pytest.raises(RecordDamaged, match=r"damaged.*atw-mcp doctor"):
        READERS[table](EvidenceStore(path))


def test_a_flipped_bit_in_the_file_is_noticed(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    store.close()
    content = bytearray(store.path.read_bytes())
    assert content.count(b'{"horizon":2.0}') == 1
    content[content.index(b'{"horizon":2.0}') + 2] ^= 1
    store.path.write_bytes(content)
    again = EvidenceStore(store.path)
    with pytest.raises(RecordDamaged, match="ev-1"):
        again.read_evidence("ev-1")
    assert again.read_evidence("ev-3").tool == "FitWorld"


def test_listings_leave_damaged_records_out_and_name_them(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    store.cases.add("second", content="c", kind="video", path="/s.mp4", facts={})
    tamper(store.path, "UPDATE cases SET facts = '{\"frames\":4}' WHERE id = 'ball'")
    tamper(store.path, "UPDATE evidence SET status = 'completed' WHERE seq = 3")
    tamper(store.path, "UPDATE evidence SET payload = '{}' WHERE seq = 1")
    assert [case.id for case in store.cases.all()] == ["second"]
    assert store.cases.damaged() == ["case 'ball'"]
    assert [record.id for record in store.evidence.of_case("ball")] == ["ev-1"], "its payload is not listed"
    assert store.evidence.damaged("ball") == ["evidence ev-3"]
    page = store.evidence.search("ball")
    assert ([record.id for record in page.records], page.damaged) == (["ev-1"], ("evidence ev-3",))
    page = store.evidence.search("ball", text="fällt")
    assert (page.records, page.damaged) == ((), ("evidence ev-3", "evidence ev-1"))


def test_a_damaged_record_is_not_given_a_new_checksum_by_a_change(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    tamper(store.path, "UPDATE cases SET kind = 'data', committed_world = NULL WHERE id = 'ball'")
    tamper(store.path, "UPDATE evidence SET tool = 'Finish' WHERE seq = 3")
    with pytest.raises(RecordDamaged, match="ball"):
        store.cases.commit_world("ball", "world-a")
    with pytest.raises(RecordDamaged, match="ball"):
        store.cases.add("ball", content="content of ball", kind="video", path="/elsewhere.mp4", facts={})
    with pytest.raises(RecordDamaged, match="ev-3"):
        store.evidence.update(Evidence("FitWorld", {}, id="ev-3"))


def test_an_update_is_verified_when_it_is_read(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    store.evidence.update(Evidence("FitWorld", {}, case="ball", id="ev-3", summary="done", pictures={"b.png": b"b"}))
    assert store.evidence.get("ev-3").pictures == {"b.png": b"b"}
    moved = store.cases.add("ball", content="content of ball", kind="video", path="/elsewhere.mp4", facts={})
    assert isinstance(moved, Case)
    assert store.cases.get("ball").path == "/elsewhere.mp4"


@pytest.mark.parametrize("kept", [0.3, 0.6, 0.95])
def test_a_truncated_store_is_named_damaged_and_left_as_it_is(tmp_path: Path, kept: float) -> None:
    store = filled(tmp_path / "atw.db")
    store.close()
    content = store.path.read_bytes()
    store.path.write_bytes(content[: int(len(content) * kept)])
    before = store.path.read_bytes()
    with pytest.raises(StoreDamaged, match=r"doctor.*--repair"):
        EvidenceStore(store.path)
    assert store.path.read_bytes() == before


def test_a_full_disk_is_named_and_the_store_works_again_afterwards(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    with store.connection.read() as database:
        (pages,) = database.conn.execute("PRAGMA page_count").fetchone()
        database.conn.execute(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(StoreFull, match=r"MB free.*atw-mcp prune"):
        store.evidence.add(Evidence("Rollout", {}, case="ball", payload={"text": "x" * 100_000}))
    assert len(store.evidence.of_case("ball")) == 2, "reading goes on"
    with store.connection.read() as database:
        database.conn.execute("PRAGMA max_page_count = 1000000")
    assert store.evidence.add(Evidence("Rollout", {}, case="ball", payload={"text": "x" * 100_000})).id == "ev-4"


def test_a_commit_that_fails_leaves_no_transaction_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = filled(tmp_path / "atw.db")
    with store.connection.read() as database:
        connection = database.conn

    class Failing:
        def __getattr__(self, name: str) -> object:
            return getattr(connection, name)

        def commit(self) -> None:
            raise sqlite3.OperationalError("disk I/O error")

    monkeypatch.setattr(database, "conn", Failing())
    with pytest.raises(StoreError, match="disk I/O"):
        store.evidence.add(Evidence("Rollout", {}, case="ball"))
    monkeypatch.undo()
    assert not connection.in_transaction
    assert len(store.evidence.of_case("ball")) == 2


def test_closing_leaves_everything_in_the_file_and_no_log(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    other = EvidenceStore(store.path)  # keeps the log from being removed by the last who closes
    other.cases.all()
    store.close()
    log = tmp_path / "atw.db-wal"
    assert not log.exists() or log.stat().st_size == 0
    alone = tmp_path / "copy.db"
    alone.write_bytes(store.path.read_bytes())
    assert EvidenceStore(alone).read_evidence("ev-1").summary == "fällt"
    store.close()  # a second time changes nothing


def test_disk_errors_are_store_errors() -> None:
    assert issubclass(StoreFull, StoreDiskError)
    assert issubclass(StoreDiskError, StoreError)
