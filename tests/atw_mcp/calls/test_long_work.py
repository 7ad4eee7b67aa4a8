"""Work that outlives its call: reported, joined, cancelled, and failed when its process is gone."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.server import MCPServer

from atw_mcp import server
from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import JobRunner, LongWork, Progress
from atw_mcp.calls.results import Answer
from atw_mcp.calls.waiting import WaitingCalls
from evidence_store import EvidenceStore, StoreError
from evidence_store.connection import Connection
from polyworld.core import interruption
from tests.atw_mcp import stdio_process
from tests.atw_mcp.connections import REPOSITORY, connection


@pytest.fixture(autouse=True)
def with_slow_tool(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "GROUPS", (*server.GROUPS, stdio_process.SLOW))


def body(result: Any) -> dict[str, Any]:
    assert not result.is_error, result.content[0].text
    loaded: dict[str, Any] = json.loads(result.content[0].text)
    return loaded


def test_work_within_its_patience_returns_its_result_and_reports_progress(store: Path) -> None:
    reported: list[tuple[float, float | None]] = []

    async def hear(progress: float, total: float | None, _message: str | None) -> None:
        reported.append((progress, total))

    async def session(client: Client) -> None:
        async with client:
            done = body(await client.call_tool("WorkSlowly", {"case": "c", "seconds": 0.5}, progress_callback=hear))
            assert (done["status"], done["data"]) == ("completed", {"steps": 5})

    with connection("memory", store, "auto") as client:
        anyio.run(session, client)
    assert reported
    assert all(total == 5 for _, total in reported)
    assert [progress for progress, _ in reported] == sorted(progress for progress, _ in reported)


def test_patience_begins_with_the_call_not_with_the_work(store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            call = {"case": "c", "seconds": 60, "opening_seconds": 2.0, "patience_seconds": 2.0}
            began = time.monotonic()
            started = body(await client.call_tool("WorkSlowly", call))
            assert started["status"] == "running"
            assert time.monotonic() - began < 3.5
            await client.call_tool("CancelWork", {"evidence": started["evidence"]})

    with connection("memory", store, "auto") as client:
        anyio.run(session, client)


@pytest.mark.parametrize("transport", ["memory", "stdio", "http"])
def test_work_beyond_its_patience_is_reported_joined_and_read_when_done(transport: str, store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            call = {"case": "c", "seconds": 2.5, "patience_seconds": 0.2}
            started = body(await client.call_tool("WorkSlowly", call))
            assert started["status"] == "running"
            assert "ReadEvidence" in started["summary"]
            joined = body(await client.call_tool("WorkSlowly", call))
            assert joined["evidence"] == started["evidence"]
            done = body(await client.call_tool("WorkSlowly", call | {"patience_seconds": 30}))
            assert (done["evidence"], done["status"]) == (started["evidence"], "completed")
            again = body(await client.call_tool("ReadEvidence", {"evidence": started["evidence"]}))
            assert again["data"] == {"steps": 25}

    with connection(transport, store, "auto") as client:
        anyio.run(session, client)


def test_running_work_is_cancelled_by_read_evidence(store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            call = {"case": "c", "seconds": 60, "patience_seconds": 0.2}
            started = body(await client.call_tool("WorkSlowly", call))
            stopped = body(await client.call_tool("CancelWork", {"evidence": started["evidence"]}))
            assert stopped["status"] == "cancelled"
            refused = await client.call_tool("CancelWork", {"evidence": started["evidence"]})
            assert refused.is_error

    with connection("memory", store, "auto") as client:
        anyio.run(session, client)


def test_many_waiting_calls_leave_the_other_tools_free(store: Path) -> None:
    async def session(client: Client) -> None:
        async with client, anyio.create_task_group() as waiting:
            call = {"case": "c", "seconds": 60, "patience_seconds": 0.1}
            evidence = body(await client.call_tool("WorkSlowly", call))["evidence"]
            ended: list[str] = []

            async def wait() -> None:
                answer = await client.call_tool("ReadEvidence", {"evidence": evidence, "wait_seconds": 50})
                ended.append(body(answer)["status"])

            for _ in range(60):  # more than there are worker threads
                waiting.start_soon(wait)
            await anyio.sleep(0.3)
            with anyio.fail_after(10):
                assert body(await client.call_tool("OpenCase", {}))["data"]["cases"]
            assert ended == []
            with anyio.fail_after(20):
                stopped = await client.call_tool("CancelWork", {"evidence": evidence})
                assert body(stopped)["status"] == "cancelled"
                while len(ended) < 60:
                    await anyio.sleep(0.05)
        assert ended == ["cancelled"] * 60

    with connection("memory", store, "auto") as client:
        anyio.run(session, client)


def test_more_waiting_calls_than_allowed_are_refused_and_may_read_at_once(store: Path) -> None:
    served = server.build_server(store)
    app: App = anyio.run(_app_of, served)
    app.waiting = WaitingCalls(most=1)

    async def session() -> None:
        async with Client(served) as client, anyio.create_task_group() as waiting:
            call = {"case": "c", "seconds": 60, "patience_seconds": 0.1}
            evidence = body(await client.call_tool("WorkSlowly", call))["evidence"]
            waiting.start_soon(client.call_tool, "ReadEvidence", {"evidence": evidence, "wait_seconds": 50})
            await anyio.sleep(0.3)
            refused = await client.call_tool("ReadEvidence", {"evidence": evidence, "wait_seconds": 50})
            assert refused.is_error
            assert "without wait_seconds" in refused.content[0].text
            assert body(await client.call_tool("ReadEvidence", {"evidence": evidence}))["status"] == "running"
            waiting.cancel_scope.cancel()

    anyio.run(session)


def test_a_disk_that_is_full_at_the_end_is_reported_in_a_sentence(
    store: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    @contextmanager
    def full(_: Connection) -> Iterator[None]:
        raise StoreError("the disk is full")
        yield

    async def session() -> None:
        async with Client(server.build_server(store)) as client:
            call = {"case": "c", "seconds": 60, "patience_seconds": 0.1}
            assert body(await client.call_tool("WorkSlowly", call))["status"] == "running"
            monkeypatch.setattr(Connection, "write", full)

    with caplog.at_level("WARNING"):
        anyio.run(session)
    assert "could not be stored: the disk is full" in caplog.text
    assert "Traceback" not in caplog.text


async def _app_of(served: MCPServer[App]) -> App:
    async with served._lowlevel_server.lifespan(served._lowlevel_server) as app:
        return app


def test_work_of_another_process_can_be_watched_joined_and_cancelled_and_stops_with_it(store: Path) -> None:
    call = {"case": "c", "seconds": 60, "patience_seconds": 0.2}

    async def session(worker: Client, watcher: Client) -> None:
        async with worker, watcher:
            started = body(await worker.call_tool("WorkSlowly", call))
            seen = body(await watcher.call_tool("ReadEvidence", {"evidence": started["evidence"]}))
            assert seen["status"] == "running"
            joined = body(await watcher.call_tool("WorkSlowly", call))
            assert joined["evidence"] == started["evidence"]
            stopped = body(await watcher.call_tool("CancelWork", {"evidence": started["evidence"]}))
            assert stopped["status"] == "cancelled"
            assert body(await worker.call_tool("WorkSlowly", call | {"seconds": 50}))["status"] == "running"

    with connection("stdio", store, "auto") as worker, connection("memory", store, "auto") as watcher:
        anyio.run(session, worker, watcher)
    deadline = time.monotonic() + 10
    while EvidenceStore(store).read_evidence("ev-2").status == "running" and time.monotonic() < deadline:
        time.sleep(0.1)
    assert EvidenceStore(store).read_evidence("ev-2").status in ("cancelled", "failed")


def test_work_that_breaks_is_failed_and_the_server_goes_on(store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            broken = await client.call_tool("WorkSlowly", {"case": "c", "seconds": 0.1, "fail": "secret text"})
            assert broken.is_error
            assert "RuntimeError" in broken.content[0].text
            assert "secret" not in broken.content[0].text
            assert body(await client.call_tool("ReadEvidence", {"evidence": "ev-1"}))["status"] == "failed"
            again = body(await client.call_tool("WorkSlowly", {"case": "c", "seconds": 0.1}))
            assert again["status"] == "completed"

    with connection("memory", store, "auto") as client:
        anyio.run(session, client)


def test_a_call_that_the_client_gives_up_stops_its_work(store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            with anyio.move_on_after(0.5):
                await client.call_tool("WorkSlowly", {"case": "c", "seconds": 60})
            with anyio.fail_after(10):
                while EvidenceStore(store).read_evidence("ev-1").status == "running":
                    await anyio.sleep(0.1)
            assert EvidenceStore(store).read_evidence("ev-1").status == "cancelled"

    with connection("memory", store, "auto") as client:
        anyio.run(session, client)


def test_cancelled_work_ends_by_itself_with_what_it_has_or_is_interrupted(store: Path) -> None:
    draft = Answer(summary="working", data={}, case="c")

    def deaf(_: Progress) -> Answer:
        while True:
            interruption.check()  # as the solvers do
            time.sleep(0.01)

    def hearing(progress: Progress) -> Answer:
        while not progress.cancelled():
            time.sleep(0.01)
        return replace(draft, status="cancelled", summary="best so far")

    opened = EvidenceStore(store)
    jobs = JobRunner(opened)
    for work, summary in ((deaf, "cancelled at an unknown stage"), (hearing, "best so far")):
        job = jobs.start("FitWorld", {}, LongWork(summary, work, draft, 1.0))
        jobs.cancel(job.evidence)
        assert job.ended.wait(10)
        record = opened.read_evidence(job.evidence)
        assert (record.status, record.summary) == ("cancelled", summary)


@pytest.mark.skipif(os.name != "posix", reason="kills a process by signal")
def test_a_crashed_server_leaves_failed_not_running(store: Path) -> None:
    script = (
        "import anyio, os, signal, sys\n"
        "from pathlib import Path\n"
        "from mcp import Client\n"
        "from atw_mcp import server\n"
        "from tests.atw_mcp import stdio_process\n"
        "server.GROUPS = (*server.GROUPS, stdio_process.SLOW)\n"
        "async def main():\n"
        "    async with Client(server.build_server(Path(sys.argv[1]))) as client:\n"
        "        await client.call_tool('WorkSlowly', {'case': 'c', 'seconds': 60, 'patience_seconds': 0.2})\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "anyio.run(main)\n"
    )
    crashed = subprocess.run([sys.executable, "-c", script, str(store)], cwd=REPOSITORY)
    assert crashed.returncode == -signal.SIGKILL

    async def session(client: Client) -> None:
        async with client:
            left = body(await client.call_tool("ReadEvidence", {"evidence": "ev-1"}))
            assert left["status"] == "failed"
            assert "WorkSlowly" in left["summary"]
            done = body(await client.call_tool("WorkSlowly", {"case": "c", "seconds": 0.1}))
            assert done["status"] == "completed"

    with connection("memory", store, "auto") as client:
        anyio.run(session, client)
