"""The essentials, over every transport and in both protocol eras."""

from __future__ import annotations

import json
from pathlib import Path

import anyio
import pytest
from mcp import Client
from mcp.shared.exceptions import MCPError
from mcp_types import PromptReference

from tests.atw_mcp.connections import TRANSPORTS, Mode, connection

EVERY_WAY = [(transport, mode) for transport in TRANSPORTS for mode in ("auto", "legacy")]
DATA = "t,x\n0,1\n1,2\n"


@pytest.fixture
def measurements(tmp_path: Path) -> Path:
    path = tmp_path / "drop.csv"
    path.write_text(DATA)
    return path


@pytest.mark.parametrize(("transport", "mode"), EVERY_WAY)
def test_a_case_is_opened_refused_and_read_again(
    transport: str, mode: Mode, tmp_path: Path, measurements: Path
) -> None:
    async def session(client: Client) -> None:
        async with client:
            names = [tool.name for tool in (await client.list_tools()).tools]
            assert {"OpenCase", "ModelVideo", "CommitWorld", "CallTool", "ReadEvidence", "Finish"} <= set(names)
            opened = await client.call_tool("OpenCase", {"data": str(measurements), "name": "drop"})
            assert not opened.is_error
            body = opened.structured_content
            assert body is not None
            assert (body["evidence"], body["case"], body["status"]) == ("ev-1", "drop", "completed")
            assert json.loads(opened.content[0].text) == body  # the same in both places, for clients that show one

            refused = await client.call_tool("OpenCase", {"data": str(measurements), "nmae": "drop"})
            assert refused.is_error
            assert "did you mean 'name'" in refused.content[0].text

            unknown = await client.call_tool("OpenCases", {})
            assert unknown.is_error
            assert "did you mean 'OpenCase'" in unknown.content[0].text

            again = await client.call_tool("ReadEvidence", {"evidence": "ev-1"})
            assert json.loads(again.content[0].text) == body
            whole = await client.read_resource("atw://evidence/ev-1")
            assert json.loads(whole.contents[0].text)["evidence"] == "ev-1"

            assert "world-probing" in {listed.name for listed in (await client.list_prompts()).prompts}
            given = {"case": "drop", "question": "Does it bounce?"}
            filled = await client.get_prompt("world-probing", given)
            assert "Does it bounce?" in filled.messages[0].content.text
            with pytest.raises(MCPError, match="unknown \\['colour'\\]") as wrong:
                await client.get_prompt("world-probing", {**given, "colour": "red"})
            assert wrong.value.code == -32602

            prompt = PromptReference(name="world-probing")
            found = await client.complete(prompt, {"name": "case", "value": "dr"})
            assert found.completion.values == ["drop"]

    with connection(transport, tmp_path / "atw.db", mode) as client:
        anyio.run(session, client)


@pytest.mark.parametrize(("transport", "mode"), [("stdio", "auto"), ("http", "auto"), ("http", "legacy")])
def test_a_legacy_only_server_serves_clients_that_probe_the_newer_era(
    transport: str, mode: Mode, tmp_path: Path, measurements: Path
) -> None:
    async def session(client: Client) -> None:
        async with client:
            assert client.protocol_version.startswith("2025")
            opened = await client.call_tool("OpenCase", {"data": str(measurements)})
            assert not opened.is_error

    with connection(transport, tmp_path / "atw.db", mode, legacy_only=True) as client:
        anyio.run(session, client)


def test_a_case_of_one_process_is_continued_by_another(tmp_path: Path, measurements: Path) -> None:
    async def call(transport: str, tool: str, **arguments: object) -> str:
        with connection(transport, tmp_path / "atw.db", "auto") as client:
            async with client:
                result = await client.call_tool(tool, arguments)
                assert not result.is_error, result.content[0].text
                return str(result.content[0].text)

    first = anyio.run(lambda: call("stdio", "OpenCase", data=str(measurements), questions=["how high?"]))
    second = anyio.run(lambda: call("memory", "OpenCase", case=json.loads(first)["case"]))
    assert json.loads(second)["data"]["questions"] == ["how high?"]


def test_over_http_a_foreign_host_is_refused(tmp_path: Path) -> None:
    import httpx2

    from atw_mcp.server import build_server
    from tests.atw_mcp.connections import served_over_http

    with served_over_http(build_server(tmp_path / "atw.db")) as url:
        body = {"jsonrpc": "2.0", "id": 1, "method": "ping"}
        headers = {"host": "evil.example", "accept": "application/json, text/event-stream"}
        assert httpx2.post(url, json=body, headers=headers).status_code in (403, 421)
