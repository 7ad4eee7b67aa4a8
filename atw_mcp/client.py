"""A client of this server: calls its tools, waits for long work."""

from __future__ import annotations

import base64
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import anyio
from mcp import Client
from mcp.server import MCPServer
from mcp.shared.exceptions import MCPError
from mcp_types import (
    CONNECTION_CLOSED,
    CallToolRequest,
    CallToolRequestParams,
    CallToolResult,
    ImageContent,
    TextContent,
)

from atw_mcp.pipes import over_pipes
from atw_mcp.replies import ProgressDisplay, Reply, ServerLost, ToolFailed
from atw_mcp.script import ScriptError
from atw_mcp.server_process import ServerProcess
from atw_mcp.tools import manifest

LOOK_AGAIN = 1.0  # [s] between two looks at work that outlived its call


class Session:
    """An open connection to a server."""

    def __init__(self, client: Client, schemas: dict[str, dict[str, Any]], progress: ProgressDisplay) -> None:
        self._client, self._progress = client, progress
        self._schemas = schemas

    @property
    def schemas(self) -> dict[str, dict[str, Any]]:
        """JSON schema of the arguments of every tool, by name."""
        return self._schemas

    async def call(self, tool: str, arguments: dict[str, Any]) -> Reply:
        """Call a tool and wait for its result, also when the call itself returns before the work is done.

        Raises ToolFailed with the tool's own words, MCPError where the server is gone.
        """
        try:
            return await self._followed(tool, arguments)
        finally:
            self._progress.clear()

    async def _followed(self, tool: str, arguments: dict[str, Any]) -> Reply:
        reply = await self._once(tool, arguments)
        while reply.body.get("status") == "running" and tool != "ReadEvidence":
            progress = reply.body.get("data", {}).get("progress", {})
            self._progress.show(progress.get("done") or 0.0, progress.get("total"), progress.get("message") or "")
            await anyio.sleep(LOOK_AGAIN)
            seen = await self._once("ReadEvidence", {"evidence": reply.body["evidence"]})
            reply = Reply(tool, seen.body, seen.pictures)
        if reply.body.get("status") in ("failed", "cancelled") and tool != "ReadEvidence":
            raise ToolFailed(f"{tool}: {reply.body.get('summary')}")
        if reply.body.get("shortened") and tool != "ReadEvidence":  # scripts refer to any item of a list
            seen = await self._once("ReadEvidence", {"evidence": reply.body["evidence"], "detail": "full"})
            reply = Reply(tool, seen.body, seen.pictures)
        return reply

    async def _once(self, tool: str, arguments: dict[str, Any]) -> Reply:
        async def report(progress: float, total: float | None, message: str | None) -> None:
            self._progress.show(progress, total, message or "")

        try:
            # not Client.call_tool, which lists the tools and compiles a schema before it hands on the result
            request = CallToolRequest(params=CallToolRequestParams(name=tool, arguments=arguments))
            result = await self._client.session.send_request(request, CallToolResult, progress_callback=report)
        except MCPError as error:
            if error.code == CONNECTION_CLOSED:
                raise
            raise ToolFailed(error.message) from error
        return reply_of(tool, result)


def reply_of(tool: str, result: CallToolResult) -> Reply:
    """The parts of a tool result; raises ToolFailed for an error result."""
    texts = [block.text for block in result.content if isinstance(block, TextContent)]
    if result.is_error:
        raise ToolFailed("\n".join(texts) or f"{tool} failed and gave no reason")
    try:
        body = json.loads(texts[0]) if texts else {}
    except json.JSONDecodeError:
        body = {"text": "\n".join(texts)}
    pictures = tuple(
        (block.mime_type.rsplit("/", 1)[-1].replace("jpeg", "jpg"), base64.b64decode(block.data))
        for block in result.content
        if isinstance(block, ImageContent)
    )
    return Reply(tool, body if isinstance(body, dict) else {"value": body}, pictures)


@asynccontextmanager
async def connected(server: ServerProcess | MCPServer[Any], progress: ProgressDisplay) -> AsyncIterator[Session]:
    """A session with a server of this installation: a process of its own, or one in this process."""
    transport = over_pipes(server) if isinstance(server, ServerProcess) else server
    async with Client(transport) as client:
        yield Session(client, manifest.schemas(), progress)


@contextmanager
def lost_server_named() -> Iterator[None]:
    """Unwrap what the SDK's task groups wrap; raise ServerLost where the server has ended."""
    try:
        yield
    except (BaseExceptionGroup, MCPError) as raised:
        error = _innermost(raised)
        if isinstance(error, MCPError):
            raise ServerLost(error.message) from raised
        if isinstance(error, ScriptError | KeyboardInterrupt):
            raise error from raised
        raise


def _innermost(error: BaseException) -> BaseException:
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    return error
