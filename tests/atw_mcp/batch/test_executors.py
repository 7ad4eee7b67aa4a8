"""Results do not depend on who runs the cases, nor on processes that are killed meanwhile."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from evidence_store.checksums import COLUMNS
from tests.atw_mcp.batch.cases import discs, puck, rows, write

FILES = ("answers.jsonl", "failures.jsonl")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a manifest of eight cases, of which one has no file; results go beside it."""
    folder = tmp_path / "manifest"
    folder.mkdir()
    many = [discs(f"discs{number}") for number in range(6)]
    write(folder, *many, {"id": "gone", "tracks": "none.csv"}, puck(folder))
    return folder


def command(folder: Path, out: str, executor: str) -> list[str]:
    options = ["--out", str(folder.parent / out), "--executor", executor]
    return [sys.executable, "-m", "atw_mcp", "batch", str(folder / "cases.jsonl"), *options]


def results(out: Path) -> dict[str, Any]:
    """All that is to be equal: the bytes of answers and failures, and every row of the store."""
    found: dict[str, Any] = {name: (out / name).read_bytes() for name in FILES}
    with sqlite3.connect(out / "store.db") as database:
        for table in COLUMNS:
            found[table] = database.execute(f"SELECT * FROM {table}").fetchall()
    return found


@pytest.mark.benchmark
def test_one_worker_two_workers_and_dask_give_equal_bytes(folder: Path) -> None:
    for out, executor in (("one", "local:1"), ("two", "local:2"), ("dask", "dask")):
        if executor == "dask":
            pytest.importorskip("distributed")
        assert subprocess.run(command(folder, out, executor), check=False).returncode == 1  # one case has no file
        assert results(folder.parent / out) == results(folder.parent / "one")


@pytest.mark.benchmark
def test_a_killed_batch_goes_on_where_it_was(folder: Path) -> None:
    subprocess.run(command(folder, "whole", "local:1"), check=False)
    batch = subprocess.Popen(command(folder, "out", "local:1"), start_new_session=True)
    out = folder.parent / "out"
    shards = out / "shards"
    while len(list(shards.glob("*.db"))) < 3:
        assert batch.poll() is None
        time.sleep(0.01)
    os.killpg(batch.pid, signal.SIGKILL)
    batch.wait()
    kept = {path: path.stat().st_mtime_ns for path in shards.glob("*.db")}
    assert 3 <= len(kept) < 8
    assert subprocess.run(command(folder, "out", "local:1"), check=False).returncode == 1
    assert {path: path.stat().st_mtime_ns for path in kept} == kept  # none was run again
    assert results(out) == results(folder.parent / "whole")
    assert len(rows(out / "answers.jsonl")) == 19
