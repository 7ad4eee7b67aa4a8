"""MCP over the pipes of a server process that runs already."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
from mcp.client._transport import TransportStreams
from mcp.shared.message import SessionMessage
from mcp_types import jsonrpc_message_adapter

from atw_mcp.server_process import ServerProcess

GONE = (anyio.ClosedResourceError, anyio.BrokenResourceError)


@asynccontextmanager
async def over_pipes(server: ServerProcess) -> AsyncIterator[TransportStreams]:
    """A transport as the SDK's `Client` takes it. Stops the server in the end.

    The SDK's own transport starts the process itself, which takes the time of importing the SDK before that.
    """
    received, read_stream = anyio.create_memory_object_stream[SessionMessage | Exception](0)
    write_stream, sent = anyio.create_memory_object_stream[SessionMessage](0)
    lines = server.lines()

    async def receive() -> None:
        async with received:
            listening = True
            while (line := await anyio.to_thread.run_sync(next, lines, None)) is not None:
                if listening:  # the rest is read all the same: a server that cannot write cannot end
                    try:
                        await received.send(_message(line))
                    except GONE:
                        listening = False

    async def send() -> None:
        try:
            async with sent:
                async for message in sent:
                    text = message.message.model_dump_json(by_alias=True, exclude_unset=True)
                    await anyio.to_thread.run_sync(server.write, text)
        except (OSError, ValueError, *GONE):
            await received.aclose()  # the session sees the end of the connection, not a call without an answer

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(receive)
        tasks.start_soon(send)
        try:
            yield read_stream, write_stream
        finally:
            with anyio.CancelScope(shield=True):
                for stream in (write_stream, read_stream):
                    await stream.aclose()
                await anyio.to_thread.run_sync(server.stop)  # ends both tasks


def _message(line: str) -> SessionMessage | Exception:
    try:
        return SessionMessage(jsonrpc_message_adapter.validate_json(line, by_name=False))
    except ValueError as error:
        return error
