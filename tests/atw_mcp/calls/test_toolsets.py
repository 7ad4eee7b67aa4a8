"""Servers that list, or serve, some of the tools."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.server import MCPServer
from mcp_types import CallToolResult, Tool

from atw_mcp.calls.toolsets import CALL, CORE, Selection
from atw_mcp.cli import main
from atw_mcp.server import all_tools, build_server

NAMES = {tool.name for tool in all_tools()}


def listed(server: MCPServer[Any]) -> tuple[dict[str, Tool], str]:
    """The tools listed, by name, and the instructions."""

    async def tools() -> tuple[dict[str, Tool], str]:
        async with Client(server) as client:
            return {tool.name: tool for tool in (await client.list_tools()).tools}, client.instructions or ""

    return anyio.run(tools)


@pytest.mark.parametrize(
    ("selection", "has", "lacks"),
    [
        (Selection(), CORE, NAMES - CORE),
        (Selection.of("all", False), NAMES - {CALL}, {CALL}),
        (Selection.of("core, probing", False), {*CORE, "CompareWorlds", "InspectWorld"}, {"BuildWorld", "FitWorld"}),
        (Selection.of("modeling", False), {*CORE, "BuildWorld", "UpdateBindings"}, {"ReadEvents", "QueryWorld"}),
        (Selection.of("modeling,probing", False), NAMES - {CALL}, {CALL}),
        (Selection.of(None, True), {"InspectFrames", "QueryWorld"}, {"OpenCase", "BuildWorld", "Finish", CALL}),
    ],
)
def test_the_tools_chosen_are_listed(tmp_path: Path, selection: Selection, has: set[str], lacks: set[str]) -> None:
    tools, instructions = listed(build_server(tmp_path / "atw.db", selection=selection))
    names = set(tools)
    assert has <= names
    assert not lacks & names
    if CALL in names:
        assert set(re.findall(r"\w+", tools[CALL].description.partition("Tools: ")[2])) == NAMES - names
    if selection.read_only:
        assert set(re.findall(r"\w+", instructions)) & NAMES <= names


def test_a_tool_that_is_not_listed_is_called_by_one_that_is(tmp_path: Path) -> None:
    """The results are those of the tool itself, recorded under its name; so are its refusals."""
    server = build_server(tmp_path / "atw.db")
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 1], "mass": 1}

    async def session() -> tuple[list[CallToolResult], str]:
        async with Client(server) as client:
            await client.call_tool("OpenCase", {"name": "drop"})
            made = await client.call_tool(
                CALL, {"tool": "BuildWorld", "arguments": {"case": "drop", "objects": [ball]}}
            )
            world = made.structured_content["data"]["world"]
            seen = {"tool": "InspectWorld", "arguments": {"case": "drop", "world": world}}
            wrong = {"tool": "InspectWorld", "arguments": {"case": "drop", "wrold": world}}
            results = [made, *[await client.call_tool(CALL, call) for call in (seen, wrong, {**seen, "tool": CALL})]]
            evidence = await client.call_tool("ReadEvidence", {"case": "drop"})
            return results, evidence.content[0].text

    (made, seen, wrong, itself), evidence = anyio.run(session)
    assert not made.is_error
    assert not seen.is_error
    assert "InspectWorld has no argument 'wrold' (did you mean 'world'?)" in wrong.content[0].text
    assert itself.is_error
    assert '"tool":"BuildWorld"' in evidence
    assert CALL not in evidence


def test_what_is_not_served_is_refused_with_how_to_get_it(tmp_path: Path) -> None:
    server = build_server(tmp_path / "atw.db", selection=Selection.of(None, True))

    async def refusals() -> list[str]:
        async with Client(server) as client:
            calls = [
                ("BuildWorld", {"case": "drop"}),
                ("DescribeTool", {"tool": "AddEffect"}),
                ("InspectFrames", {"case": "drop"}),
                ("ReadEvidences", {}),
            ]
            results = [await client.call_tool(tool, arguments) for tool, arguments in calls]
            assert all(result.is_error for result in results)
            listed = await client.call_tool("DescribeTool", {})
            described = json.loads(listed.content[0].text)["data"]["tools"]
            assert "BuildWorld" not in {row["tool"] for row in described}
            return [result.content[0].text for result in results]

    built, described, early, unknown = anyio.run(refusals)
    assert built == "BuildWorld is not served here: start the server without --read-only"
    assert "AddEffect is not served here: start the server without --read-only" in described
    assert "OpenCase is not served here" in early  # the refusal names it as the next step
    assert "did you mean 'ReadEvidence'" in unknown
    assert "BuildWorld" not in unknown


def test_an_unknown_toolset_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["serve", "--store", str(tmp_path / "atw.db"), "--toolsets", "probing,modelling"]) == 1
    assert "no toolset 'modelling'; toolsets: core, modeling, probing, all" in capsys.readouterr().err


def test_hints_say_which_calls_may_be_repeated() -> None:
    hints = {tool.name: tool.annotations for tool in all_tools()}
    assert hints["CommitWorld"].idempotent_hint
    assert not hints["Finish"].idempotent_hint  # every call records an answer
