"""A client that offers the tasks extension and sees tasks as they are on the wire."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import anyio
from mcp import Client
from mcp.client.extension import ClaimContext, ClientExtension, NotificationBinding, ResultClaim
from mcp_types import CallToolResult, Request, RequestParams, Result
from pydantic import BaseModel, ConfigDict

from atw_mcp.calls.tasks import EXTENSION


class Created(Result):
    """Result of a call whose work goes on."""

    model_config = ConfigDict(extra="allow")
    result_type: Literal["task"] = "task"


class Wire(Result):
    """Any result, with all its fields as they came."""

    model_config = ConfigDict(extra="allow")


class TaskRequest(Request[Any, str]):
    """A request about a task."""

    name_param: ClassVar[str | None] = "taskId"
    method: str
    params: Any


class TaskRequestParams(RequestParams):
    """Parameters of any request about a task."""

    model_config = ConfigDict(extra="allow")


class Seen(BaseModel):
    """Parameters of a notification about a task."""

    model_config = ConfigDict(extra="allow")


class Tasks(ClientExtension):
    """Offers the extension and keeps the notifications that came."""

    identifier = EXTENSION

    def __init__(self) -> None:
        self.seen: list[dict[str, Any]] = []

    def claims(self) -> Sequence[ResultClaim[Any]]:
        """The results of calls that became tasks."""
        return [ResultClaim(result_type="task", model=Created, resolve=self._resolve)]

    def notifications(self) -> Sequence[NotificationBinding[Any]]:
        """What the server says unasked."""
        return [NotificationBinding(method="notifications/tasks", params_type=Seen, handler=self._hear)]

    async def _resolve(self, created: Created, context: ClaimContext) -> CallToolResult:
        raise AssertionError(f"{context.tool_name}: tests follow tasks such as {created} themselves")

    async def _hear(self, seen: Seen) -> None:
        self.seen.append(seen.model_dump())


def offering(client: Client, tasks: Tasks | None = None) -> Client:
    """The same client, not yet entered, with the extension offered."""
    return Client(client.server, mode=client.mode, extensions=[tasks or Tasks()])


async def call(client: Client, tool: str, **arguments: Any) -> dict[str, Any]:
    """Call a tool; its result as it is on the wire."""
    result = await client.session.call_tool(tool, arguments, allow_claimed=True)
    return result.model_dump(by_alias=True)


async def ask(client: Client, method: str, task: str, **more: Any) -> dict[str, Any]:
    """Send a request about a task; its result as it is on the wire."""
    request = TaskRequest(method=method, params={"taskId": task, **more})
    return (await client.session.send_request(request, Wire)).model_dump(by_alias=True)


async def settled(client: Client, task: str) -> dict[str, Any]:
    """The task once it has ended."""
    with anyio.fail_after(20):
        while True:
            state = await ask(client, "tasks/get", task)
            if state["status"] != "working":
                return state
            await anyio.sleep(0.05)
