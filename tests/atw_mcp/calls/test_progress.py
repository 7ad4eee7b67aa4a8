"""Progress of long work: the curve of its error in the store, and the same words over MCP, with the time left."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import anyio
import pytest

from atw_mcp.calls.app import App
from atw_mcp.calls.error_curve import ErrorCurve
from atw_mcp.calls.following import follow
from atw_mcp.calls.jobs import LongWork, Progress, time_left
from atw_mcp.calls.results import Answer
from evidence_store import EvidenceStore


def test_errors_and_time_left_reach_other_processes_and_the_caller_while_work_runs(tmp_path: Path) -> None:
    app = App(tmp_path / "atw.db")
    app.store.cases.add("c", content="x", kind="data", path="/x", facts={})
    seen = threading.Event()

    def work(progress: Progress) -> Answer:
        progress.began -= 10.0  # as if it had run for so long
        progress.curve = ErrorCurve("generation", "m")
        progress.curve.add(0.0031, 0.0028)
        progress.curve.add(0.0029, 0.0028)
        progress.report(0.5, 1.0, "generation 2 of 4, error 2.9 mm, best 2.8 mm")
        assert seen.wait(10.0)
        return Answer("done", {}, case="c")

    job = app.jobs.start("FitWorld", {}, LongWork("key", work, Answer("fitting", {}, case="c"), 10.0))
    reader = EvidenceStore.to_read(app.store.path)  # as another process sees it
    heard: list[str] = []

    async def hear(_done: float, _total: float | None, message: str) -> None:
        heard.append(message)

    async def session() -> None:
        async with anyio.create_task_group() as group:
            group.start_soon(follow, app, job, hear)
            with anyio.fail_after(10):
                while (kept := reader.jobs.get(job.evidence)) is None or kept.curve is None:
                    await anyio.sleep(0.05)
            assert kept.curve == {
                "step": "generation",
                "unit": "m",
                "steps": [1, 2],
                "current": [0.0031, 0.0029],
                "best": [0.0028, 0.0028],
            }
            assert kept.message.startswith("generation 2 of 4, error 2.9 mm, best 2.8 mm, about 1")
            seen.set()

    anyio.run(session)
    assert any("best 2.8 mm, about 1" in message and message.endswith("s left") for message in heard)
    assert app.jobs.wait_for(job.evidence, 5.0).status == "completed"
    reader.close()
    app.close()


@pytest.mark.parametrize(
    ("done", "total", "seconds", "said"),
    [
        (1.0, 4.0, 10.0, ", about 30 s left"),
        (1.0, 4.0, 1.0, ""),  # too early to say
        (0.001, 1.0, 60.0, ""),
        (4.0, 4.0, 60.0, ""),
        (1.0, None, 60.0, ""),
    ],
)
def test_time_left_is_said_where_it_can_be_predicted(
    done: float, total: float | None, seconds: float, said: str
) -> None:
    assert time_left(done, total, seconds) == said
    assert Progress(done, total, "x", began=time.monotonic() - seconds).in_words() == "x" + said
