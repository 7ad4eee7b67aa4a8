"""Messages as lines on stdin and stdout. A line that is no message is answered with an error.

The SDK's own transport drops such lines, which leaves their sender waiting, and reads lines of any length.
"""

from __future__ import annotations

import os
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import Any

import anyio
import anyio.from_thread
import anyio.to_thread
from anyio.lowlevel import EventLoopToken, current_token
from mcp.shared._context_streams import ContextReceiveStream, ContextSendStream, create_context_streams
from mcp.shared.message import SessionMessage
from mcp_types import INVALID_REQUEST, JSONRPCMessage

from atw_mcp.transports.limits import LIMITS, WireLimits
from atw_mcp.transports.messages import NotAMessage, encoded, read_message

CHUNK = 64 * 1024  # bytes; what a pipe holds
Incoming = ContextReceiveStream[SessionMessage | Exception]
Outgoing = ContextSendStream[SessionMessage]


class LineReader:
    """Splits bytes into lines, none of which takes more memory than the limit."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._line = bytearray()
        self._skipping = False

    def feed(self, chunk: bytes) -> Iterator[bytes | NotAMessage]:
        """Yield the lines that the chunk completes, and for a line beyond the limit its refusal, once.

        chunk: bytes; empty for the end of the input, which ends the last line.
        """
        *ended, rest = (chunk or b"\n").split(b"\n")
        for part in ended:
            yield from self._grow(part)
            if not self._skipping and self._line.strip():
                yield bytes(self._line)
            self._line.clear()
            self._skipping = False
        yield from self._grow(rest)

    def _grow(self, part: bytes) -> Iterator[NotAMessage]:
        if self._skipping:
            return
        self._line += part
        if len(self._line) > self._most:
            yield NotAMessage(INVALID_REQUEST, f"the message is longer than {self._most} bytes", bytes(self._line))
            self._line.clear()
            self._skipping = True


@asynccontextmanager
async def stdio_streams(
    *, on_end: Callable[[], object], limits: WireLimits = LIMITS
) -> AsyncIterator[tuple[Incoming, Outgoing]]:
    """Serve the process's stdin and stdout as streams of messages.

    on_end: called once stdin has ended. Meanwhile descriptor 0 is the null device and 1 is stderr, so that nothing
    else reads or writes the wire.
    """
    incoming: tuple[ContextSendStream[SessionMessage | Exception], Incoming]
    incoming = create_context_streams[SessionMessage | Exception](0)
    outgoing: tuple[Outgoing, ContextReceiveStream[SessionMessage]] = create_context_streams[SessionMessage](0)
    one_at_a_time = anyio.Lock()

    with _claimed() as (source, sink):

        async def write(message: JSONRPCMessage) -> None:
            with suppress(BrokenPipeError):  # the client is gone; the end of its input ends the session
                async with one_at_a_time:
                    # A client that does not read must not keep the process alive: a write may be abandoned.
                    await anyio.to_thread.run_sync(_write_all, sink, encoded(message), abandon_on_cancel=True)

        async def write_outgoing() -> None:
            async with outgoing[1]:
                async for message in outgoing[1]:
                    await write(message.message)

        async def take(line: bytes | NotAMessage) -> None:
            try:
                if isinstance(line, NotAMessage):
                    raise line
                message = read_message(line)
            except NotAMessage as refused:
                await write(refused.reply)
            else:
                await incoming[0].send(SessionMessage(message))

        async def end() -> None:
            on_end()
            await incoming[0].aclose()

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(write_outgoing)
            token = current_token()
            # daemon: a read that blocks must not keep the process alive.
            reader = threading.Thread(
                target=_read_lines,
                args=(source, LineReader(limits.message_bytes), take, end, token),
                daemon=True,
                name="stdin",
            )
            reader.start()
            try:
                yield incoming[1], outgoing[0]
            finally:
                await incoming[0].aclose()
                await outgoing[0].aclose()


def _read_lines(
    source: int,
    lines: LineReader,
    take: Callable[[bytes | NotAMessage], Coroutine[Any, Any, None]],
    end: Callable[[], Coroutine[Any, Any, None]],
    token: EventLoopToken,
) -> None:
    # Each line is taken before more is read, so that a flood waits in the pipe and not in memory.
    with suppress(anyio.RunFinishedError, anyio.ClosedResourceError, anyio.BrokenResourceError):
        chunk = b"\n"
        while chunk:
            chunk = _read(source)
            for line in lines.feed(chunk):
                anyio.from_thread.run(take, line, token=token)
        anyio.from_thread.run(end, token=token)


def _read(source: int) -> bytes:
    try:
        return os.read(source, CHUNK)
    except OSError:  # a pseudo-terminal whose other end is closed
        return b""


def _write_all(sink: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(sink, rest) :]


@contextmanager
def _claimed() -> Iterator[tuple[int, int]]:
    """Descriptors of the wire, 0 and 1 pointing elsewhere until the end."""
    source, sink = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDWR)
    try:
        os.dup2(nothing, 0)
        try:
            os.dup2(2, 1)
        except OSError:  # started without a stderr
            os.dup2(nothing, 1)
        yield source, sink
    finally:
        os.dup2(source, 0)
        os.dup2(sink, 1)
        os.close(nothing)
        # The duplicates stay open: the thread that reads may still block on one of them.
