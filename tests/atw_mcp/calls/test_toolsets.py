"""Servers that serve some of the tools."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.server import MCPServer

from atw_mcp.calls.toolsets import TOOLSETS, Selection
from atw_mcp.cli import main
from atw_mcp.server import all_tools, build_server

NAMES = {tool.name for tool in all_tools()}
EVERYWHERE = {"DescribeTool", "ReadEvidence"}


def listed(server: MCPServer[Any]) -> tuple[set[str], str]:
    """Names of the tools served, and the instructions."""

    async def names() -> tuple[set[str], str]:
        async with Client(server) as client:
            return {tool.name for tool in (await client.list_tools()).tools}, client.instructions or ""

    return anyio.run(names)


@pytest.mark.parametrize(
    ("selection", "has", "lacks"),
    [
        (Selection(), NAMES, set()),
        (
            Selection.of("probing", False),
            {"OpenCase", "Rollout", "InspectWorld", "Finish"},
            {"BuildWorld", "AddEffect"},
        ),
        (Selection.of("gap, modeling", False), {"BuildWorld", "AddEffect"}, {"Rollout", "QueryWorld"}),
        (Selection.of(None, True), {"InspectFrames", "QueryWorld"}, {"OpenCase", "BuildWorld", "Rollout", "Finish"}),
        (Selection.of("modeling", True), {"InspectFrames"}, {"QueryWorld", "BuildWorld"}),
    ],
)
def test_the_tools_chosen_are_served(tmp_path: Path, selection: Selection, has: set[str], lacks: set[str]) -> None:
    names, instructions = listed(build_server(tmp_path / "atw.db", selection=selection))
    assert has | EVERYWHERE <= names
    assert not lacks & names
    assert set(re.findall(r"\w+", instructions)) & NAMES <= names


def test_what_is_not_served_is_refused_with_how_to_get_it(tmp_path: Path) -> None:
    server = build_server(tmp_path / "atw.db", selection=Selection.of("probing", False))
    data = tmp_path / "drop.csv"
    data.write_text("t,x\n0,1\n1,2\n")

    async def refusals() -> list[str]:
        async with Client(server) as client:
            await client.call_tool("OpenCase", {"data": str(data), "name": "drop"})
            calls = [
                ("BuildWorld", {"case": "drop"}),
                ("DescribeTool", {"tool": "AddEffect"}),
                ("Rollout", {"case": "drop"}),
                ("OpenCases", {}),
            ]
            results = [await client.call_tool(tool, arguments) for tool, arguments in calls]
            assert all(result.is_error for result in results)
            listed = await client.call_tool("DescribeTool", {})
            described = json.loads(listed.content[0].text)["data"]["tools"]
            assert "BuildWorld" not in {row["tool"] for row in described}
            return [result.content[0].text for result in results]

    built, described, early, unknown = anyio.run(refusals)
    assert built == "BuildWorld is not served here: start the server with --toolsets probing,modeling"
    assert "AddEffect is not served here: start the server with --toolsets probing,gap" in described
    assert "BuildWorld is not served here" in early  # the stage's refusal names it as the next step
    assert "did you mean OpenCase" in unknown
    assert "BuildWorld" not in unknown


def test_an_unknown_toolset_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["serve", "--store", str(tmp_path / "atw.db"), "--toolsets", "probing,modelling"]) == 1
    assert f"no toolset 'modelling'; toolsets: {', '.join(TOOLSETS)}" in capsys.readouterr().err


def test_hints_say_which_calls_may_be_repeated() -> None:
    hints = {tool.name: tool.annotations for tool in all_tools()}
    assert hints["CommitWorld"].idempotent_hint
    assert not hints["Finish"].idempotent_hint  # every call records an answer
