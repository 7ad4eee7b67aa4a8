"""Evidence: one record for each tool result, in the order they were made."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from evidence_store.canonical import pack_arrays, to_json, unpack_arrays
from evidence_store.checksums import COLUMNS, intact, label
from evidence_store.connection import Connection, next_number
from evidence_store.errors import UnknownRecord
from evidence_store.search_conditions import Conditions

Status = Literal["running", "completed", "failed", "cancelled", "diverged"]

HEAD = ", ".join((*COLUMNS["evidence"], "checksum"))  # all but payload and pictures, which may be long


@dataclass(frozen=True)
class Evidence:
    """Record of what a tool returned, and from what.

    `interval` is [start, end] in seconds where the result covers an interval. `payload` is the whole result;
    `pictures` are encoded image files by name, e.g. {"overlay.png": b"..."}.
    """

    tool: str
    arguments: dict[str, Any]
    case: str | None = None
    world: str | None = None
    rollout: str | None = None
    observation: str | None = None
    objects: tuple[str, ...] = ()
    interval: tuple[float, float] | None = None
    status: Status = "completed"
    summary: str = ""
    payload: dict[str, Any] = field(default_factory=dict)
    pictures: dict[str, bytes] = field(default_factory=dict)
    id: str = ""


@dataclass(frozen=True)
class EvidencePage:
    """Records found by a search, latest first, without payload and pictures.

    `cursor` continues the search where this page ended; None where nothing more matches. `damaged` names the records
    that match as they are stored but are not intact, and are therefore not returned.
    """

    records: tuple[Evidence, ...]
    cursor: str | None
    damaged: tuple[str, ...] = ()


class EvidenceTable:
    """The evidence of a store. Ids are `ev-` and the running number."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def add(self, evidence: Evidence) -> Evidence:
        """Store a record and give it its id."""
        with self._connection.write() as database:
            seq = next_number(database, "evidence")
            row = {
                "seq": seq,
                "case_id": evidence.case,
                "tool": evidence.tool,
                "arguments": to_json(evidence.arguments),
                **_changeable(evidence),
            }
            self._connection.insert("evidence", row)
        return replace(evidence, id=f"ev-{seq}")

    def number_from(self, first: int) -> None:
        """Give the next record the id `ev-first`, so that stores filled apart can be merged.

        Raises ValueError where ids from there on may be in use.
        """
        with self._connection.write() as database:
            following = next_number(database, "evidence")
            if first < following:
                raise ValueError(f"the next record is ev-{following}: ids cannot begin at {first} again")
            database.conn.execute("DELETE FROM sqlite_sequence WHERE name = 'evidence'")
            database.conn.execute("INSERT INTO sqlite_sequence (name, seq) VALUES ('evidence', ?)", [first - 1])

    def update(self, evidence: Evidence) -> None:
        """Store what became of a record that was running; its tool, case and arguments stay."""
        seq = sequence_number(evidence.id)
        with self._connection.write() as database:
            stored = self._connection.verified(
                "evidence", database.query(f"SELECT {HEAD} FROM evidence WHERE seq = ?", [seq])
            )
            if not stored:
                raise UnknownRecord(f"no evidence has the id {evidence.id!r}")
            self._connection.change("evidence", "seq", {**stored[0], **_changeable(evidence)})

    def get(self, identifier: str) -> Evidence:
        """One record; raises UnknownRecord or RecordDamaged."""
        with self._connection.read() as database:
            rows = self._connection.verified(
                "evidence", database.query("SELECT * FROM evidence WHERE seq = ?", [sequence_number(identifier)])
            )
        if not rows:
            raise UnknownRecord(f"no evidence has the id {identifier!r}")
        return _evidence(rows[0])

    def of_case(self, case: str, *, tool: str | None = None) -> list[Evidence]:
        """The intact records of a case, oldest first, without payload and pictures; `damaged` names the others."""
        return [_evidence(row) for row in self._heads(case, tool) if intact("evidence", row)]

    def damaged(self, case: str) -> list[str]:
        """Names of the records of a case that are damaged, payload and pictures not looked at."""
        return [label("evidence", row) for row in self._heads(case, None) if not intact("evidence", row)]

    def _heads(self, case: str, tool: str | None) -> list[dict[str, Any]]:
        with self._connection.read() as database:
            return list(
                database.query(
                    f"SELECT {HEAD} FROM evidence WHERE case_id = ?{' AND tool = ?' * (tool is not None)} ORDER BY seq",
                    [case] if tool is None else [case, tool],
                )
            )

    def last_about(self, case: str, rollout: str) -> str | None:
        """Id of the latest intact record of a case that is about a rollout; None where there is none."""
        with self._connection.read() as database:
            rows = database.query(
                f"SELECT {HEAD} FROM evidence WHERE rollout_id = ? AND case_id = ? ORDER BY seq DESC", [rollout, case]
            )
            with closing(rows):
                return next((f"ev-{row['seq']}" for row in rows if intact("evidence", row)), None)

    def rollouts(self, limit: int) -> list[str]:
        """Ids of rollouts that there are records about, those used last first."""
        with self._connection.read() as database:
            found = database.conn.execute(
                "SELECT rollout_id FROM evidence WHERE rollout_id IS NOT NULL GROUP BY rollout_id "
                "ORDER BY max(seq) DESC LIMIT ?",
                [limit],
            )
            return [str(rollout) for (rollout,) in found.fetchall()]

    def search(
        self,
        case: str,
        *,
        tool: str | None = None,
        object: str | None = None,
        interval: tuple[float, float] | None = None,
        text: str | None = None,
        status: Status | None = None,
        limit: int = 20,
        cursor: str | None = None,
    ) -> EvidencePage:
        """Find records of a case, latest first; every condition given must hold.

        tool, status: equal to the record's. object: one of the record's objects. interval [s]: overlaps the record's,
        ends included; a record without an interval does not match. text: each of its words occurs in the summary, the
        arguments or the payload, in upper or lower case. limit: most records of a page. cursor: that of the previous
        page; records added since then appear in none of the following pages.

        Raises ValueError for a limit below 1, an interval that ends before it starts or a text without words, and
        UnknownRecord for a cursor that no search returned. A case that does not exist has no records.
        """
        if limit < 1:
            raise ValueError(f"limit must be at least 1, got {limit}")
        if interval is not None and not interval[0] <= interval[1]:
            raise ValueError(f"interval must be [start, end] with start <= end, got {list(interval)}")
        words = None if text is None else text.casefold().split()
        if words == []:
            raise ValueError("text must contain at least one word")
        conditions = Conditions.of(case)
        if cursor is not None:
            conditions.add("seq < ?", sequence_number(cursor))
        if tool is not None:
            conditions.add("tool = ?", tool)
        if status is not None:
            conditions.add("status = ?", status)
        if object is not None:
            conditions.mention(object)
        if interval is not None:
            conditions.overlap(interval)
        if words:
            conditions.contain(words)
        columns = f"{HEAD}, payload" if words else HEAD  # payloads are long: read only where they matter
        found: list[Evidence] = []
        damaged: list[str] = []
        following = None
        with self._connection.read() as database:
            rows = database.query(
                f"SELECT {columns} FROM evidence WHERE {conditions.text} ORDER BY seq DESC", conditions.values
            )
            with closing(rows):
                for row in rows:
                    if not intact("evidence", row):
                        damaged.append(label("evidence", row))
                        continue
                    if words and not _contains(row, words):
                        continue
                    record = _evidence({name: value for name, value in row.items() if name != "payload"})
                    if object is not None and object not in record.objects:
                        continue
                    if interval is not None and not _overlap(record.interval, interval):
                        continue
                    if len(found) == limit:  # this one is the next page's
                        following = found[-1].id
                        break
                    found.append(record)
        return EvidencePage(tuple(found), following, tuple(damaged))


