"""The client: work that outlives its call is waited for, failures carry the tool's own words."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path

import anyio
import pytest
from mcp import Client

from atw_mcp import server
from atw_mcp.client import Session
from atw_mcp.demo.truth import FOLDER
from atw_mcp.replies import ToolFailed
from atw_mcp.server_process import forward_errors
from tests.atw_mcp.stdio_process import SLOW


def test_lines_of_the_server_are_shown(capfd: pytest.CaptureFixture[str]) -> None:
    forward_errors(["something is wrong\n"])
    assert capfd.readouterr().err == "something is wrong\n"


class RecordedProgress:
    """Remembers the progress that was shown, and whether it was cleared last."""

    def __init__(self) -> None:
        self.shown: list[tuple[float, float | None, str]] = []
        self.cleared = False

    def show(self, done: float, total: float | None, message: str) -> None:
        self.shown.append((done, total, message))
        self.cleared = False

    def clear(self) -> None:
        self.cleared = True


Work = Callable[[Session, str], Awaitable[None]]


def with_session(store: Path, work: Work, monkeypatch: pytest.MonkeyPatch) -> RecordedProgress:
    """Run `work` with a session on a server that also has a slow tool; returns the progress that was shown."""
    monkeypatch.setattr(server, "GROUPS", (*server.GROUPS, SLOW))
    progress = RecordedProgress()

    async def run() -> None:
        async with Client(server.build_server(store)) as client:
            session = Session(client, {}, progress)
            opened = await session.call("OpenCase", {"video": str(FOLDER / "collision.mp4")})
            await work(session, opened.body["case"])

    anyio.run(run)
    return progress


def test_work_that_outlives_its_call_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work(session: Session, case: str) -> None:
        reply = await session.call("WorkSlowly", {"case": case, "seconds": 1.5, "patience_seconds": 0.1})
        assert reply.tool == "WorkSlowly"
        assert reply.body["status"] == "completed"
        assert reply.body["data"] == {"steps": 15}

    progress = with_session(tmp_path / "atw.db", work, monkeypatch)
    assert any(total == 15 for _, total, _ in progress.shown)
    assert progress.cleared


def test_work_that_fails_after_its_call_is_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work(session: Session, case: str) -> None:
        arguments = {"case": case, "seconds": 0.5, "patience_seconds": 0.1, "fail": "broken"}
        with pytest.raises(ToolFailed, match="WorkSlowly"):
            await session.call("WorkSlowly", arguments)

    with_session(tmp_path / "atw.db", work, monkeypatch)


def test_refusal_carries_the_tools_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work(session: Session, case: str) -> None:
        with pytest.raises(ToolFailed, match="BuildWorld"):
            await session.call("Rollout", {"case": case})
        frames = await session.call("InspectFrames", {"case": case, "frames": [0, 1]})
        assert [ending for ending, _ in frames.pictures] == ["jpg", "jpg"]

    with_session(tmp_path / "atw.db", work, monkeypatch)
