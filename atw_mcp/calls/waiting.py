"""Outcomes of tools that are no results yet: running work, waited for without a worker thread, or another tool's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import CallToolResult

# Each waiting call costs a task, and for work of another process two reads of the store per second.
MOST_WAITING = 256


@dataclass(frozen=True)
class Waiting:
    """An outcome that is ready when the work of an evidence record has ended, or after `seconds`.

    evidence: the record's id. then: shapes the result once waiting is over, in a worker thread.
    """

    evidence: str
    seconds: float
    then: Callable[[], CallToolResult]


@dataclass(frozen=True)
class Forwarded:
    """An outcome that is whatever the tool called `name` makes of these arguments."""

    name: str
    arguments: dict[str, Any]


class WaitingCalls:
    """Counts the calls that wait, so that their number is bounded. Used on the event loop's thread only."""

    def __init__(self, most: int = MOST_WAITING) -> None:
        self._most = most
        self._count = 0

    @contextmanager
    def counted(self, evidence: str) -> Iterator[None]:
        """Count a call for as long as it waits; raises ToolError where as many as allowed wait already."""
        if self._count >= self._most:
            raise ToolError(
                f"{self._most} calls are waiting for results already. Next: ReadEvidence(evidence={evidence!r}) "
                "without wait_seconds, which returns the progress at once"
            )
        self._count += 1
        try:
            yield
        finally:
            self._count -= 1
