"""A store is examined without being changed, repaired where nothing is lost by it, and else recovered beside itself."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from evidence_store import Evidence, EvidenceStore, RecordDamaged, StoreDamaged, StoreError
from evidence_store.checking import check, mend
from evidence_store.checksums import COLUMNS
from evidence_store.recovery import recover
from tests.evidence_store.records import filled, tamper

PAGE = 4096


def faults(path: Path) -> dict[str, str]:
    return {finding.subject: finding.text for finding in check(path) if not finding.good}


def records(path: Path) -> int:
    database = sqlite3.connect(path)
    count = sum(database.execute(f"SELECT count(*) FROM {table}").fetchone()[0] for table in COLUMNS)
    database.close()
    return count


def test_a_whole_store_has_no_faults_and_is_not_changed(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    assert faults(store.path) == {}, "while it is used"
    store.close()
    before = store.path.read_bytes()
    assert faults(store.path) == {}
    assert mend(store.path) == []
    assert store.path.read_bytes() == before
    assert faults(tmp_path / "none.db") == {}
    assert not (tmp_path / "none.db").exists()


def test_damaged_records_are_named_and_the_others_recovered(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    store.close()
    count = records(store.path)
    tamper(store.path, "UPDATE evidence SET payload = '{}' WHERE seq = 1")
    tamper(store.path, "UPDATE worlds SET document = '{}' WHERE id = 'world-a'")
    assert set(faults(store.path)) == {"checksums"}
    assert "world 'world-a', evidence ev-1" in faults(store.path)["checksums"]
    recovery = recover(store.path, tmp_path / "new.db")
    assert recovery.lost[:2] == ["world 'world-a'", "evidence ev-1"]
    assert len(recovery.lost) == 4, "and the two relations to the lost world"
    assert recovery.kept == count - 2
    assert faults(recovery.path) == {}
    again = EvidenceStore(recovery.path)
    assert again.read_evidence("ev-3").tool == "FitWorld"
    assert again.cases.get("ball").committed_world == "world-b"
    assert again.evidence.add(Evidence("OpenCase", {})).id == "ev-4"
    assert "checksums" in faults(store.path), "the damaged store is left as it is"
    with pytest.raises(StoreError, match="exists already"):
        recover(store.path, tmp_path / "new.db")


def test_a_case_whose_record_is_lost_keeps_its_evidence(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    tamper(store.path, "UPDATE cases SET content = 'other'")
    recovery = recover(store.path, tmp_path / "new.db")
    assert recovery.lost == ["case 'ball'"]
    assert "stand-in" in recovery.changed[0]
    again = EvidenceStore(recovery.path)
    assert [record.id for record in again.evidence.of_case("ball")] == ["ev-1", "ev-3"]
    assert faults(recovery.path) == {}


@pytest.mark.parametrize("damage", ["truncated", "page overwritten", "first bytes gone"])
def test_a_damaged_file_gives_what_is_still_in_it(tmp_path: Path, damage: str) -> None:
    store = filled(tmp_path / "atw.db")
    for index in range(200):
        store.evidence.add(Evidence("Rollout", {"index": index}, case="ball", summary="s" * 300))
    store.close()
    content = bytearray(store.path.read_bytes())
    if damage == "truncated":
        del content[-6 * PAGE :]
    elif damage == "first bytes gone":
        content[:16] = b"x" * 16
    else:
        at = content.rindex(b"s" * 300) // PAGE * PAGE
        content[at : at + PAGE] = b"\xa5" * PAGE
    store.path.write_bytes(content)
    assert faults(store.path)
    if damage != "page overwritten":
        with pytest.raises(StoreDamaged):
            mend(store.path)
    recovery = recover(store.path, tmp_path / "new.db")
    assert recovery.kept >= (203 if damage == "first bytes gone" else 150)
    assert bool(recovery.lost) == (damage != "first bytes gone")
    assert sorted(path.name for path in tmp_path.iterdir() if "new" in path.name) == ["new.db"]
    assert faults(recovery.path) == {}
    assert store.path.read_bytes() == content


def test_a_broken_index_is_rebuilt(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    store.close()
    database = sqlite3.connect(store.path)
    database.executescript(
        "PRAGMA writable_schema = ON;"
        "CREATE TABLE spare (case_id, seq); CREATE INDEX spare_index ON spare (case_id, seq);"
        "UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master WHERE name = 'spare_index') "
        "WHERE name = 'evidence_by_case';"
        "DELETE FROM sqlite_master WHERE name = 'spare_index'; DELETE FROM sqlite_master WHERE name = 'spare';"
    )
    database.close()
    assert "evidence_by_case" in faults(store.path)["integrity"]
    assert EvidenceStore(store.path).evidence.of_case("ball") == []
    assert any("indices" in line for line in mend(store.path))
    assert [record.id for record in EvidenceStore(store.path).evidence.of_case("ball")] == ["ev-1", "ev-3"]


def test_work_of_ended_processes_is_found_and_marked_failed(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    program = (
        "import os, sys\nfrom evidence_store import *\ns = EvidenceStore(sys.argv[1])\n"
        "e = s.evidence.add(Evidence('FitWorld', {}, case='ball', status='running'))\n"
        "s.jobs.start(e.id, 'key')\nos._exit(1)\n"
    )
    subprocess.run([sys.executable, "-c", program, str(store.path)], check=False)
    store.evidence.add(Evidence("FitWorld", {}, case="ball", status="running"))
    assert faults(store.path) == {"jobs": "running without a living process: ev-4, ev-5"}
    assert any("ev-4, ev-5" in line for line in mend(store.path))
    assert faults(store.path) == {}
    assert EvidenceStore(store.path).evidence.get("ev-4").status == "failed"


def test_records_of_version_1_are_recovered_too(tmp_path: Path) -> None:
    path = tmp_path / "old.db"
    database = sqlite3.connect(path)
    database.executescript((Path(__file__).parent / "version_1.sql").read_text())
    with database:
        database.execute("UPDATE evidence SET payload = '{' WHERE seq = 1")
    database.close()
    recovery = recover(path, tmp_path / "new.db")
    assert recovery.lost == ["evidence ev-1"]
    assert EvidenceStore(recovery.path).read_evidence("ev-3").status == "failed"
    with pytest.raises(RecordDamaged):
        EvidenceStore(path).read_evidence("ev-1")
