"""Errors have a bounded size whatever was sent, and say how much of it they leave out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.shared.exceptions import MCPError

from atw_mcp.calls.app import App
from atw_mcp.calls.error_text import LIMITS, shortened
from atw_mcp.server import build_server
from tests.atw_mcp.session import Session
from tests.atw_mcp.two_discs import case_with, two_discs


def test_a_short_text_stays_and_a_long_one_keeps_its_beginning_its_end_and_a_count() -> None:
    assert shortened("no case 'x'") == "no case 'x'"
    cut = shortened("no case: " + "very long " * 3000 + "Next: OpenCase()")
    assert len(cut) == LIMITS.text
    assert cut.startswith("no case: very long")
    assert cut.endswith("Next: OpenCase()")
    assert "characters left out" in cut


def test_long_values_and_lists_are_cut_before_the_sentence_around_them() -> None:
    names = [f"object-{number}" for number in range(100_000)]
    cut = shortened(f"no object {'x y' * 1_000_000!r}; objects: {names}. UpdateBindings ties other names to them")
    assert len(cut) <= LIMITS.text
    assert cut.startswith("no object 'x yx y")
    assert "'object-0', 'object-1'" in cut
    assert "and 99,960 more]. UpdateBindings ties other names to them" in cut


@pytest.fixture
def session(tmp_path: Path) -> Session:
    opened = Session(tmp_path / "atw.db")
    case_with(App(opened.store), two_discs(), committed=False, name="draft")
    case_with(App(opened.store), two_discs(), committed=True)
    return opened


LONG = "long/" * 200_000
HOSTILE: list[tuple[str, dict[str, Any], str]] = [
    ("BuildWorld", {"case": "draft", "objects": [{"name": 5}] * 100_000}, "not 100000"),
    ("BuildWorld", {"case": "draft", "world": {"objects": [{"x": 1}] * 5_000}}, "and 19,992 more"),
    ("BuildWorld", {"case": "draft", "world": {LONG: 1}}, "is not known"),
    ("OpenCase", {"video": LONG}, "not in a folder whose files may be read"),
    ("OpenCase", {LONG: 1}, "has no argument"),
    ("Rollout", {"case": LONG}, "cases:"),
    ("Rollout", {"case": "discs", "edits": [{"action": LONG}]}, "there are remove"),
    ("Rollout", {"case": "discs", "edits": [{"action": "remove", **{f"k{n}": 1 for n in range(500)}}]}, "and 492 more"),
    ("Rollout", {"case": "discs", "edits": [{"action": ["remove"]}]}, "no action ['remove']"),
    ("Rollout", {"case": "discs", "edits": [{"action": {"a": 1}}]}, "there are remove"),
    ("Rollout", {"case": "discs", "edits": [{"action": "remove", "object": ["striker"]}]}, "valid string"),
]  # fmt: skip


@pytest.mark.parametrize(("tool", "arguments", "expected"), HOSTILE)
def test_a_hostile_call_gets_a_short_refusal(
    session: Session, tool: str, arguments: dict[str, Any], expected: str
) -> None:
    text = session.refused(tool, **arguments)
    assert len(text) <= LIMITS.text
    assert "unexpectedly" not in text
    assert expected in text


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_errors_of_the_protocol_are_short_too(tmp_path: Path, mode: Any) -> None:
    async def session() -> None:
        async with Client(build_server(tmp_path / "atw.db"), mode=mode) as client:
            unknown = await client.call_tool(LONG, {})
            assert unknown.is_error
            assert len(unknown.content[0].text) <= LIMITS.text
            for request in (
                lambda: client.get_prompt(LONG, {}),
                lambda: client.get_prompt("world-probing", {LONG: "x"}),
                lambda: client.read_resource("atw://evidence/" + LONG),
                lambda: client.read_resource("atw://" + LONG),
            ):
                with pytest.raises(MCPError) as refused:
                    await request()
                assert len(refused.value.error.model_dump_json()) <= 1.5 * LIMITS.text

    anyio.run(session)
