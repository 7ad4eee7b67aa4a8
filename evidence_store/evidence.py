"""Evidence: one record for each tool result, in the order they were made."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from evidence_store.canonical import pack_arrays, to_json, unpack_arrays
from evidence_store.connection import Connection
from evidence_store.errors import UnknownRecord

Status = Literal["running", "completed", "failed", "cancelled", "diverged"]


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


class EvidenceTable:
    """The evidence of a store. Ids are `ev-` and the running number."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def add(self, evidence: Evidence) -> Evidence:
        """Store a record and give it its id."""
        with self._connection.write() as database:
            cursor = database.conn.execute(
                "INSERT INTO evidence (case_id, tool, arguments, world_id, rollout_id, observation_id, objects, "
                "interval, status, summary, payload, attachments) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                [evidence.case, evidence.tool, to_json(evidence.arguments), *_changeable(evidence)],
            )
            seq = cursor.lastrowid
        return replace(evidence, id=f"ev-{seq}")

    def update(self, evidence: Evidence) -> None:
        """Store what became of a record that was running; its tool, case and arguments stay."""
        with self._connection.write() as database:
            database.conn.execute(
                "UPDATE evidence SET world_id = ?, rollout_id = ?, observation_id = ?, objects = ?, interval = ?, "
                "status = ?, summary = ?, payload = ?, attachments = ? WHERE seq = ?",
                [*_changeable(evidence), sequence_number(evidence.id)],
            )

    def get(self, identifier: str) -> Evidence:
        """One record; raises UnknownRecord."""
        with self._connection.read() as database:
            rows = list(database.query("SELECT * FROM evidence WHERE seq = ?", [sequence_number(identifier)]))
        if not rows:
            raise UnknownRecord(f"no evidence has the id {identifier!r}")
        return _evidence(rows[0])

    def of_case(self, case: str, *, tool: str | None = None) -> list[Evidence]:
        """The records of a case, oldest first, without payload and pictures."""
        with self._connection.read() as database:
            rows = database.query(
                "SELECT seq, case_id, tool, arguments, world_id, rollout_id, observation_id, objects, interval, "
                "status, summary, '{}' AS payload, NULL AS attachments FROM evidence "
                "WHERE case_id = ? AND (? IS NULL OR tool = ?) ORDER BY seq",
                [case, tool, tool],
            )
            return [_evidence(row) for row in rows]


def sequence_number(identifier: str) -> int:
    """The running number in an evidence id; raises UnknownRecord for text that is no such id."""
    head, _, tail = identifier.partition("-")
    if head != "ev" or not tail.isdecimal() or len(tail) > 15:
        raise UnknownRecord(f"no evidence has the id {identifier!r}; ids look like 'ev-12'")
    return int(tail)


def _changeable(evidence: Evidence) -> list[Any]:
    pictures = {name: np.frombuffer(data, dtype=np.uint8) for name, data in evidence.pictures.items()}
    return [
        evidence.world,
        evidence.rollout,
        evidence.observation,
        to_json(list(evidence.objects)),
        None if evidence.interval is None else to_json(list(evidence.interval)),
        evidence.status,
        evidence.summary,
        # not sorted: read again, a result reads as it did the first time
        json.dumps(evidence.payload, separators=(",", ":"), ensure_ascii=False, allow_nan=False),
        pack_arrays(pictures),
    ]


def _evidence(row: dict[str, Any]) -> Evidence:
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
        payload=json.loads(row["payload"]),
        pictures={name: array.tobytes() for name, array in unpack_arrays(row["attachments"]).items()},
    )
