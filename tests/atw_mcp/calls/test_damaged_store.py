"""What an agent sees of a store that is damaged or full: the damage named, the rest as ever, no traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client

from atw_mcp.server import build_server
from evidence_store import EvidenceStore
from tests.atw_mcp.connections import REPOSITORY
from tests.evidence_store.records import filled, tamper


def answers(path: Path, *calls: tuple[str, dict[str, Any]]) -> list[tuple[bool, str, str]]:
    """For each call whether it was refused, its text, and its summary."""
    found = []

    async def session() -> None:
        async with Client(build_server(path)) as client:
            for name, arguments in calls:
                result = await client.call_tool(name, arguments)
                summary = (result.structured_content or {}).get("summary", "")
                found.append((bool(result.is_error), result.content[0].text, summary))

    anyio.run(session)
    return found


def test_damaged_records_are_named_and_hide_nothing_else(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    store.cases.add("second", content="c", kind="video", path="/s.mp4", facts={})
    tamper(store.path, "UPDATE cases SET kind = 'data' WHERE id = 'second'")
    tamper(store.path, "UPDATE evidence SET status = 'completed' WHERE seq = 3")
    cases, opened, listed, whole, broken = answers(
        store.path,
        ("OpenCase", {}),
        ("OpenCase", {"case": "second"}),
        ("ReadEvidence", {"case": "ball"}),
        ("ReadEvidence", {"evidence": "ev-1"}),
        ("ReadEvidence", {"evidence": "ev-3"}),
    )
    assert not cases[0]
    assert "case 'second'" in cases[2]
    assert "ball" in cases[1]
    assert opened[0]
    assert not listed[0]
    assert "evidence ev-3" in listed[2]
    assert not whole[0]
    assert broken[0]
    for refused in (opened, broken):
        assert "atw-mcp doctor" in refused[1]
        assert "lost" not in refused[1]


PROGRAM = """
import resource, sys, time
from atw_mcp.calls.jobs import JobRunner, LongWork
from atw_mcp.calls.results import Answer
from evidence_store import EvidenceStore, StoreDiskError
store = EvidenceStore(sys.argv[1])
jobs = JobRunner(store)
def work(progress):
    while True: time.sleep(0.05)  # deaf to being cancelled
for name in "abc":
    jobs.start("FitWorld", {}, LongWork(name, work, Answer(summary="fitting", data={}), 1.0))
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
try:
    store.worlds.put("world-z", "{}")
except StoreDiskError as error:
    print(error)
jobs.shutdown(wait=0.2)
store.close()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits of file sizes are POSIX's")
def test_shutting_down_on_a_full_disk_prints_no_traceback_and_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "atw.db"
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path)], capture_output=True, text=True, cwd=REPOSITORY, timeout=60
    )
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stderr
    assert ended.stderr.count("could not be marked failed") == 3
    assert "nothing was changed" in ended.stdout
    assert [EvidenceStore(path).read_evidence(f"ev-{n}").status for n in (1, 2, 3)] == ["failed"] * 3
