"""Made-up long work under the names that the official conformance suite asks of a server with tasks."""

from __future__ import annotations

import time
from typing import Annotated

from mcp.server.mcpserver.exceptions import ToolError
from mcp.shared.exceptions import MCPError
from mcp_types import CallToolResult, TextContent
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer
from atw_mcp.calls.toolbox import ToolGroup

TASKS = ToolGroup("execution control")
PATIENCE = 30.0  # [s]


@TASKS.tool("greet", title="Greet")
def greet(app: App, name: str) -> CallToolResult:
    """Greet at once."""
    del app
    return CallToolResult(content=[TextContent(type="text", text=f"Hello, {name}!")])


@TASKS.tool("slow_compute", title="Compute slowly")
def slow_compute(app: App, seconds: Annotated[float, Field(ge=0)], label: str = "") -> LongWork:
    """Count to `seconds`, twenty steps a second."""
    del app

    def work(progress: Progress) -> Answer:
        steps = round(seconds * 20)
        for step in range(steps):
            progress.report(step, steps, f"step {step}")
            time.sleep(0.05)
        return Answer(summary=f"counted to {steps}", data={"steps": steps})

    return LongWork(f"compute {label} {seconds}", work, Answer(summary="counting", data={}), PATIENCE)


@TASKS.tool("failing_job", title="Fail")
def failing_job(app: App) -> LongWork:
    """Fail as a tool fails."""
    del app

    def work(progress: Progress) -> Answer:
        time.sleep(0.8)
        progress.report(1.0)
        raise ToolError("nothing to compute. Next: greet(name='you')")

    return LongWork("fail", work, Answer(summary="failing", data={}), PATIENCE)


@TASKS.tool("protocol_error_job", title="Break")
def protocol_error_job(app: App) -> LongWork:
    """Fail as the protocol fails."""
    del app

    def work(progress: Progress) -> Answer:
        time.sleep(0.8)
        progress.report(1.0)
        raise MCPError(code=-32603, message="the machine is gone")

    return LongWork("break", work, Answer(summary="breaking", data={}), PATIENCE)
