"""Results addressed by what determined them: observations, rollouts, fits. Nothing is computed twice."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from evidence_store.canonical import Arrays, content_id, pack_arrays, to_json, unpack_arrays
from evidence_store.connection import Connection
from evidence_store.errors import UnknownRecord


@dataclass(frozen=True)
class Content:
    """A stored result: `inputs` determined it, `document` is its JSON part, `arrays` the rest."""

    id: str
    kind: str
    inputs: dict[str, Any]
    document: dict[str, Any]
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)


class ContentTable:
    """One table of results, each found again by the hash of (kind, inputs)."""

    def __init__(self, connection: Connection, table: str, prefix: str) -> None:
        self._connection, self._table, self._prefix = connection, table, prefix

    def key(self, kind: str, inputs: dict[str, Any]) -> str:
        """The id the result of these inputs has, stored or not."""
        return content_id(self._prefix, {"kind": kind, "inputs": inputs})

    def find(self, kind: str, inputs: dict[str, Any]) -> Content | None:
        """The stored result of these inputs, or None."""
        return self._row(self.key(kind, inputs))

    def get(self, identifier: str) -> Content:
        """The result with this id; raises UnknownRecord or RecordDamaged."""
        found = self._row(identifier)
        if found is None:
            raise UnknownRecord(f"no {self._table.rstrip('s')} has the id {identifier!r}")
        return found

    def latest(self, kind: str, name: str, value: str) -> Content | None:
        """The result of this kind stored last among those with this value of an input, or None."""
        with self._connection.read() as database:
            found = database.conn.execute(
                f"SELECT id FROM {self._table} WHERE kind = ? AND json_extract(inputs, ?) = ? ORDER BY rowid DESC",
                [kind, f"$.{name}", value],
            ).fetchone()
        return None if found is None else self._row(found[0])

    def put(self, kind: str, inputs: dict[str, Any], document: dict[str, Any], arrays: Arrays | None = None) -> Content:
        """Store a result; the first one stored for equal inputs stays."""
        identifier = self.key(kind, inputs)
        row = {
            "id": identifier,
            "kind": kind,
            "inputs": to_json(inputs),
            "document": to_json(document),
            "arrays": pack_arrays(arrays),
        }
        with self._connection.write():
            self._connection.insert(self._table, row, ignore=True)
        return self.get(identifier)

    def get_or_compute(
        self, kind: str, inputs: dict[str, Any], compute: Callable[[], tuple[dict[str, Any], Arrays | None]]
    ) -> tuple[Content, bool]:
        """The result of these inputs and whether it had to be computed now."""
        found = self.find(kind, inputs)
        if found is not None:
            return found, False
        document, arrays = compute()
        return self.put(kind, inputs, document, arrays), True

    def _row(self, identifier: str) -> Content | None:
        with self._connection.read() as database:
            rows = self._connection.verified(
                self._table, database.query(f"SELECT * FROM {self._table} WHERE id = ?", [identifier])
            )
        if not rows:
            return None
        row = rows[0]
        return Content(
            id=row["id"],
            kind=row["kind"],
            inputs=json.loads(row["inputs"]),
            document=json.loads(row["document"]),
            arrays=unpack_arrays(row["arrays"]),
        )
