"""Questions to the person at the client: asked where it offers elicitation, else the refusal stands as it was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.client.context import ClientRequestContext
from mcp_types import CallToolResult, ElicitRequestParams, ElicitResult, TextContent

from atw_mcp.calls.app import App
from evidence_store import EvidenceStore
from tests.atw_mcp.connections import Mode, connection
from tests.atw_mcp.two_discs import case_with, two_discs

MODES: tuple[Mode, ...] = ("auto", "legacy")


REPLIES = [ElicitResult(action="accept", content={"object": name}) for name in ("target", "striker")]


@pytest.fixture
def store(tmp_path: Path) -> Path:
    app = App(tmp_path / "atw.db")
    case_with(app, two_discs(), committed=True)
    app.close()
    return tmp_path / "atw.db"


def called(
    store: Path,
    mode: Mode,
    tool: str,
    arguments: dict[str, Any],
    replies: list[ElicitResult] | None,
    transport: str = "memory",
) -> tuple[CallToolResult, list[str]]:
    """Call a tool as a client whose person gives these replies one after another; None: it offers no elicitation."""
    asked: list[str] = []

    async def reply(_: ClientRequestContext, params: ElicitRequestParams) -> ElicitResult:
        asked.append(params.message)
        assert replies is not None
        return replies[len(asked) - 1]

    async def session(entered: Client) -> CallToolResult:
        async with entered as client:
            return await client.call_tool(tool, arguments)

    with connection(transport, store, mode, elicitation_callback=None if replies is None else reply) as client:
        return anyio.run(session, client), asked


def text(result: CallToolResult) -> str:
    return " ".join(block.text for block in result.content if isinstance(block, TextContent))


@pytest.mark.parametrize("mode", MODES)
def test_a_person_says_which_object_is_meant(store: Path, mode: Mode) -> None:
    edits = [{"action": "remove", "object": "the puck"}]
    result, asked = called(store, mode, "Rollout", {"case": "discs", "edits": edits}, REPLIES)
    assert not result.is_error, text(result)
    assert asked == ["Which object of case 'discs' is meant by 'the puck'?"]
    opened = EvidenceStore(store)
    (row,) = opened.evidence.of_case("discs", tool="Rollout")
    assert row.arguments["edits"] == [{"action": "remove", "object": "target"}], "what was meant is what is recorded"
    opened.close()


@pytest.mark.parametrize(("mode", "transport"), [("auto", "http"), ("legacy", "stdio")])  # in memory: below
def test_two_names_are_asked_one_after_the_other_over_every_transport(store: Path, mode: Mode, transport: str) -> None:
    plain = called(store, mode, "Rollout", {"case": "discs"}, None)[0].structured_content
    assert plain is not None
    base = plain["data"]["rollout"]
    meet = {"predicate": "collides", "a": "the puck", "b": "that other"}
    result, asked = called(store, mode, "QueryWorld", {"rollout": base, "predicate": meet}, REPLIES, transport)
    assert not result.is_error, text(result)
    assert len(asked) == 2


@pytest.mark.parametrize("replies", [None, [ElicitResult(action="decline")], [ElicitResult(action="cancel")]])
def test_without_an_answer_the_refusal_stands(store: Path, replies: list[ElicitResult] | None) -> None:
    edits = [{"action": "remove", "object": "the puck"}]
    result, asked = called(store, "auto", "Rollout", {"case": "discs", "edits": edits}, replies)
    assert result.is_error
    assert "no object 'the puck'" in text(result)
    assert "['striker', 'target']" in text(result)
    assert len(asked) == (replies is not None)


@pytest.mark.parametrize(
    ("filled", "method"),
    [
        ({"length": "0.5, 100 200, 300 200"}, "known length"),
        ({"points": "0 0 80 350; 1 0 330 360; 1 1 270 180; 0 1 150 170"}, "homography"),
        ({"length": "half a metre"}, None),
    ],
)
def test_a_person_gives_the_scale(store: Path, filled: dict[str, Any], method: str | None) -> None:
    given = {"case": "discs", "image_size": [400, 400]}
    replies = [ElicitResult(action="accept", content=filled)]
    result, asked = called(store, "auto", "CalibrateCamera", given, replies)
    assert len(asked) == 1
    assert result.is_error == (method is None)
    assert (method or "could not be read as numbers") in text(result)
