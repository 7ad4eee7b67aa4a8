"""Replies to tool calls as the command line has them, free of the protocol."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol


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


class ServerLost(Exception):
    """The server that a command started has ended before the command."""


class ToolCaller(Protocol):
    """Something that calls tools: a session with a server, or a stand-in for one."""

    @property
    def schemas(self) -> dict[str, dict[str, Any]]:
        """JSON schema of the arguments of every tool, by name."""
        ...

    async def call(self, tool: str, arguments: dict[str, Any]) -> Reply:
        """Call a tool and wait for its result; raises ToolFailed."""
        ...


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
