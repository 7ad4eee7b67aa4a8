"""Random calls of every tool end in a result or a clear error; the server lives on and the store stays whole.

All 10,000 of them: ATW_MCP_RANDOM_CALLS=10000 python -m pytest tests/outside/test_fuzz.py
"""

from __future__ import annotations

import os
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import anyio
import anyio.from_thread
import psutil
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from mcp import Client
from mcp_types import CallToolResult

from atw_mcp.calls.app import App
from atw_mcp.server import all_tools, build_server
from evidence_store import EvidenceStore
from tests.atw_mcp.clips import write_clip, write_tracks
from tests.atw_mcp.two_discs import case_with, two_discs
from tests.outside.random_calls import calls

Call = Callable[[str, dict[str, Any]], Any]
COUNT = int(os.environ.get("ATW_MCP_RANDOM_CALLS", "15"))
GROWTH = 600e6  # [B] that random calls may add to the process: the engine and its kernels take most of it
LONGEST = 60.0  # [s] a call may take before the server counts as hung
MOST_TEXT = 8_000  # characters of an error, about 3,000 tokens
SCHEMAS = {tool.name: tool.parameters for tool in all_tools()}


def valid_calls(app: App, folder: Path, call: Call) -> list[tuple[str, dict[str, Any]]]:
    """Make two cases, one committed and one being modelled, and return calls of every tool about them."""
    case_with(app, two_discs(), committed=True)
    tracks, clip = str(write_tracks(folder / "slide.csv")), str(write_clip(folder / "clip.mp4"))
    box = {"kind": "box", "half_extents": [0.05, 0.05, 0.05]}
    known = {"case": "discs", "horizon_seconds": 0.1}
    removed = [{"action": "remove", "object": "target"}]
    base, edited = (call("Rollout", {**known, "edits": edits}).structured_content for edits in ([], removed))
    rollout, other = base["source"]["rollout"], edited["source"]["rollout"]
    soon = {"patience_seconds": 2.0}
    rope = {"part": "rope", "name": "line", "points": [[0, 0, 1], [1, 0, 1]], "segments": 8}
    return [
        ("OpenCase", {}),
        ("OpenCase", {"video": clip, "name": "clip", "questions": ["does it fall?"]}),
        ("OpenCase", {"data": tracks, "name": "slide"}),
        ("ImportObservation", {"case": "slide", "kind": "tracks", "path": tracks}),
        ("ObserveObjects", {"case": "clip", "max_objects": 3, **soon}),
        ("CalibrateCamera", {"case": "clip", "homography": [[0.01, 0, 0], [0, 0.01, 0.001], [0, 0.001, 1]]}),
        ("RunModel", {}),
        ("BuildWorld", {"case": "slide", "default_shape": box}),
        ("BuildWorld", {"case": "slide", "default_shape": box, "parts": [rope]}),
        ("FitWorld", {"case": "slide", "generations": 2, "population": 8, **soon}),
        ("ModelVideo", {"case": "clip", **soon}),
        ("FindDiscrepancy", {"case": "slide", **soon}),
        ("ProposeEffects", {"case": "slide", "effects": ["linear_drag"], "max_effects": 1, **soon}),
        ("AddEffect", {"case": "slide", "proposal": "ev-1"}),
        ("CommitWorld", {"case": "discs", "world": two_discs().id}),
        ("InspectWorld", {"case": "discs", "fields": ["parameters"]}),
        ("ReadProperty", {"case": "discs", "property": "friction"}),
        ("InspectFrames", {"case": "clip", "frames": [0, 3]}),
        ("InspectObservedMotion", {"case": "slide", "object": "puck"}),
        ("InspectRollout", {"case": "discs"}),
        ("Rollout", known),
        ("Rollout", {**known, "edits": removed}),
        ("Rollout", {**known, "edits": [{"action": "set_velocity", "object": "striker", "velocity": [2, 0, 0]}]}),
        ("Ask", {"case": "discs", "questions": [{"ask": "where", "object": "target", "at": 0.1}]}),
        ("ReadEvents", {"rollout": rollout}),
        ("ReadTrajectory", {"rollout": rollout, "object": "striker", "fields": ["time", "x"], "limit": 5}),
        ("ReadTimeline", {"rollout": rollout}),
        ("QueryWorld", {"rollout": rollout, "predicate": {"predicate": "collides", "a": "striker", "b": "target"}}),
        ("CompareWorlds", {"base": rollout, "edited": other}),
        ("DescribeTool", {"tool": "BuildWorld", "argument": "parts.rope"}),
        ("CallTool", {"tool": "InspectWorld", "arguments": {"case": "discs"}}),
        ("ReadEvidence", {"evidence": "ev-1", "path": "objects", "limit": 3}),
        ("ReadEvidence", {"case": "discs"}),
        ("CancelWork", {"evidence": "ev-1"}),
        (
            "UpdateBindings",
            {"case": "discs", "corrections": [{"name": "it", "object": "striker"}], "reason": "it moves"},
        ),
        ("Finish", {"case": "discs", "question": "does it?", "answer": "yes", "confidence": 0.9, "evidence": ["ev-1"]}),
    ]


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, list[tuple[str, dict[str, Any]]], Path]]:
    folder = tmp_path_factory.mktemp("fuzz")
    store = folder / "atw.db"
    server = build_server(store)
    with (
        anyio.from_thread.start_blocking_portal() as portal,
        portal.wrap_async_context_manager(Client(server)) as client,
    ):

        def call(tool: str, arguments: dict[str, Any]) -> CallToolResult:
            async def bounded() -> CallToolResult:
                with anyio.fail_after(LONGEST):
                    return await client.call_tool(tool, arguments)

            return portal.call(bounded)

        yield call, valid_calls(App(store), folder, call), store


def test_every_valid_call_gets_past_the_arguments(fuzzed: Any) -> None:
    call, valid, _ = fuzzed
    assert {tool for tool, _ in valid} == set(SCHEMAS)
    wrong = []
    for tool, arguments in valid:
        result = call(tool, arguments)
        said = result.content[0].text
        if result.is_error and ("has no argument" in said or said.startswith(f"{tool}: ")):
            wrong.append((tool, said[:300]))
    assert not wrong


def test_random_calls_do_no_harm(fuzzed: Any, capsys: pytest.CaptureFixture[str]) -> None:
    call, valid, store = fuzzed
    memory = psutil.Process().memory_info().rss
    ended: Counter[tuple[str, bool]] = Counter()

    @settings(
        max_examples=COUNT, database=None, derandomize=True, deadline=None, phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(drawn=calls(SCHEMAS, valid))
    def one(drawn: tuple[str, dict[str, Any]]) -> None:
        tool, arguments = drawn
        result = call(tool, arguments)
        said = result.content[0].text
        ended[(tool, bool(result.is_error))] += 1
        if result.is_error:
            assert 0 < len(said) <= MOST_TEXT, (tool, len(said))
            assert "Traceback" not in said, (tool, arguments, said)
            assert "failed unexpectedly" not in said, (tool, arguments, said)

    one()
    with capsys.disabled():
        good = sum(count for (_, refused), count in ended.items() if not refused)
        print(
            f"{sum(ended.values())} random calls, {good} with a result, of {len({t for t, _ in ended})} tools", end=" "
        )
    assert psutil.Process().memory_info().rss - memory < GROWTH
    assert not call("OpenCase", {}).is_error
    with sqlite3.connect(store) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        sequence = [row[0] for row in database.execute("SELECT seq FROM evidence")]
    opened = EvidenceStore(store)
    for number in sequence:
        opened.read_evidence(f"ev-{number}")
