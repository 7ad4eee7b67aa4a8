"""Commands that call tools of a server that they started."""

from __future__ import annotations

import sys
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from threading import Event
from typing import Any

import anyio
from anyio.from_thread import start_blocking_portal
from mcp.server import MCPServer

from atw_mcp.client import Session, connected, lost_server_named
from atw_mcp.printing import ProgressLine
from atw_mcp.replies import Reply, ToolFailed
from atw_mcp.script import Step, run_script
from atw_mcp.server_process import ServerProcess
from atw_mcp.shell import run_shell
from atw_mcp.tools import manifest

CANCEL_WAIT = 5.0  # [s] for a cancelled call to leave the terminal alone
Server = ServerProcess | MCPServer[Any]
Show = Callable[[Reply], None]


def call_tool(server: Server, tool: str, arguments: dict[str, Any], show: Show) -> bool:
    """Call one tool and show its reply; returns whether it succeeded, having said on stderr why not."""

    async def work(session: Session) -> None:
        show(await session.call(tool, arguments))

    return in_session(server, work)


def call_steps(server: Server, steps: Sequence[Step], variables: Mapping[str, Any], show: Show) -> bool:
    """Call the tools of a script and show each reply; returns whether all succeeded."""

    def begin(step: Step, said: str | None) -> None:
        if said:
            print(said, file=sys.stderr)
        print(f"{step.name + ': ' if step.name else ''}{step.tool}", file=sys.stderr)

    async def work(session: Session) -> None:
        async for _, reply in run_script(list(steps), session, variables, begin):
            show(reply)

    return in_session(server, work)


def call_lines(server: Server, known: Mapping[str, Any], show: Show) -> bool:
    """Call what is typed, or comes through a pipe, line by line; returns whether that succeeded."""
    with (
        lost_server_named(),
        start_blocking_portal() as portal,
        portal.wrap_async_context_manager(connected(server, ProgressLine())) as session,
    ):

        def call(tool: str, arguments: dict[str, Any]) -> Reply:
            ended = Event()

            async def work() -> Reply:
                try:
                    return await session.call(tool, arguments)
                finally:
                    ended.set()

            future = portal.start_task_soon(work)
            try:
                return future.result()
            except KeyboardInterrupt:
                future.cancel()  # the client notifies the server, which stops the work
                ended.wait(CANCEL_WAIT)
                raise

        return run_shell(call, manifest.entries(), known, show)


def show_demo(server: Server, which: str, output: Path, store: Path) -> bool:
    """Run a demo; returns whether it succeeded."""
    from atw_mcp.demo.narrate import demo  # OpenCV

    async def work(session: Session) -> None:
        await demo(session, which, output, store, sys.stdout)

    return in_session(server, work)


def in_session(server: Server, work: Callable[[Session], Awaitable[None]]) -> bool:
    """Work with a session; returns False, with the reason on stderr, where a tool failed. Raises ServerLost."""

    async def connect() -> bool:
        async with connected(server, ProgressLine()) as session:
            try:
                await work(session)
            except ToolFailed as error:
                print(f"atw-mcp: {error}", file=sys.stderr)
                return False
        return True

    with lost_server_named():
        return anyio.run(connect)
