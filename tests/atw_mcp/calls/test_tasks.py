"""Long work as tasks (SEP-2663), for clients that offer the extension, over every transport."""

from __future__ import annotations

import itertools
import json
import platform
import time
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.shared.exceptions import MCPError
from mcp_types import SubscriptionFilter, SubscriptionsListenRequest, SubscriptionsListenRequestParams

from atw_mcp import server
from atw_mcp.calls.app import App
from atw_mcp.calls.following import follow
from atw_mcp.calls.jobs import Progress, RunningJob
from atw_mcp.calls.tasks import task_state
from evidence_store import Evidence, EvidenceStore
from tests.atw_mcp import stdio_process, task_tools
from tests.atw_mcp.connections import connection
from tests.atw_mcp.task_client import Tasks, Wire, ask, call, offering, settled

LONG = {"case": "c", "seconds": 60, "patience_seconds": 30}


@pytest.fixture(autouse=True)
def with_made_up_tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "GROUPS", (*server.GROUPS, stdio_process.SLOW, task_tools.TASKS))


def status(store: Path, evidence: str) -> str:
    return EvidenceStore(store).read_evidence(evidence).status


async def until(store: Path, evidence: str, wanted: str, seconds: float = 10) -> None:
    with anyio.fail_after(seconds):
        while status(store, evidence) != wanted:
            await anyio.sleep(0.05)


async def started(store: Path) -> str:
    """The evidence of work that has started and is not asked to stop."""
    with anyio.fail_after(10):
        while True:
            jobs = [job for job in EvidenceStore(store).jobs.all() if not job.cancel_requested]
            if jobs:
                return jobs[-1].evidence
            await anyio.sleep(0.05)


