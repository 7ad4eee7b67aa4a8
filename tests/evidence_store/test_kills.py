"""A writer is killed at random moments: the store opens, and what it acknowledged is there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from evidence_store import EvidenceStore
from evidence_store.checking import check, mend
from tests.evidence_store.writer import compute

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
LONGEST = 0.15  # [s] a writer lives: some ten records


def kill(writer: subprocess.Popen[str], seed: int, seconds: float) -> list[list[str]]:
    """Start one writer, kill it after a while; returns what it acknowledged."""
    assert writer.stdin is not None
    assert writer.stdout is not None
    print(seed, file=writer.stdin, flush=True)
    first = writer.stdout.readline().split()
    assert first[0] == "pid"
    timer = threading.Timer(seconds, os.kill, (int(first[1]), signal.SIGKILL))
    timer.start()
    lines = []
    while (line := writer.stdout.readline()) != "gone\n":
        lines.append(line.split())
    timer.join()
    return lines


@pytest.mark.parametrize("kills", [8, pytest.param(200, marks=pytest.mark.benchmark)])
def test_no_acknowledged_record_is_lost(kills: int, tmp_path: Path) -> None:
    path = tmp_path / "atw.db"
    created = EvidenceStore(path)
    created.cases.add("ball", content="x", kind="data", path="/x", facts={})
    created.close()
    rng = np.random.default_rng(kills)
    started: dict[str, int] = {}
    completed: dict[str, int] = {}
    rollouts: dict[str, int] = {}
    with subprocess.Popen(
        [sys.executable, "-m", "tests.evidence_store.writer", str(path)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2],
    ) as writer:  # fmt: skip
        for seed in range(kills):
            said = kill(writer, seed, rng.uniform(0, LONGEST))
            for line in said:
                kept = {"started": started, "completed": completed, "rollout": rollouts}[line[0]]
                assert line[1] not in kept, "an id was given twice"
                kept[line[1]] = int(line[2])
            store = EvidenceStore(path)
            seen = {record.id: store.read_evidence(record.id) for record in store.evidence.of_case("ball")}
            assert started.keys() <= seen.keys()
            assert all(seen[identifier].arguments == {"number": number} for identifier, number in started.items())
            assert all(seen[identifier].status == "completed" for identifier in completed)
            assert all(seen[identifier].payload["data"] == {"number": n} for identifier, n in completed.items())
            assert {record.status for record in seen.values()} <= {"completed", "failed"}
            assert store.jobs.all() == []
            store.close()
        writer.stdin.close()  # type: ignore[union-attr]
    assert completed
    assert any(record.status == "failed" for record in seen.values()), "none was killed while it worked"
    store = EvidenceStore(path)
    for identifier, number in rollouts.items():
        document, arrays = compute(number)
        again, computed = store.rollouts.get_or_compute("rollout", {"number": number}, lambda: pytest.fail("computed"))
        assert (again.id, again.document, computed) == (identifier, document, False)
        assert np.array_equal(again.arrays["x"], arrays["x"])
    assert all(finding.good for finding in check(path))
    assert mend(path) == []
    store.close()


def test_a_writer_killed_while_it_makes_the_store_leaves_one_that_opens(tmp_path: Path) -> None:
    program = "import sys\nprint(flush=True)\nfrom evidence_store import EvidenceStore\nEvidenceStore(sys.argv[1])\n"
    for index, seconds in enumerate((0.3, 0.32)):
        path = tmp_path / f"{index}.db"
        with subprocess.Popen([sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE) as maker:
            assert maker.stdout is not None
            maker.stdout.readline()
            time.sleep(seconds)
            maker.kill()
        assert EvidenceStore(path).cases.all() == []
