"""Tool calls made inside other work: the same functions, each with evidence of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from evidence_store import Evidence, StoreError

LOOK_AGAIN = 0.2  # [s] between two looks at the work of a step


class StepFailed(Exception):
    """A step was refused or failed; `evidence` is its record where there is one."""

    def __init__(self, tool: str, reason: str, evidence: str | None = None) -> None:
        super().__init__(reason)
        self.tool, self.reason, self.evidence = tool, reason, evidence


@dataclass(frozen=True)
class Step:
    """A call that was made: its arguments but for the case, and its record."""

    tool: str
    arguments: dict[str, Any]
    evidence: Evidence

    @property
    def data(self) -> dict[str, Any]:
        """The whole result of the call."""
        data: dict[str, Any] = self.evidence.payload.get("data", {})
        return data


class Steps:
    """Calls tools of this server one after another and reports their progress as that of one piece of work.

    shares: the share of the whole that is done when a step of a tool ends.
    """

    def __init__(self, app: App, progress: Progress, shares: dict[str, float]) -> None:
        self._app, self._progress, self._shares = app, progress, shares
        self._tools = {tool.name: tool for tool in app.tools}
        self.done: list[Step] = []

    def call(self, name: str, /, **arguments: Any) -> Step:
        """Call a tool with arguments as an agent gives them and wait for its result.

        Long work runs as a job of its own, or joins the same work under way. Raises StepFailed with the tool's words,
        and Cancelled once that job has been cancelled too.
        """
        tool = self._tools[name]
        begin = self._progress.done
        end = max(begin, self._shares[name])  # a step that is made twice
        self._progress.report(begin, 1.0, name)
        try:
            outcome = tool.fn(self._app, **tool.checked(arguments))
            if isinstance(outcome, LongWork):
                record = self._finished(name, arguments, outcome, begin, end)
            else:
                record = self._app.store.evidence.add(outcome.to_evidence(name, arguments))
        except (ToolError, StoreError) as error:
            raise StepFailed(name, str(error)) from error
        if record.status != "completed":
            raise StepFailed(name, record.summary, record.id)
        step = Step(name, {key: value for key, value in arguments.items() if key != "case"}, record)
        self.done.append(step)
        self._progress.report(end, 1.0, name)
        return step

    def _finished(self, name: str, arguments: dict[str, Any], work: LongWork, begin: float, end: float) -> Evidence:
        job = self._app.jobs.start(name, arguments, work)
        while True:
            record = self._app.jobs.wait_for(job.evidence, LOOK_AGAIN)
            if record.status != "running":
                return record
            share, message = 0.0, ""
            if job.progress is not None:
                share = job.progress.done / job.progress.total if job.progress.total else 0.0
                message = job.progress.message
            self._progress.note(begin + (end - begin) * min(share, 1.0), 1.0, f"{name}: {message}")
            if self._progress.cancelled():
                self._app.jobs.cancel(job.evidence)
                self._app.jobs.wait_for(job.evidence, 5.0)
                self._progress.report(self._progress.done, 1.0, name)  # raises Cancelled
