"""Short forms of tools in the list: small, faithful to the full declarations, and enough for the common calls."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import anyio
import jsonschema
import pytest
from mcp import Client
from mcp_types import Implementation, ListToolsResult, Tool

from atw_mcp.calls.brief import brief_output
from atw_mcp.calls.toolsets import CALL, Selection
from atw_mcp.server import build_server
from tests.atw_mcp.clips import write_tracks
from tests.atw_mcp.connections import Mode
from tests.atw_mcp.session import Session
from tests.atw_mcp.tools.contract_snapshots import full_contracts

LARGEST_LISTS = {None: 20_000, "all": 41_200}  # bytes of tools/list: some 5,000 tokens, and 10,000
FULL = full_contracts()


@pytest.fixture(scope="module")
def listed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Tool]:
    """Every tool as a client lists it."""
    return tools_of(tmp_path_factory.mktemp("list") / "atw.db", "all")


def tools_of(store: Path, toolsets: str | None) -> dict[str, Tool]:
    async def tools() -> list[Tool]:
        async with Client(build_server(store, selection=Selection.of(toolsets, False))) as client:
            return (await client.list_tools()).tools

    return {tool.name: tool for tool in anyio.run(tools)}


def accepts(short: dict[str, Any], full: dict[str, Any]) -> bool:
    """Whether a schema without `properties` accepts whatever the full one accepts, keyword by keyword."""
    if "anyOf" in full or "oneOf" in full:
        return all(accepts(short, choice) for choice in full.get("anyOf", full.get("oneOf")))
    if "anyOf" in short:
        return any(accepts(choice, full) for choice in short["anyOf"])
    known = {"type", "enum", "const", "items", "default", "description"}
    return (
        set(short) <= known
        and ("type" not in short or short["type"] == full.get("type"))
        and ("enum" not in short or set(short["enum"]) >= set(full["enum"]))
        and ("const" not in short or short["const"] == full["const"])
        and ("items" not in short or accepts(short["items"], full["items"]))
    )


@pytest.mark.parametrize("toolsets", LARGEST_LISTS)
def test_the_list_is_small_on_the_wire(tmp_path: Path, toolsets: str | None) -> None:
    tools = list(tools_of(tmp_path / "atw.db", toolsets).values())
    sent = ListToolsResult(tools=tools).model_dump_json(by_alias=True, exclude_none=True)
    assert len(sent.encode()) <= LARGEST_LISTS[toolsets]


def test_every_argument_is_listed_and_none_is_refused_that_the_full_schema_accepts(listed: dict[str, Tool]) -> None:
    assert set(listed) == set(FULL) - {CALL}
    for name, tool in listed.items():
        jsonschema.Draft202012Validator.check_schema(tool.input_schema)
        full = FULL[name]["inputSchema"]
        assert list(tool.input_schema["properties"]) == list(full["properties"])
        assert set(tool.input_schema) == {"type", "properties", "required"} & {*full, "type"}
        assert tool.input_schema.get("required") == full.get("required")
        for argument, short in tool.input_schema["properties"].items():
            assert short["description"], f"{name}.{argument}"
            assert "\n" not in short["description"]
            assert accepts(short, full["properties"][argument]), f"{name}.{argument}"
            assert short.get("default") == full["properties"][argument].get("default")


def test_the_short_form_of_a_result_names_the_fields_of_its_data(listed: dict[str, Tool]) -> None:
    for name, tool in listed.items():
        assert (tool.output_schema is None) == ("outputSchema" not in FULL[name])
        if tool.output_schema is not None:
            jsonschema.Draft202012Validator.check_schema(tool.output_schema)
    assert set(listed["CommitWorld"].output_schema["properties"]["data"]["properties"]) >= {"world", "warnings"}


def test_of_a_union_of_results_every_field_is_listed_once_and_none_is_refused() -> None:
    one = {"type": "object", "properties": {"a": {"type": "string"}, "b": {"type": "number"}}}
    other = {"type": "object", "properties": {"b": {"type": "string"}, "c": {"anyOf": [{"type": "null"}, one]}}}
    unfinished = {"type": "object", "properties": {"progress": {"type": "object"}}}
    short = brief_output({"type": "object", "properties": {"data": {"anyOf": [one, other, unfinished]}}})
    fields = short["properties"]["data"]["properties"]
    assert fields == {"a": {"type": "string"}, "b": {}, "c": {"description": "null|object"}}
    for data in ({"a": "x", "b": 1}, {"b": "x", "c": None}, {"progress": {}}):
        jsonschema.validate({"data": data, "summary": ""}, short)


def test_common_calls_are_written_from_the_list_alone(tmp_path: Path, listed: dict[str, Tool]) -> None:
    session = Session(tmp_path / "atw.db")

    def call(tool: str, **arguments: Any) -> dict[str, Any]:
        jsonschema.validate(arguments, listed[tool].input_schema)
        body = session(tool, **arguments)
        while body["status"] == "running":  # kernels are compiled on a busy machine
            body = session("ReadEvidence", evidence=body["evidence"], wait_seconds=30)
        return body

    case = call("OpenCase", data=str(write_tracks(tmp_path / "slide.csv")), name="balls")["case"]
    ball = {"shape": {"kind": "sphere", "radius": 0.1}}
    built = call(
        "BuildWorld",
        case=case,
        only=[],
        seconds_per_frame=0.02,
        floor=0,
        objects=[
            {"name": "red", **ball, "position": [0, 0, 0.1], "velocity": [1, 0, 0], "friction": 0},
            {"name": "blue", **ball, "position": [0.5, 0, 0.1], "mass": 2, "friction": 0},
        ],
    )
    call("CommitWorld", case=case, world=built["data"]["world"])
    as_it_was = call("Rollout", case=case, horizon_seconds=1)
    edits = [{"action": "set_velocity", "object": "red", "velocity": [-1, 0, 0]}]
    away = call("Rollout", case=case, horizon_frames=50, edits=edits)
    alone = call("Rollout", case=case, horizon_seconds=1, edits=[{"action": "remove", "object": "blue"}])
    assert alone["objects"] == ["red"]
    meet = {"predicate": "collides", "a": "red", "b": "blue"}
    answers = [call("QueryWorld", rollout=made["data"]["rollout"], predicate=meet) for made in (as_it_was, away)]
    assert [answer["data"]["verdict"] for answer in answers] == ["true", "false"]
    gone = call("QueryWorld", rollout=away["data"]["rollout"], aggregation="first",
                predicate={"predicate": "moved_by_more_than", "object": "red", "distance": 0.5})  # fmt: skip
    assert gone["data"]["verdict"] != "unknown"
    rows = call("ReadTrajectory", rollout=alone["data"]["rollout"], object="red", fields=["time", "x"], limit=5)
    assert rows["data"]["rows"][-1][1] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_people_see_titles_and_an_icon(tmp_path: Path, mode: Mode) -> None:
    async def seen() -> tuple[list[Tool], Implementation]:
        async with Client(build_server(tmp_path / "atw.db"), mode=mode) as client:
            return (await client.list_tools()).tools, client.server_info

    tools, server = anyio.run(seen)
    assert all(tool.title for tool in tools)
    assert server.icons
    picture = base64.b64decode(server.icons[0].src.removeprefix("data:image/svg+xml;base64,"))
    assert ElementTree.fromstring(picture).tag.endswith("svg")


def test_reading_evidence_only_reads_and_cancelling_does_not() -> None:
    hints = {name: FULL[name]["annotations"]["readOnlyHint"] for name in ("ReadEvidence", "CancelWork")}
    assert hints == {"ReadEvidence": True, "CancelWork": False}
