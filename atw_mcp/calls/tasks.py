"""The tasks extension (SEP-2663): long work as a handle that the client polls, for clients that offer it.

A task is the evidence record of the work, seen by its client: any server on the same store answers for it, also after
a restart. Specification: https://modelcontextprotocol.io/seps/2663-tasks-extension.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import anyio
from mcp.server.context import ServerRequestContext
from mcp.server.extension import Extension, MethodBinding
from mcp.server.mcpserver.server import require_client_extension
from mcp.shared.exceptions import MCPError
from mcp.shared.inbound import MCP_NAME_HEADER, decode_header_value
from mcp_types import HEADER_MISMATCH, INTERNAL_ERROR, INVALID_PARAMS, CallToolResult, RequestParams, TextContent
from mcp_types.methods import serialize_server_result
from mcp_types.version import MODERN_PROTOCOL_VERSIONS

from evidence_store import Evidence, Task, UnknownRecord

if TYPE_CHECKING:
    from atw_mcp.calls.app import App

EXTENSION = "io.modelcontextprotocol/tasks"
POLL_MS = 1000  # between two looks: work reports its progress to the store once a second
PROMPT = 0.5  # [s] work that ends sooner answers its call at once, without a task

Context = ServerRequestContext[Any, Any]


class TaskParams(RequestParams):
    """Parameters that name a task."""

    task_id: str


class UpdateParams(TaskParams):
    """Answers to questions that a task asked."""

    input_responses: dict[str, Any]


class TasksExtension(Extension):
    """Serves `tasks/get`, `tasks/update` and `tasks/cancel`; `WorldTool` makes the tasks."""

    identifier = EXTENSION

    def __init__(self, app: App) -> None:
        self._app = app

    def methods(self) -> Sequence[MethodBinding]:
        """The methods, in the revisions that have extensions."""
        versions = frozenset(MODERN_PROTOCOL_VERSIONS)
        return (
            MethodBinding("tasks/get", TaskParams, self._get, versions),
            MethodBinding("tasks/update", UpdateParams, self._update, versions),
            MethodBinding("tasks/cancel", TaskParams, self._cancel, versions),
        )

    async def _get(self, context: Context, params: TaskParams) -> dict[str, Any]:
        check_request(context, params.task_id)
        return await anyio.to_thread.run_sync(task_state, self._app, params.task_id, context.protocol_version)

    async def _update(self, context: Context, params: UpdateParams) -> dict[str, Any]:
        """Acknowledge answers: no task of this server asks anything, and unknown keys are to be ignored."""
        check_request(context, params.task_id)
        await anyio.to_thread.run_sync(_known, self._app, params.task_id)
        return {}

    async def _cancel(self, context: Context, params: TaskParams) -> dict[str, Any]:
        check_request(context, params.task_id)

        def cancel() -> None:
            task = _known(self._app, params.task_id)
            if self._app.store.read_evidence(task.evidence).status == "running":
                self._app.jobs.cancel(task.evidence)

        await anyio.to_thread.run_sync(cancel)
        return {}


def offered(context: Context) -> bool:
    """Whether the client of this request takes tasks."""
    capabilities = context.session.client_capabilities
    extensions = None if capabilities is None else capabilities.extensions
    return context.protocol_version in MODERN_PROTOCOL_VERSIONS and EXTENSION in (extensions or {})


def check_request(context: Context, task_id: str) -> None:
    """Raise MCPError where the client did not offer the extension or its routing header names another task."""
    require_client_extension(context, EXTENSION)
    named = None if context.request is None else context.request.headers.get(MCP_NAME_HEADER)
    # Absent is accepted, although clients must send it: it serves intermediaries, and no answer depends on it.
    if named is not None and decode_header_value(named) != task_id:
        raise MCPError(code=HEADER_MISMATCH, message=f"{MCP_NAME_HEADER} header does not match params.taskId")


def create_task(app: App, record: Evidence) -> dict[str, Any]:
    """Return the result of a call whose work goes on as a task; made first where there is none."""
    task = app.store.tasks.open(record.id)
    return {"resultType": "task", **_metadata(app, task, record), "status": "working"}


def task_state(app: App, task_id: str, version: str) -> dict[str, Any]:
    """Return a task with its result or error as `tasks/get` shows it; raises MCPError for an unknown id."""
    task = _known(app, task_id)
    record = app.store.read_evidence(task.evidence)
    if record.status == "failed" and task.ended is None:  # the process that worked on it is gone
        app.store.tasks.end(task.evidence, {"code": INTERNAL_ERROR, "message": record.summary})
        task = _known(app, task_id)
    state = {"resultType": "complete", **_metadata(app, task, record)}
    if record.status == "running":
        return {**state, "status": "working"}
    if record.status == "cancelled":
        return {**state, "status": "cancelled"}
    if task.error is not None:
        return {**state, "status": "failed", "error": task.error}
    result = failure(record) if record.status == "failed" else app.evidence_result(record.id)
    dumped = result.model_dump(by_alias=True, mode="json", exclude_none=True)
    return {**state, "status": "completed", "result": serialize_server_result("tools/call", version, dumped)}


def known(app: App, task_ids: list[str]) -> dict[str, str]:
    """Return the evidence of each task that there is, by the task's id."""
    found: dict[str, str] = {}
    for identifier in task_ids:
        with suppress(UnknownRecord):
            found[identifier] = app.store.tasks.get(identifier).evidence
    return found


def failure(record: Evidence) -> CallToolResult:
    """Return the error result of a call whose work failed."""
    text = f"{record.summary} (evidence {record.id})"
    return CallToolResult(content=[TextContent(type="text", text=text)], is_error=True)


def _known(app: App, task_id: str) -> Task:
    try:
        return app.store.tasks.get(task_id)
    except UnknownRecord as error:
        raise MCPError(code=INVALID_PARAMS, message=str(error)) from error


def _metadata(app: App, task: Task, record: Evidence) -> dict[str, Any]:
    job = app.store.jobs.get(record.id) if record.status == "running" else None
    message, updated = record.summary, task.ended or task.created
    if job is not None:
        updated = max(job.heartbeat, task.created)
        share = f"{100 * min(job.done / job.total, 1):.0f} %" if job.total else ""
        message = ", ".join(part for part in (record.summary, share, job.message) if part)
    return {
        "taskId": task.id,
        "statusMessage": f"{message} (evidence {record.id})",
        "createdAt": _iso(task.created),
        "lastUpdatedAt": _iso(updated),
        "ttlMs": None,  # evidence stays until someone prunes the store
        "pollIntervalMs": POLL_MS,
    }


def _iso(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
