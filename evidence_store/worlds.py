"""Worlds by content id, and their lineage as a relation beside them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from evidence_store.canonical import to_json
from evidence_store.connection import Connection
from evidence_store.errors import UnknownRecord


@dataclass(frozen=True)
class Descent:
    """How a world came from its parent."""

    parent: str
    how: str
    detail: dict[str, Any]


class Worlds:
    """World documents: immutable, so storing one again changes nothing."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def put(
        self,
        identifier: str,
        document: str,
        *,
        parent: str | None = None,
        how: str = "",
        detail: dict[str, Any] | None = None,
    ) -> None:
        """Store a world's canonical JSON under its content id, with where it came from."""
        with self._connection.write():
            self._connection.insert("worlds", {"id": identifier, "document": document}, ignore=True)
            if parent is not None and parent != identifier:
                row = {"child": identifier, "parent": parent, "how": how, "detail": to_json(detail or {})}
                self._connection.insert("world_parents", row, ignore=True)

    def document(self, identifier: str) -> str:
        """Canonical JSON of a world; raises UnknownRecord or RecordDamaged."""
        with self._connection.read() as database:
            rows = self._connection.verified(
                "worlds", database.query("SELECT * FROM worlds WHERE id = ?", [identifier])
            )
        if not rows:
            raise UnknownRecord(f"no world has the id {identifier!r}")
        return str(rows[0]["document"])

    def parents(self, identifier: str) -> list[Descent]:
        """Where a world came from, one entry for each way it was made."""
        with self._connection.read() as database:
            rows = self._connection.verified(
                "world_parents",
                database.query("SELECT * FROM world_parents WHERE child = ? ORDER BY rowid", [identifier]),
            )
        return [Descent(row["parent"], row["how"], json.loads(row["detail"])) for row in rows]
