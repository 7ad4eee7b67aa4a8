"""Tool calls as plain function calls, for tests that are not about the connection."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from atw_mcp.server import build_server


def server_in_this_process(store: Path, allow: Iterable[Path] = ()) -> AbstractContextManager[Any]:
    """Serve as `server_process.started` does, without the seconds that another process needs to start."""
    return nullcontext(build_server(store, allow=allow))


class Session:
    """Calls on one server, each over its own connection; refusals come back as text."""

    def __init__(self, store: Path) -> None:
        self.store = store
        self.server = build_server(store)

    def _call(self, tool: str, arguments: dict[str, Any]) -> Any:
        async def call() -> Any:
            async with Client(self.server) as client:
                return await client.call_tool(tool, arguments)

        return anyio.run(call)

    def shown(self, tool: str, /, **arguments: Any) -> dict[str, Any]:
        """The result as an agent is shown it."""
        result = self._call(tool, arguments)
        assert not result.is_error, result.content[0].text
        body: dict[str, Any] = json.loads(result.content[0].text)
        return body

    def __call__(self, tool: str, /, **arguments: Any) -> dict[str, Any]:
        body = self.shown(tool, **arguments)
        if "shortened" in body and tool != "ReadEvidence":  # an agent that wants it all reads it again
            return self("ReadEvidence", evidence=body["evidence"], detail="full")
        return body

    def refused(self, tool: str, /, **arguments: Any) -> str:
        """The text of the refusal; evidence, cases and worlds must be as before."""
        before = self._state()
        result = self._call(tool, arguments)
        assert result.is_error, result.content[0].text
        assert self._state() == before
        return str(result.content[0].text)

    def _state(self) -> list[Any]:
        with sqlite3.connect(self.store) as database:
            tables = ("cases", "case_worlds", "case_observations", "evidence", "bindings", "answers")
            return [database.execute(f"SELECT * FROM {table}").fetchall() for table in tables]

    def store_rows(self, query: str) -> list[tuple[Any, ...]]:
        """What the store holds, looked at from outside."""
        with sqlite3.connect(self.store) as database:
            return database.execute(query).fetchall()

    def store_document(self, world: str) -> str:
        """A world's stored JSON."""
        with sqlite3.connect(self.store) as database:
            return str(database.execute("SELECT document FROM worlds WHERE id = ?", [world]).fetchone()[0])
