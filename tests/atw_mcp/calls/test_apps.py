"""The viewer as an MCP App: who is sent the reference to it, and what it is served as."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import anyio
import pytest
from mcp import Client
from mcp.client.extension import advertise
from mcp.server.apps import APP_MIME_TYPE, EXTENSION_ID
from mcp.shared.exceptions import MCPError
from mcp_types import Tool

from atw_mcp.calls import apps
from atw_mcp.calls.toolsets import Selection
from atw_mcp.server import build_server

SHOWN = {"InspectRollout", "CompareWorlds", "FindDiscrepancy", "AddEffect", "Finish"}
MODES: tuple[Literal["auto", "legacy"], ...] = ("auto", "legacy")


def renders(*types: str) -> list[Any]:
    """The extension as a client offers it."""
    return [advertise(EXTENSION_ID, {"mimeTypes": list(types)})]


def listed(store: Path, mode: Any, extensions: Sequence[Any], selection: Selection | None = None) -> list[Tool]:
    async def tools() -> list[Tool]:
        server = build_server(store, selection=selection or Selection.of("all", False))
        async with Client(server, mode=mode, extensions=extensions) as client:
            return (await client.list_tools()).tools

    return anyio.run(tools)


@pytest.mark.parametrize("mode", MODES)
def test_tools_refer_to_the_viewer_where_the_client_renders_apps(tmp_path: Path, mode: Any) -> None:
    tools = listed(tmp_path / "atw.db", mode, renders(APP_MIME_TYPE))
    referring = {tool.name: tool.meta for tool in tools if tool.meta}
    assert referring == {name: {"ui": {"resourceUri": "ui://atw/viewer"}} for name in SHOWN}


@pytest.mark.parametrize("mode", MODES)
def test_other_clients_get_the_same_list_without_references(tmp_path: Path, mode: Any) -> None:
    plain = listed(tmp_path / "atw.db", mode, [])
    assert not [tool.name for tool in plain if tool.meta]
    assert listed(tmp_path / "atw.db", mode, renders("text/other")) == plain
    apps_too = listed(tmp_path / "atw.db", mode, renders(APP_MIME_TYPE))
    assert [tool.model_copy(update={"meta": None}) for tool in apps_too] == plain


def test_the_tools_chosen_keep_their_references(tmp_path: Path) -> None:
    chosen = listed(tmp_path / "atw.db", "auto", renders(APP_MIME_TYPE), Selection.of("probing", True))
    assert {tool.name for tool in chosen if tool.meta} == {"InspectRollout", "CompareWorlds", "FindDiscrepancy"}


@pytest.mark.parametrize("mode", MODES)
def test_the_page_needs_no_other_origin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: Literal["auto", "legacy"]
) -> None:
    page = tmp_path / "viewer.html"
    monkeypatch.setattr(apps, "FILE", page)

    async def look() -> None:
        async with Client(build_server(tmp_path / "atw.db"), mode=mode) as client:
            if mode == "auto":  # revisions of the handshake have no extensions of servers
                assert client.server_capabilities is not None
                assert EXTENSION_ID in (client.server_capabilities.extensions or {})
            known = {str(r.uri): r for r in (await client.list_resources()).resources}
            with pytest.raises(MCPError, match=r"no viewer\.html.*node build\.mjs"):
                await client.read_resource("ui://atw/viewer")
            page.write_text("<!doctype html><p>µ", encoding="utf-8")
            content: Any = (await client.read_resource("ui://atw/viewer")).contents[0]
            assert content.text == "<!doctype html><p>µ"
            for shown in (known["ui://atw/viewer"], content):
                assert shown.mime_type == "text/html;profile=mcp-app"
                assert not any(shown.meta["ui"]["csp"].values())

    anyio.run(look)
