"""The server over stdio as a process of its own, with one slow tool on top of the real ones."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

from pydantic import Field

from atw_mcp import server
from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.serving import serve_stdio

SLOW = ToolGroup("execution control")


@SLOW.tool("WorkSlowly", title="Work slowly")
def work_slowly(
    app: App,
    case: str,
    seconds: Annotated[float, Field(ge=0)],
    patience_seconds: Annotated[float, Field(ge=0)] = 30.0,
    fail: str | None = None,
    opening_seconds: Annotated[float, Field(ge=0)] = 0.0,
) -> LongWork:
    """Count to `seconds`, ten steps a second, after `opening_seconds` of looking at what is asked for."""
    app.case(case)
    time.sleep(opening_seconds)

    def work(progress: Progress) -> Answer:
        steps = round(seconds * 10)
        for step in range(steps):
            progress.report(step, steps, f"step {step}")
            time.sleep(0.1)
        if fail is not None:
            raise RuntimeError(fail)
        return Answer(summary=f"counted to {steps}", data={"steps": steps}, case=case)

    key = f"slow {case} {seconds}"
    return LongWork(key, work, Answer(summary="counting", data={}, case=case), patience_seconds)


@SLOW.tool("BlockThread", title="Block a thread")
def block_thread(app: App, seconds: Annotated[float, Field(ge=0)]) -> Answer:
    """Sleep without a look at whether to stop, as a call into a foreign library does."""
    del app
    time.sleep(seconds)
    return Answer(summary="slept", data={})


if __name__ == "__main__":
    server.GROUPS = (*server.GROUPS, SLOW)
    sys.exit(serve_stdio(server.build_server(Path(sys.argv[1])), legacy_only="--legacy-only" in sys.argv))