def _contains(row: dict[str, Any], words: list[str]) -> bool:
    """Whether every word occurs in the row's text; JSON writes quotes and line breaks of a word as escapes."""
    text = "\n".join((row["summary"], row["arguments"], row["payload"])).casefold()
    return all(word in text or json.dumps(word, ensure_ascii=False)[1:-1] in text for word in words)


def _overlap(one: tuple[float, float] | None, other: tuple[float, float]) -> bool:
    return one is not None and one[0] <= other[1] and other[0] <= one[1]


def sequence_number(identifier: str) -> int:
    """The running number in an evidence id; raises UnknownRecord for text that is no such id."""
    head, _, tail = identifier.partition("-")
    if head != "ev" or not tail.isdecimal() or len(tail) > 15:
        raise UnknownRecord(f"no evidence has the id {identifier!r}; ids look like 'ev-12'")
    return int(tail)


def _changeable(evidence: Evidence) -> dict[str, Any]:
    pictures = {name: np.frombuffer(data, dtype=np.uint8) for name, data in evidence.pictures.items()}
    return {
        "world_id": evidence.world,
        "rollout_id": evidence.rollout,
        "observation_id": evidence.observation,
        "objects": to_json(list(evidence.objects)),
        "interval": None if evidence.interval is None else to_json(list(evidence.interval)),
        "status": evidence.status,
        "summary": evidence.summary,
        # not sorted: read again, a result reads as it did the first time
        "payload": json.dumps(evidence.payload, separators=(",", ":"), ensure_ascii=False, allow_nan=False),
        "attachments": pack_arrays(pictures),
    }


def _evidence(row: dict[str, Any]) -> Evidence:
    """Return a row as a record; one read without payload and pictures has none."""
    interval = None if row["interval"] is None else json.loads(row["interval"])
    return Evidence(
        id=f"ev-{row['seq']}",
        case=row["case_id"],
        tool=row["tool"],
        arguments=json.loads(row["arguments"]),
        world=row["world_id"],
        rollout=row["rollout_id"],
        observation=row["observation_id"],
        objects=tuple(json.loads(row["objects"])),
        interval=None if interval is None else (interval[0], interval[1]),
        status=row["status"],
        summary=row["summary"],
        payload=json.loads(row.get("payload", "{}")),
        pictures={name: array.tobytes() for name, array in unpack_arrays(row.get("attachments")).items()},
    )
