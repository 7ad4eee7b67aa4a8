"""Over HTTP clients have cases of their own, unless they name a store that they share."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import httpx2
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared.exceptions import MCPError

from atw_mcp import server
from atw_mcp.transports.limits import HTTP_LIMITS
from atw_mcp.transports.tokens import Tokens
from evidence_store import EvidenceStore
from tests.atw_mcp import stdio_process
from tests.atw_mcp.transports.serving import initialize, served

ANNA, BEN = "a" * 32, "b" * 32
MODES: tuple[Any, ...] = ("auto", "legacy")
"""With "auto" the client speaks the stateless era where the server does."""


@pytest.fixture
def data(tmp_path: Path) -> str:
    path = tmp_path / "drop.csv"
    path.write_text("t,x\n0,1\n1,2\n")
    return str(path)


async def cases(client: Client) -> list[str]:
    result = await client.call_tool("OpenCase", {})
    assert not result.is_error, result.content[0].text
    return [case["case"] for case in json.loads(result.content[0].text)["data"]["cases"]]


async def opened(client: Client, data: str, name: str) -> None:
    result = await client.call_tool("OpenCase", {"data": data, "name": name})
    assert not result.is_error, result.content[0].text


def connect(url: str, mode: Any, token: str = "") -> Any:
    @asynccontextmanager
    async def connected() -> AsyncIterator[Client]:
        headers = {"authorization": f"Bearer {token}"} if token else {}
        async with (
            httpx2.AsyncClient(headers=headers, timeout=30) as http,
            Client(streamable_http_client(url, http_client=http), mode=mode) as client,
        ):
            yield client

    return connected()


@pytest.mark.parametrize("mode", MODES)
def test_sessions_without_a_token_are_separate_and_named_stores_shared(tmp_path: Path, data: str, mode: Any) -> None:
    async def session(url: str) -> None:
        async with AsyncExitStack() as stack:
            first, second = [await stack.enter_async_context(connect(url, mode)) for _ in range(2)]
            assert first.protocol_version == second.protocol_version == "2025-11-25"  # sessions, whatever was asked
            await opened(first, data, "mine")
            assert await cases(first) == ["mine"]
            assert await cases(second) == []
            assert (await first.read_resource("atw://view/mine")).contents
            with pytest.raises(MCPError, match="no case 'mine'"):
                await second.read_resource("atw://view/mine")
            third, fourth = [await stack.enter_async_context(connect(f"{url}/lab", mode)) for _ in range(2)]
            assert third.protocol_version == ("2026-07-28" if mode == "auto" else "2025-11-25")
            await opened(third, data, "ours")
            assert await cases(fourth) == ["ours"]
            assert await cases(first) == ["mine"]
            # The session says under which name its cases are found later.
            name = str(first.instructions).rpartition("/mcp/")[2].split()[0]
            async with connect(f"{url}/{name}", mode) as later:
                assert await cases(later) == ["mine"]
            async with connect(f"{url}/atw", mode) as main:
                await opened(main, data, "main")

    with served(tmp_path / "atw.db") as (url, _):
        anyio.run(session, url)
    assert [case.id for case in EvidenceStore(tmp_path / "atw.db").cases.all()] == ["main"]


@pytest.mark.parametrize("mode", MODES)
def test_each_token_has_its_own_cases_across_connections(tmp_path: Path, data: str, mode: Any) -> None:
    async def session(url: str) -> None:
        async with connect(url, mode, ANNA) as client:
            await opened(client, data, "annas")
        async with connect(url, mode, BEN) as client:
            assert await cases(client) == []
        async with connect(url, mode, ANNA) as client:
            assert client.protocol_version == ("2026-07-28" if mode == "auto" else "2025-11-25")
            assert await cases(client) == ["annas"]
        async with connect(f"{url}/lab", mode, ANNA) as client:
            await opened(client, data, "ours")
        async with connect(f"{url}/lab", mode, BEN) as client:
            assert await cases(client) == ["ours"]

    with served(tmp_path / "atw.db", tokens=Tokens({ANNA: "anna", BEN: "ben"})) as (url, _):
        anyio.run(session, url)


def test_a_server_that_ends_records_the_work_it_stops_and_closes_every_store(
    tmp_path: Path, data: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "GROUPS", (*server.GROUPS, stdio_process.SLOW))

    async def session(url: str) -> None:
        async with connect(url, "legacy"), connect(f"{url}/lab", "legacy") as client:
            await opened(client, data, "ours")
            call = {"case": "ours", "seconds": 60, "patience_seconds": 0.1}
            assert not (await client.call_tool("WorkSlowly", call)).is_error

    with served(tmp_path / "atw.db") as (url, _):
        anyio.run(session, url)
    files = sorted(path.name for path in (tmp_path / "atw.stores").rglob("*") if path.is_file())
    assert files == ["lab.db"]  # the session that held no case leaves nothing
    assert EvidenceStore(tmp_path / "atw.stores" / "named" / "lab.db").evidence.get("ev-2").status == "failed"


def test_a_session_is_used_by_the_client_that_opened_it_only(tmp_path: Path) -> None:
    headers = {"accept": "application/json, text/event-stream"}
    anna, ben = ({**headers, "authorization": f"Bearer {token}"} for token in (ANNA, BEN))
    with served(tmp_path / "atw.db", tokens=Tokens({ANNA: "anna", BEN: "ben"})) as (url, _):
        for address in (url, f"{url}/lab"):
            session = httpx2.post(address, json=initialize(), headers=anna).headers["mcp-session-id"]
            ping = {"jsonrpc": "2.0", "id": 2, "method": "ping"}
            asked = {"json": ping, "headers": {**ben, "mcp-session-id": session}}
            assert httpx2.post(address, **asked).status_code == 404
            asked = {"json": ping, "headers": {**anna, "mcp-session-id": session}}
            assert httpx2.post(address, **asked).status_code == 200


def test_requests_that_name_no_store_are_refused_and_make_none(tmp_path: Path) -> None:
    headers = {"accept": "application/json, text/event-stream"}
    ping = {"jsonrpc": "2.0", "id": 2, "method": "ping"}

    def post(url: str, **more: str) -> httpx2.Response:
        return httpx2.post(url, json=ping, headers={**headers, **more})

    with served(tmp_path / "atw.db", limits=replace(HTTP_LIMITS, stores=1)) as (url, _):
        assert post(url).status_code == 400
        assert post(url, **{"mcp-session-id": "0" * 32}).status_code == 404
        stateless = post(url, **{"mcp-protocol-version": "2026-07-28"})
        assert (stateless.status_code, stateless.json()["error"]["code"]) == (400, -32022)
        assert "/mcp/NAME" in stateless.json()["error"]["message"]
        for name in ("..%2Fx", "%2e%2e", "a%00b", "x" * 65, ".hidden"):
            assert post(f"{url}/{name}").status_code == 404
        assert not (tmp_path / "atw.stores").exists()
        assert httpx2.post(url, json=initialize(), headers=headers).status_code == 200
        assert httpx2.post(url, json=initialize(), headers=headers).status_code == 503  # one store is open already
