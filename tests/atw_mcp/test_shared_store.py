"""Two servers and eight clients on one store: nothing is lost, nothing is doubled."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client

from atw_mcp.server import build_server
from evidence_store import EvidenceStore
from evidence_store.checking import check
from tests.atw_mcp.connections import REPOSITORY

CLIENTS = 8


@contextmanager
def served(store: Path) -> Iterator[str]:
    """A server over HTTP in a process of its own; yields its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "atw_mcp", "serve", "--http", "--port", str(port), "--store", str(store)]
    with subprocess.Popen(command, cwd=REPOSITORY, env=os.environ | {"PYTHONPATH": str(REPOSITORY)}) as process:
        try:
            for _ in range(600):
                with socket.socket() as attempt:
                    if attempt.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.1)
            yield f"http://127.0.0.1:{port}/mcp/{store.stem}"
        finally:
            process.terminate()


@pytest.mark.parametrize(("processes", "rounds"), [(False, 4), pytest.param(True, 40, marks=pytest.mark.benchmark)])
def test_nothing_is_lost_or_doubled(processes: bool, rounds: int, tmp_path: Path) -> None:
    path = tmp_path / "atw.db"
    created = EvidenceStore(path)
    created.cases.add("ball", content="x", kind="data", path="/x", facts={"bytes": 1})
    created.close()
    replies: list[dict[str, Any]] = []

    async def ask(target: Any, number: int) -> None:
        async with Client(target) as client:

            async def call(tool: str, **arguments: Any) -> dict[str, Any]:
                result = await client.call_tool(tool, arguments)
                assert not result.is_error, result.content
                body: dict[str, Any] = json.loads(result.content[0].text)
                return body

            for turn in range(rounds):
                question = f"question {turn} of client {number}"
                opened = await call("OpenCase", case="ball", questions=[question, f"question {turn} of all"])
                bound = [{"name": f"client {number}"}]
                replies.extend([opened, await call("UpdateBindings", case="ball", corrections=bound, reason=question)])
                again = await call("ReadEvidence", evidence=opened["evidence"])
                assert (again["evidence"], again["data"]) == (opened["evidence"], opened["data"])

    async def all_at_once(targets: list[Any]) -> None:
        async with anyio.create_task_group() as group:
            for number in range(CLIENTS):
                group.start_soon(ask, targets[number % len(targets)], number)

    with ExitStack() as stack:
        targets = [stack.enter_context(served(path)) if processes else build_server(path) for _ in range(2)]
        anyio.run(all_at_once, targets)

    store = EvidenceStore(path)
    stored = {record.id: store.evidence.get(record.id) for record in store.evidence.of_case("ball")}
    assert len({reply["evidence"] for reply in replies}) == len(replies) == 2 * CLIENTS * rounds
    assert stored.keys() == {reply["evidence"] for reply in replies}
    whole = [reply for reply in replies if "shortened" not in reply]  # lists of many questions are cut
    assert len(whole) >= CLIENTS * rounds
    assert all(stored[reply["evidence"]].payload["data"] == reply["data"] for reply in whole)
    questions = store.cases.questions("ball")
    assert len(questions) == len(set(questions)) == rounds * (CLIENTS + 1)
    assert len(store.cases.bindings("ball")) == CLIENTS
    assert all(finding.good for finding in check(path))
