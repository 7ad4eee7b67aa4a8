"""The store keeps what it is given, finds it by content, and rejects what is not its own."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evidence_store import (
    Answer,
    Binding,
    Evidence,
    EvidenceStore,
    NotAStore,
    StoreError,
    StoreLocked,
    StoreReadOnly,
    StoreTooNew,
    UnknownRecord,
)


@pytest.fixture
def store(tmp_path: Path) -> EvidenceStore:
    return EvidenceStore(tmp_path / "atw.db")


def add_case(store: EvidenceStore, name: str = "ball") -> None:
    store.cases.add(name, content="abc", kind="video", path="/ball.mp4", facts={"frames": 3})


def test_everything_is_there_again_after_reopening(store: EvidenceStore) -> None:
    add_case(store)
    store.cases.add_question("ball", "will it bounce?")
    store.cases.bind("ball", Binding("the ball", "track-1", "ball", "only one"))
    store.cases.bind("ball", Binding("the ball", "track-2", "ball", "the other one"))
    store.cases.add_answer("ball", Answer("will it bounce?", "yes", 0.9, ("ev-1",), ""))
    store.worlds.put("world-a", '{"a":1}')
    store.worlds.put("world-b", '{"b":1}', parent="world-a", how="fitted", detail={"loss": 0.5})
    store.cases.add_world("ball", "world-a", "built")
    store.cases.commit_world("ball", "world-a")
    first = Evidence(
        "Rollout", {"horizon": 2.0}, case="ball", world="world-a", objects=("ball",), interval=(0.0, 2.0),
        status="diverged", summary="s", payload={"x": [1, None]}, pictures={"a.png": b"\x89PNG"},
    )  # fmt: skip
    kept = store.evidence.add(first)
    store.close()

    again = EvidenceStore(store.path)
    assert again.cases.get("ball").committed_world == "world-a"
    assert again.cases.questions("ball") == ["will it bounce?"]
    assert again.cases.bindings("ball")["the ball"].track == "track-2"
    assert again.cases.answers("ball")[0].evidence == ("ev-1",)
    assert again.worlds.document("world-b") == '{"b":1}'
    assert [(d.parent, d.how, d.detail) for d in again.worlds.parents("world-b")] == [
        ("world-a", "fitted", {"loss": 0.5})
    ]
    assert again.read_evidence(kept.id) == replace(first, id=kept.id)
    assert again.evidence.of_case("ball", tool="Rollout") == [replace(kept, payload={}, pictures={})]
    assert again.evidence.of_case("ball", tool="Finish") == []


def test_equal_inputs_are_computed_once_and_give_equal_ids(store: EvidenceStore, tmp_path: Path) -> None:
    calls = []

    def compute() -> tuple[dict[str, object], dict[str, np.ndarray]]:
        calls.append(1)
        return {"n": 2}, {"x": np.array([1.0, np.nan])}

    first, computed = store.rollouts.get_or_compute("rollout", {"world": "w", "horizon": 1.0}, compute)
    second, computed_again = store.rollouts.get_or_compute("rollout", {"horizon": 1.0, "world": "w"}, compute)
    assert (computed, computed_again, len(calls)) == (True, False, 1)
    assert first.id == second.id
    assert np.array_equal(second.arrays["x"], [1.0, np.nan], equal_nan=True)
    other = EvidenceStore(tmp_path / "other.db")
    assert other.rollouts.key("rollout", {"world": "w", "horizon": 1.0}) == first.id
    assert store.rollouts.key("rollout", {"world": "w", "horizon": 2.0}) != first.id
    assert store.rollouts.key("preview", {"world": "w", "horizon": 1.0}) != first.id


def test_a_failed_transaction_leaves_nothing_behind(store: EvidenceStore) -> None:
    add_case(store)

    def fail_half_way() -> None:
        with store.transaction():
            store.worlds.put("world-a", "{}")
            store.cases.add_world("ball", "world-a", "built")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        fail_half_way()
    assert store.cases.worlds("ball") == []
    with pytest.raises(UnknownRecord):
        store.worlds.document("world-a")


def test_the_latest_commit_counts(store: EvidenceStore) -> None:
    add_case(store)
    for world in ("world-a", "world-b"):
        store.worlds.put(world, "{}")
        store.cases.commit_world("ball", world)
        assert store.cases.get("ball").committed_world == world


def test_a_name_taken_by_another_content_is_refused(store: EvidenceStore) -> None:
    add_case(store)
    with pytest.raises(StoreError, match="already exists"):
        store.cases.add("ball", content="other", kind="video", path="/x", facts={})
    moved = store.cases.add("ball", content="abc", kind="video", path="/moved.mp4", facts={})
    assert moved.path == "/moved.mp4"


@pytest.mark.parametrize("identifier", ["ev-99", "ev-", "12", "ev-x", "ev--1", "ev-99999999999999999999"])
def test_unknown_evidence_is_named(store: EvidenceStore, identifier: str) -> None:
    with pytest.raises(UnknownRecord, match=identifier):
        store.read_evidence(identifier)


def test_threads_share_one_store(store: EvidenceStore) -> None:
    add_case(store)
    ids: list[str] = []

    def write() -> None:
        for _ in range(20):
            ids.append(store.evidence.add(Evidence("T", {}, case="ball")).id)

    threads = [threading.Thread(target=write) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(ids)) == 80
    assert len(store.evidence.of_case("ball")) == 80


def test_two_processes_create_and_write_one_store_at_once(tmp_path: Path) -> None:
    program = (
        "import sys\nfrom evidence_store import *\ns = EvidenceStore(sys.argv[1])\n"
        "for i in range(25): s.evidence.add(Evidence('T', {'i': i}))\n"
    )
    path = tmp_path / "shared.db"
    processes = [subprocess.Popen([sys.executable, "-c", program, str(path)]) for _ in range(2)]
    assert [process.wait(60) for process in processes] == [0, 0]
    with sqlite3.connect(path) as database:
        assert database.execute("SELECT count(*), count(DISTINCT seq) FROM evidence").fetchone() == (50, 50)


def test_a_locked_store_is_reported_and_works_again_afterwards(store: EvidenceStore) -> None:
    impatient = EvidenceStore(store.path, busy_timeout=0.1)
    other = sqlite3.connect(store.path)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(StoreLocked, match="locked by another process"):
        add_case(impatient)
    other.rollback()
    add_case(impatient)
    assert [case.id for case in store.cases.all()] == ["ball"]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="permissions do not bind this user")
def test_a_read_only_store_is_reported(store: EvidenceStore) -> None:
    store.close()
    store.path.chmod(0o444)
    with pytest.raises(StoreReadOnly, match="--store"):
        EvidenceStore(store.path)


def test_a_store_on_a_read_only_file_system_is_reported() -> None:
    path = Path("/proc/atw/atw.db")  # nobody can make a folder there, not even root
    if not Path("/proc").is_dir():
        pytest.skip("this system has no /proc")
    with pytest.raises(StoreReadOnly, match="--store"):
        EvidenceStore(path)


def test_a_write_refused_by_sqlite_is_reported_as_read_only(store: EvidenceStore) -> None:
    add_case(store)
    with store.transaction():
        pass
    with store.connection.read() as database:
        database.conn.execute("PRAGMA query_only = ON")
    with pytest.raises(StoreReadOnly, match="cannot be written"):
        add_case(store, "second")
    assert [case.id for case in store.cases.all()] == ["ball"]


def test_another_programs_database_is_left_untouched(tmp_path: Path) -> None:
    path = tmp_path / "notes.db"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE notes (text)")
    before = path.read_bytes()
    with pytest.raises(NotAStore, match="another program"):
        EvidenceStore(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "content", [b"hello, this is a text file and no database at all\n" * 40, b"SQLite format 3\0xx"]
)
def test_a_file_that_is_no_database_is_left_untouched(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    with pytest.raises(NotAStore):
        EvidenceStore(path)
    assert path.read_bytes() == content


def test_a_folder_is_no_store(tmp_path: Path) -> None:
    with pytest.raises(NotAStore, match="folder"):
        EvidenceStore(tmp_path)


def test_a_store_of_a_newer_version_is_refused(store: EvidenceStore) -> None:
    store.close()
    with sqlite3.connect(store.path) as database:
        database.execute("PRAGMA user_version = 999")
    with pytest.raises(StoreTooNew, match="999"):
        EvidenceStore(store.path)


def test_work_of_a_dead_process_becomes_failed(store: EvidenceStore) -> None:
    add_case(store)
    program = (
        "import os, sys\nfrom evidence_store import *\ns = EvidenceStore(sys.argv[1])\n"
        "e = s.evidence.add(Evidence('FitWorld', {}, case='ball', status='running'))\n"
        "s.jobs.start(e.id, 'key')\nprint(e.id)\nsys.stdout.flush()\nos._exit(1)\n"
    )
    found = subprocess.run([sys.executable, "-c", program, str(store.path)], capture_output=True, text=True)
    record = store.read_evidence(found.stdout.strip())
    assert record.status == "failed"
    assert "FitWorld" in record.summary
    assert store.read_evidence(record.id).status == "failed"
    assert store.jobs.working_on("key") is None


def test_work_of_a_living_process_stays_running(store: EvidenceStore) -> None:
    add_case(store)
    record = store.evidence.add(Evidence("FitWorld", {}, case="ball", status="running"))
    store.jobs.start(record.id, "key")
    assert store.read_evidence(record.id).status == "running"
    working = store.jobs.working_on("key")
    assert working is not None
    assert working.evidence == record.id
    store.jobs.request_cancel(record.id)
    assert store.jobs.working_on("key") is None, "work being cancelled is not joined"


def test_content_hashes_do_not_depend_on_when_or_where(tmp_path: Path) -> None:
    documents = []
    for name in ("a.db", "b.db"):
        store = EvidenceStore(tmp_path / name)
        if name == "b.db":
            store.evidence.add(Evidence("Other", {}))
        documents.append(store.observations.put("tracks", {"video": "abc"}, {"n": 1}, {"x": np.arange(3.0)}).id)
        store.close()
    assert documents[0] == documents[1]
