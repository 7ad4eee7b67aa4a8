"""What a session costs an agent: the list of tools and every result, against recorded figures.

Characters of JSON text are counted, pictures apart. A token is about 3 of them: 2.7 to 3.8 for results of the demo
and 4 for the list, by the tokenizer o200k_base. After a deliberate change, put the new figures into `RECORDED`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp_types import CallToolResult, ImageContent, ListToolsResult

from atw_mcp import client
from atw_mcp.calls.app import App
from atw_mcp.calls.results import ROOM
from atw_mcp.demo.truth import FOLDER
from atw_mcp.replies import Reply
from atw_mcp.script import read_script, run_script
from atw_mcp.server import build_server
from tests.atw_mcp.two_discs import case_with, two_discs

RECORDED = {"list": 19_500, "probing": 10_440, "demo": 27_440}  # characters
GROWTH = 1.1


def size(result: CallToolResult) -> int:
    """Characters of a result that an agent reads: its blocks but pictures; the structured copy is not read twice."""
    read = [block for block in result.content if not isinstance(block, ImageContent)]
    return sum(len(block.model_dump_json(by_alias=True, exclude_none=True)) for block in read)


async def list_size(session: Client) -> int:
    tools = (await session.list_tools()).tools
    return len(ListToolsResult(tools=tools).model_dump_json(by_alias=True, exclude_none=True))


def test_the_list_and_a_probing_session_have_not_grown(tmp_path: Path) -> None:
    case_with(App(tmp_path / "atw.db"), two_discs(), committed=True)

    async def session() -> tuple[int, list[int]]:
        async with Client(build_server(tmp_path / "atw.db")) as agent:
            sizes = []

            async def call(tool: str, **arguments: Any) -> dict[str, Any]:
                result = await agent.call_tool(tool, arguments)
                assert not result.is_error, result.content
                sizes.append(size(result))
                body: dict[str, Any] = result.structured_content or {}
                return body

            first = (await call("Rollout", case="discs"))["data"]["rollout"]
            edits = [{"action": "remove", "object": "target"}]
            other = await call("Rollout", case="discs", edits=edits)
            await call("ReadTimeline", rollout=first)
            await call("ReadEvents", rollout=first)
            await call("ReadTrajectory", rollout=first, object="striker")
            meet = {"predicate": "collides", "a": "striker", "b": "target"}
            asked = await call("QueryWorld", rollout=first, predicate=meet)
            await call("CompareWorlds", base=first, edited=other["data"]["rollout"])
            await call("ReadEvidence", case="discs")
            await call("Finish", case="discs", question="do they meet?", answer="yes", evidence=[asked["evidence"]])
            return await list_size(agent), sizes

    listed, sizes = anyio.run(session)
    assert max(sizes) <= 1.1 * ROOM
    assert sum(sizes) <= GROWTH * RECORDED["probing"], sizes
    assert listed <= GROWTH * RECORDED["list"]


@pytest.mark.benchmark
def test_the_demo_has_not_grown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, server_here: None) -> None:
    """The whole demo, video to answer."""
    del server_here
    sizes: dict[str, int] = {}
    read = client.reply_of

    def counted(tool: str, result: CallToolResult) -> Reply:
        sizes[f"{len(sizes)} {tool}"] = size(result)
        return read(tool, result)

    monkeypatch.setattr(client, "reply_of", counted)

    async def session() -> None:
        async with client.connected(build_server(tmp_path / "atw.db"), Silent()) as agent:
            variables = {"folder": str(FOLDER), "name": "demo"}
            async for _ in run_script(read_script(FOLDER / "collision.atw"), agent, variables, lambda *_: None):
                pass

    anyio.run(session)
    assert max(sizes.values()) <= 1.1 * ROOM, sizes
    assert sum(sizes.values()) <= GROWTH * RECORDED["demo"], sizes


class Silent:
    """Shows no progress."""

    def show(self, done: float, total: float | None, message: str) -> None:
        """Show nothing."""

    def clear(self) -> None:
        """Nothing was shown."""
