"""A client of this server: starts it as a child process over stdio, calls its tools, waits for long work."""

from __future__ import annotations

import base64
import json
import os
import sys
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TextIO

import anyio
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client
from mcp.shared.exceptions import MCPError
from mcp_types import CONNECTION_CLOSED, CallToolResult, ImageContent, TextContent, Tool

NO_GPU = "Warp CUDA warning:"  # Warp's native code writes it whatever the log level
LOOK_AGAIN = 1.0  # [s] between two looks at work that outlived its call


class ProgressDisplay(Protocol):
    """Where progress is shown while a call runs."""

    def show(self, done: float, total: float | None, message: str) -> None:
        """Show how far the work is."""
        ...

    def clear(self) -> None:
        """Remove what was shown: the call is over."""
        ...


@dataclass(frozen=True)
class Reply:
    """Reply to a tool call. body: the result's JSON; pictures: encoded images with their file ending."""

    tool: str
    body: dict[str, Any]
    pictures: tuple[tuple[str, bytes], ...] = field(default=(), repr=False)


class ToolFailed(Exception):
    """A tool refused or failed; the message is the tool's own."""


class ToolCaller(Protocol):
    """Something that calls tools: a `Session`, or a stand-in for one."""

    @property
    def schemas(self) -> dict[str, dict[str, Any]]:
        """JSON schema of the arguments of every tool, by name."""
        ...

    async def call(self, tool: str, arguments: dict[str, Any]) -> Reply:
        """Call a tool and wait for its result; raises ToolFailed."""
        ...


class Session:
    """An open connection to a server."""

    def __init__(self, client: Client, tools: list[Tool], progress: ProgressDisplay) -> None:
        self._client, self._progress = client, progress
        self.tools = tools

    @property
    def schemas(self) -> dict[str, dict[str, Any]]:
        """JSON schema of the arguments of every tool, by name."""
        return {tool.name: tool.input_schema for tool in self.tools}

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
        return reply

    async def _once(self, tool: str, arguments: dict[str, Any]) -> Reply:
        async def report(progress: float, total: float | None, message: str | None) -> None:
            self._progress.show(progress, total, message or "")

        try:
            result = await self._client.call_tool(tool, arguments, progress_callback=report)
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
async def connected(store: Path | None, progress: ProgressDisplay) -> AsyncIterator[Session]:
    """A session with a server of its own on `store` (default: the server's)."""
    with _errors_shown() as errors:
        async with Client(stdio_client(server_process(store), errlog=errors)) as client:
            tools: list[Tool] = []
            cursor = None
            while True:
                page = await client.list_tools(cursor=cursor)
                tools += page.tools
                cursor = page.next_cursor
                if cursor is None:
                    break
            yield Session(client, tools, progress)


@contextmanager
def _errors_shown() -> Iterator[TextIO]:
    """Yield a file whose lines are forwarded to stderr, except warnings that the machine has no GPU: none is needed."""
    source, sink = os.pipe()

    def pass_on() -> None:
        with open(source, encoding="utf-8", errors="replace") as lines:
            for line in lines:
                if not line.startswith(NO_GPU):
                    sys.stderr.write(line)
                    sys.stderr.flush()

    reader = threading.Thread(target=pass_on, daemon=True)
    reader.start()
    try:
        with open(sink, "w", encoding="utf-8") as file:
            yield file
    finally:
        reader.join(timeout=2.0)  # what the server left running may hold the other end


def server_process(store: Path | None) -> StdioServerParameters:
    """How to start this very installation's server as a child process."""
    # The SDK strips the environment down to a few variables; caches, proxies and library paths live in the rest.
    package = str(Path(__file__).parents[1])
    search = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    options = [] if store is None else ["--store", str(store)]
    return StdioServerParameters(
        command=sys.executable,
        args=["-m", "atw_mcp", "serve", *options],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(search)},
    )


def save_pictures(reply: Reply, folder: Path) -> list[Path]:
    """Write a reply's pictures to `folder`, named after their evidence; returns the absolute paths."""
    paths = []
    for number, (ending, content) in enumerate(reply.pictures, start=1):
        folder.mkdir(parents=True, exist_ok=True)
        stem = reply.body.get("evidence") or reply.tool
        path = (folder / f"{stem}-{number}.{ending}").absolute()
        path.write_bytes(content)
        paths.append(path)
    return paths