@pytest.mark.parametrize("transport", ["memory", "http"])
def test_long_work_is_a_task_that_is_read_cancelled_and_known_to_its_client_alone(transport: str, store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            await _read_and_cancelled(client)

    with connection(transport, store, "auto") as client:
        anyio.run(session, offering(client))


async def _read_and_cancelled(client: Client) -> None:
    at_once = await call(client, "WorkSlowly", case="c", seconds=0.1)
    assert at_once["resultType"] == "complete"

    created = await call(client, "WorkSlowly", case="c", seconds=1.2)
    assert (created["resultType"], created["status"], created["ttlMs"]) == ("task", "working", None)
    task = created["taskId"]
    assert "counting" in (await ask(client, "tasks/get", task))["statusMessage"]
    assert (await ask(client, "tasks/update", task, inputResponses={"x": {}}))["resultType"] == "complete"
    done = await settled(client, task)
    assert (done["resultType"], done["status"]) == ("complete", "completed")
    assert done["createdAt"] <= done["lastUpdatedAt"]
    evidence = task.partition(".")[0]
    same = await call(client, "ReadEvidence", evidence=evidence)
    assert done["result"]["structuredContent"] == same["structuredContent"]
    assert done["result"]["structuredContent"]["data"] == {"steps": 12}

    stopped = (await call(client, "WorkSlowly", **LONG))["taskId"]
    asked = time.monotonic()
    assert set(await ask(client, "tasks/cancel", stopped)) <= {"resultType", "_meta"}
    assert (await settled(client, stopped))["status"] == "cancelled"
    assert time.monotonic() - asked < 10
    assert (await ask(client, "tasks/cancel", stopped))["resultType"] == "complete"

    for unknown in ("ev-2", "ev-2.guess", "ev-99.guess", "guess"):
        with pytest.raises(MCPError) as refused:
            await ask(client, "tasks/get", unknown)
        assert refused.value.code == -32602


@pytest.mark.parametrize("transport", ["memory", "http"])
def test_clients_that_do_not_offer_the_extension_get_no_task(transport: str, store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            result = await client.call_tool("WorkSlowly", {"case": "c", "seconds": 1, "patience_seconds": 0.1})
            assert json.loads(result.content[0].text)["status"] == "running"  # type: ignore[union-attr]
            for method in ("tasks/get", "tasks/update", "tasks/cancel"):
                with pytest.raises(MCPError) as refused:
                    await ask(client, method, "ev-1.x", inputResponses={})
                assert refused.value.code == -32021

    with connection(transport, store, "auto") as client:
        anyio.run(session, client)


def test_a_tool_that_fails_completes_its_task_and_a_protocol_error_fails_it(store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            refused = await settled(client, (await call(client, "failing_job"))["taskId"])
            assert (refused["status"], refused["result"]["isError"]) == ("completed", True)
            assert "nothing to compute" in refused["result"]["content"][0]["text"]
            broken = await settled(client, (await call(client, "protocol_error_job"))["taskId"])
            assert (broken["status"], broken["error"]["message"]) == ("failed", "the machine is gone")
            assert "result" not in broken

    with connection("memory", store, "auto") as client:
        anyio.run(session, offering(client))


def test_a_task_outlives_its_client_and_is_answered_by_another_server_on_the_store(store: Path) -> None:
    async def start(client: Client) -> str:
        async with client:
            return str((await call(client, "WorkSlowly", case="c", seconds=2))["taskId"])

    async def finish(client: Client, task: str) -> None:
        async with client:
            joined = await call(client, "WorkSlowly", case="c", seconds=2)
            assert joined["taskId"] == task
            assert (await settled(client, task))["result"]["structuredContent"]["data"] == {"steps": 20}

    with connection("http", store, "auto") as working:
        task = anyio.run(start, offering(working))
        with connection("memory", store, "auto") as other:
            anyio.run(finish, offering(other), task)


def test_over_stdio_tasks_work_calls_are_given_up_and_work_fails_when_stdin_closes(store: Path) -> None:
    heard = Tasks()

    async def session(client: Client) -> str:
        async with client, anyio.create_task_group() as group:
            await _read_and_cancelled(client)
            await _notified(client, heard)
            await _given_up(client, store)
            left = str((await call(client, "WorkSlowly", **LONG))["taskId"])
            # ends the server while it works, as a client that crashes does
            await client.session._dispatcher._write_stream.aclose()  # type: ignore[attr-defined]
            group.cancel_scope.cancel()
        return left

    async def look(client: Client, task: str) -> None:
        async with client:
            state = await ask(client, "tasks/get", task)
            assert state["status"] == "failed"
            assert "call WorkSlowly again" in state["error"]["message"]

    with connection("stdio", store, "auto") as client:
        left = anyio.run(session, offering(client, heard))
    anyio.run(until, store, left.partition(".")[0], "failed")
    with connection("memory", store, "auto") as client:
        anyio.run(look, offering(client), left)


async def _ignore(client: Client, arguments: dict[str, Any]) -> None:
    try:
        await client.call_tool("WorkSlowly", arguments)
    except MCPError:
        return


def test_a_task_whose_process_is_gone_has_failed(store: Path) -> None:
    app = App(store)
    record = app.store.evidence.add(Evidence("FitWorld", {}, case="c", status="running", summary="fitting"))
    app.store.jobs.start(record.id, "key")
    task = app.store.tasks.open(record.id)
    with app.store.connection.write() as database:
        database.conn.execute("UPDATE jobs SET pid = 2147483000, host = ?", [platform.node()])
    for _ in range(2):  # the second look reads what the first recorded
        state = task_state(app, task.id, "2026-07-28")
        assert (state["status"], state["error"]["code"]) == ("failed", -32603)
        assert "call FitWorld again" in state["error"]["message"]


def test_a_call_that_is_given_up_stops_its_work_only_where_nobody_else_wants_it(store: Path) -> None:
    async def session(client: Client, tasks: Client) -> None:
        async with client, tasks:
            task = (await call(tasks, "WorkSlowly", **LONG))["taskId"]
            with anyio.move_on_after(0.3):
                await client.call_tool("WorkSlowly", LONG)
            await anyio.sleep(0.5)
            assert (await ask(tasks, "tasks/get", task))["status"] == "working"
            await ask(tasks, "tasks/cancel", task)

            async with anyio.create_task_group() as waiting:
                alone = {"case": "c", "seconds": 50}
                waiting.start_soon(client.call_tool, "WorkSlowly", alone)
                await anyio.sleep(0.3)
                with anyio.move_on_after(0.3):
                    await client.call_tool("WorkSlowly", alone)
                await anyio.sleep(0.5)
                assert status(store, "ev-2") == "running"
                waiting.cancel_scope.cancel()
            await until(store, "ev-2", "cancelled")

    served = server.build_server(store)
    anyio.run(session, Client(served), offering(Client(served)))


def test_closing_the_stream_of_a_call_over_http_stops_its_work(store: Path) -> None:
    async def session(client: Client) -> None:
        async with client:
            await _given_up(client, store)

    with connection("http", store, "auto") as client:
        anyio.run(session, client)


async def _given_up(client: Client, store: Path) -> None:
    async with anyio.create_task_group() as group:
        group.start_soon(_ignore, client, {"case": "c", "seconds": 40, "patience_seconds": 30})
        evidence = await started(store)
        group.cancel_scope.cancel()
    await until(store, evidence, "cancelled")


def test_a_session_that_ends_leaves_the_work_of_an_http_server_running(store: Path) -> None:
    async def session(client: Client) -> None:
        async with client, anyio.create_task_group() as group:
            group.start_soon(_ignore, client, {"case": "c", "seconds": 1.5})
            with anyio.fail_after(10):
                while EvidenceStore(store).jobs.get("ev-1") is None:
                    await anyio.sleep(0.05)
            await client.session._dispatcher._write_stream.aclose()  # type: ignore[attr-defined]
            group.cancel_scope.cancel()

    with connection("http", store, "legacy") as client:
        anyio.run(session, client)
        anyio.run(until, store, "ev-1", "completed")


@pytest.mark.parametrize("transport", ["memory", "http"])
def test_listening_clients_are_notified_of_tasks_and_of_evidence_that_is_ready(transport: str, store: Path) -> None:
    heard = Tasks()

    async def session(client: Client) -> None:
        async with client:
            await _notified(client, heard)

    with connection(transport, store, "auto") as client:
        anyio.run(session, offering(client, heard))


async def _notified(client: Client, heard: Tasks) -> None:
    async def listen(task: str) -> None:
        filtered = SubscriptionFilter.model_validate({"taskIds": [task, "ev-9.unknown"]})
        request = SubscriptionsListenRequest(params=SubscriptionsListenRequestParams(notifications=filtered))
        await client.session.send_request(request, Wire)

    async with anyio.create_task_group() as group:
        task = (await call(client, "WorkSlowly", case="c", seconds=1.5))["taskId"]
        uri = f"atw://evidence/{task.partition('.')[0]}"
        group.start_soon(listen, task)
        with anyio.fail_after(10):
            async with client.listen(resource_subscriptions=[uri]) as stream:
                async for event in stream:
                    assert getattr(event, "uri", None) == uri
                    break
            while not heard.seen or heard.seen[-1]["status"] == "working":
                await anyio.sleep(0.05)
        assert {seen["status"] for seen in heard.seen} == {"working", "completed"}
        assert heard.seen[-1]["taskId"] == task
        assert heard.seen[-1]["result"]["structuredContent"]["data"] == {"steps": 15}
        group.cancel_scope.cancel()


@pytest.mark.parametrize("transport", ["stdio", "http"])
@pytest.mark.filterwarnings("ignore:resources/:mcp.shared.exceptions.MCPDeprecationWarning")
def test_subscribers_of_the_handshake_era_are_notified_when_evidence_is_ready(transport: str, store: Path) -> None:
    updated: list[str] = []

    async def hear(message: Any) -> None:
        if getattr(message, "method", "") == "notifications/resources/updated":
            updated.append(str(message.params.uri))

    async def session(client: Client) -> None:
        async with client:
            capabilities = client.server_capabilities
            assert capabilities is not None
            assert capabilities.resources is not None
            assert capabilities.resources.subscribe
            for seconds in (1.0, 1.1):
                await client.call_tool("WorkSlowly", {"case": "c", "seconds": seconds, "patience_seconds": 0.1})
            for evidence in ("ev-1", "ev-1", "ev-2"):
                await client.subscribe_resource(f"atw://evidence/{evidence}")
            await client.unsubscribe_resource("atw://evidence/ev-2")
            with pytest.raises(MCPError):
                await client.subscribe_resource("atw://evidence/ev-99")
            with anyio.fail_after(10):
                while not updated:
                    await anyio.sleep(0.05)
            await until(store, "ev-2", "completed")
            await anyio.sleep(0.6)
            assert updated == ["atw://evidence/ev-1"]
            if transport == "stdio":
                await _given_up(client, store)

    with connection(transport, store, "legacy") as client:
        anyio.run(session, Client(client.server, mode="legacy", message_handler=hear))


def test_progress_is_reported_every_second_and_grows_while_work_is_silent(store: Path) -> None:
    reports: list[tuple[float, float, float | None]] = []

    async def report(done: float, total: float | None, _message: str) -> None:
        reports.append((time.monotonic(), done, total))

    async def watch() -> None:
        job = RunningJob("ev-1", Progress(done=3.0, total=8.0))
        with anyio.move_on_after(2.2):
            await follow(App(store), job, report)

    anyio.run(watch)
    times, values, totals = zip(*reports, strict=True)
    assert len(values) == 3
    assert max(b - a for a, b in itertools.pairwise(times)) < 1.5
    assert list(values) == sorted(set(values))
    assert values[-1] < 3.01
    assert set(totals) == {8.0}
