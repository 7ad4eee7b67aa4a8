"""Free ids for an imported case in a store that is in use; every reference inside the case follows them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlite_utils import Database

from evidence_store.canonical import to_json
from evidence_store.checksums import stamped
from evidence_store.connection import next_number
from evidence_store.references import EVIDENCE

TEXTS = {
    "world_parents": ("detail",),
    "answers": ("answer", "evidence", "missing"),
    "bindings": ("reason",),
    "evidence": ("arguments", "summary", "payload"),
}
"""Columns that may name evidence or the case."""
JSON_TEXTS = ("detail", "evidence", "arguments", "payload")
IMPORTED = "imported"
"""Key of a payload: a list of the ids that the record had before each import that changed them."""


@dataclass(frozen=True)
class Renumbering:
    """Name an imported case and its evidence here: `shift` is added to the number of each piece of its evidence.

    One shift for all: evidence of other cases, which was left behind, is not mistaken for any that is here.
    """

    exported: str
    case: str
    shift: int

    @classmethod
    def of(cls, database: Database, rows: Mapping[str, list[dict[str, Any]]]) -> Renumbering:
        """Return one to free ids; it changes nothing where those of the archive are free."""
        (exported,) = (row["id"] for row in rows["cases"])
        case, number = exported, 1
        while database.conn.execute("SELECT 1 FROM cases WHERE id = ?", [case]).fetchone():
            number += 1
            case = f"{exported}-{number}"
        taken = any(
            database.conn.execute("SELECT 1 FROM evidence WHERE seq = ?", [row["seq"]]).fetchone()
            for row in rows["evidence"]
        )
        shift = next_number(database, "evidence") - 1 if taken or case != exported else 0
        return cls(exported, case, shift)

    def rows(self, rows: Mapping[str, list[dict[str, Any]]]) -> dict[str, list[dict[str, Any]]]:
        """Return the rows of an archive with their ids here."""
        if not self.shift and self.case == self.exported:
            return dict(rows)
        return {table: [self._row(table, row) for row in found] for table, found in rows.items()}

    def _row(self, table: str, row: dict[str, Any]) -> dict[str, Any]:
        changed = dict(row)
        for column in TEXTS.get(table, ()):
            if row[column] is None:
                continue
            if column not in JSON_TEXTS:
                changed[column] = self._value(row[column])
                continue
            value = self._value(json.loads(row[column]))
            if column == "payload":
                value = self._with_old_id(json.loads(row[column]), value, row["seq"])
            # a payload keeps its order; a detail is part of a key, and written as `Worlds.put` does
            changed[column] = json.dumps(value, **_COMPACT) if column == "payload" else to_json(value)
        if table == "cases":
            changed["id"] = self.case
        if "case_id" in row:
            changed["case_id"] = self.case
        if table == "evidence":
            changed["seq"] = row["seq"] + self.shift
        return stamped(table, changed)

    def _with_old_id(self, before: dict[str, Any], value: dict[str, Any], seq: int) -> dict[str, Any]:
        old = {"case": self.exported, "evidence": f"ev-{seq}"}
        return {**value, IMPORTED: [*before.get(IMPORTED, []), old]}

    def _value(self, value: Any, key: str = "") -> Any:
        """Return a value of JSON with the ids of here."""
        match value:
            case str() if key == "case" and value == self.exported:
                return self.case
            case str():
                text = value.replace(f"case={self.exported!r}", f"case={self.case!r}")
                return EVIDENCE.sub(lambda found: f"ev-{int(found[0][3:]) + self.shift}", text)
            case dict():
                return {name: self._value(item, name) for name, item in value.items()}
            case list():
                return [self._value(item) for item in value]
            case _:
                return value


_COMPACT: dict[str, Any] = {"separators": (",", ":"), "ensure_ascii": False, "allow_nan": False}
