"""Stores filled apart become one, in which every record is as it was written."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import pytest

from evidence_store import Evidence, EvidenceStore, RecordDamaged, StoreError
from evidence_store.checking import check
from evidence_store.checksums import COLUMNS
from evidence_store.merge import merge
from tests.evidence_store.records import filled, tamper


def part(folder: Path, case: str, first: int) -> Path:
    """A store whose case has evidence from `first` on."""
    path = folder / f"{case}.db"
    EvidenceStore(path).evidence.number_from(first)
    filled(path, case).close()
    return path


def rows(path: Path, table: str) -> list[tuple[Any, ...]]:
    with sqlite3.connect(path) as database:
        return database.execute(f"SELECT * FROM {table}").fetchall()


def test_evidence_keeps_its_ids_and_equal_content_is_stored_once(tmp_path: Path) -> None:
    parts = [part(tmp_path, "ball", 1001), part(tmp_path, "cube", 2001)]
    assert merge(parts, tmp_path / "all.db") == 6
    assert all(finding.good for finding in check(tmp_path / "all.db"))
    assert rows(tmp_path / "all.db", "evidence") == rows(parts[0], "evidence") + rows(parts[1], "evidence")
    assert [r[0] for r in rows(tmp_path / "all.db", "evidence")] == [1001, 1002, 1003, 2001, 2002, 2003]
    assert rows(tmp_path / "all.db", "worlds") == rows(parts[0], "worlds")  # the same in both
    assert len(rows(tmp_path / "all.db", "observations")) == 2
    store = EvidenceStore(tmp_path / "all.db")
    assert [case.id for case in store.cases.all()] == ["ball", "cube"]
    assert store.cases.answers("cube")[0].evidence == ("ev-1",)
    assert store.evidence.add(Evidence("OpenCase", {})).id == "ev-2004"


def test_merging_again_gives_equal_records(tmp_path: Path) -> None:
    parts = [part(tmp_path, "ball", 1), part(tmp_path, "cube", 2001)]
    merge(parts, tmp_path / "one.db")
    merge(parts, tmp_path / "two.db")
    for table in COLUMNS:
        assert rows(tmp_path / "one.db", table) == rows(tmp_path / "two.db", table)


def test_parts_that_cannot_be_merged_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    ball, cube = part(tmp_path, "ball", 1), part(tmp_path, "cube", 1)
    with pytest.raises(StoreError, match="other evidence of the ids ev-1, ev-2, ev-3"):
        merge([ball, cube], tmp_path / "all.db")
    with pytest.raises(StoreError, match="has a case 'ball' already"):
        merge([ball, ball], tmp_path / "all.db")
    store = EvidenceStore(cube)
    store.evidence.add(Evidence("FitWorld", {}, case="cube", status="running"))
    with pytest.raises(StoreError, match="unfinished work"):
        merge([cube], tmp_path / "all.db")
    tamper(ball, "UPDATE worlds SET document = '{}' WHERE id = 'world-a'")
    with pytest.raises(RecordDamaged, match="world-a"):
        merge([ball], tmp_path / "all.db")
    assert not list(tmp_path.glob("all.db*"))
    with pytest.raises(StoreError, match="exists already"):
        merge([], cube)


def test_ids_never_begin_before_those_given_already(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    with pytest.raises(ValueError, match="the next record is ev-4"):
        store.evidence.number_from(3)
    store.evidence.number_from(4)
    assert store.evidence.add(Evidence("OpenCase", {})).id == "ev-4"
