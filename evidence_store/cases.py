"""Cases, their questions, bindings, answers, and which observations and worlds belong to them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from evidence_store.canonical import to_json
from evidence_store.connection import Connection
from evidence_store.errors import StoreError, UnknownRecord


@dataclass(frozen=True)
class Case:
    """One video or measured data set. `content` is the hash of the file, `path` where it was last seen."""

    id: str
    content: str
    kind: str
    path: str
    facts: dict[str, Any]
    committed_world: str | None


@dataclass(frozen=True)
class Binding:
    """A name used in a question, the observed track and the object of the world it stands for."""

    name: str
    track: str | None
    object: str | None
    reason: str


@dataclass(frozen=True)
class Answer:
    """An answer with the evidence it rests on; `answer` None means unresolved, `missing` says why."""

    question: str
    answer: str | None
    confidence: float | None
    evidence: tuple[str, ...]
    missing: str


class Cases:
    """The cases of a store."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def all(self) -> list[Case]:
        """Every case, oldest first."""
        with self._connection.read() as database:
            return [_case(row) for row in database.query("SELECT * FROM cases ORDER BY seq")]

    def get(self, identifier: str) -> Case:
        """One case; raises UnknownRecord naming the cases there are."""
        with self._connection.read() as database:
            rows = list(database.query("SELECT * FROM cases WHERE id = ?", [identifier]))
        if not rows:
            raise UnknownRecord(f"no case {identifier!r}; cases: {[case.id for case in self.all()]}")
        return _case(rows[0])

    def add(self, identifier: str, *, content: str, kind: str, path: str, facts: dict[str, Any]) -> Case:
        """Store a case, or find the one of this id again (its path is brought up to date)."""
        with self._connection.write() as database:
            rows = list(database.query("SELECT content FROM cases WHERE id = ?", [identifier]))
            if rows and rows[0]["content"] != content:
                raise StoreError(f"case {identifier!r} already exists with another content: choose another name")
            if rows:
                database.execute("UPDATE cases SET path = ? WHERE id = ?", [path, identifier])
            else:
                (seq,) = database.execute("SELECT coalesce(max(seq), 0) + 1 FROM cases").fetchone()
                database.table("cases").insert(
                    {
                        "id": identifier,
                        "content": content,
                        "kind": kind,
                        "path": path,
                        "facts": to_json(facts),
                        "committed_world": None,
                        "seq": seq,
                    }
                )
        return self.get(identifier)

    def commit_world(self, identifier: str, world_id: str) -> None:
        """Fix the world every probe of the case starts from; raises StoreError where one is fixed already."""
        with self._connection.write() as database:
            changed = database.conn.execute(
                "UPDATE cases SET committed_world = ? WHERE id = ? AND committed_world IS NULL", [world_id, identifier]
            ).rowcount
        if not changed:
            raise StoreError(
                f"case {identifier!r} already has the committed world {self.get(identifier).committed_world}"
            )

    def add_question(self, identifier: str, text: str) -> None:
        """Note a question of the case, once."""
        with self._connection.write() as database:
            database.table("questions").insert({"case_id": identifier, "text": text}, ignore=True)

    def questions(self, identifier: str) -> list[str]:
        """The questions of the case, oldest first."""
        with self._connection.read() as database:
            rows = database.query("SELECT text FROM questions WHERE case_id = ? ORDER BY seq", [identifier])
            return [row["text"] for row in rows]

    def add_observation(self, identifier: str, kind: str, observation_id: str) -> None:
        """Make an observation the case's latest of its kind."""
        with self._connection.write() as database:
            database.table("case_observations").insert(
                {"case_id": identifier, "kind": kind, "observation_id": observation_id}
            )

    def observations(self, identifier: str, kind: str | None = None) -> list[tuple[str, str]]:
        """(kind, observation id) of the case, latest first, each id once."""
        with self._connection.read() as database:
            rows = database.query(
                "SELECT kind, observation_id, max(seq) AS latest FROM case_observations WHERE case_id = ? "
                "AND (? IS NULL OR kind = ?) GROUP BY kind, observation_id ORDER BY latest DESC",
                [identifier, kind, kind],
            )
            return [(row["kind"], row["observation_id"]) for row in rows]

    def add_world(self, identifier: str, world_id: str, origin: str, observation: str | None = None) -> None:
        """Make a world one of the case's, once; `observation` is the track record it models."""
        with self._connection.write() as database:
            database.table("case_worlds").insert(
                {"case_id": identifier, "world_id": world_id, "origin": origin, "observation_id": observation},
                ignore=True,
            )

    def modelled_observation(self, identifier: str, world_id: str) -> str | None:
        """The track record that a world of the case models, where it models one."""
        with self._connection.read() as database:
            rows = list(
                database.query(
                    "SELECT observation_id FROM case_worlds WHERE case_id = ? AND world_id = ?", [identifier, world_id]
                )
            )
        return rows[0]["observation_id"] if rows else None

    def worlds(self, identifier: str) -> list[tuple[str, str]]:
        """(world id, origin) of the case, oldest first."""
        with self._connection.read() as database:
            rows = database.query(
                "SELECT world_id, origin FROM case_worlds WHERE case_id = ? ORDER BY seq", [identifier]
            )
            return [(row["world_id"], row["origin"]) for row in rows]

    def bind(self, identifier: str, binding: Binding) -> None:
        """Record a binding; it replaces an earlier one of the same name."""
        with self._connection.write() as database:
            database.table("bindings").insert(
                {
                    "case_id": identifier,
                    "name": binding.name,
                    "track": binding.track,
                    "object": binding.object,
                    "reason": binding.reason,
                }
            )

    def bindings(self, identifier: str) -> dict[str, Binding]:
        """The binding in force for each name."""
        with self._connection.read() as database:
            rows = list(database.query("SELECT * FROM bindings WHERE case_id = ? ORDER BY seq", [identifier]))
        latest = {row["name"]: Binding(row["name"], row["track"], row["object"], row["reason"]) for row in rows}
        return dict(sorted(latest.items()))

    def add_answer(self, identifier: str, answer: Answer) -> None:
        """Record an answer; a later one for the same question does not erase it."""
        with self._connection.write() as database:
            database.table("answers").insert(
                {
                    "case_id": identifier,
                    "question": answer.question,
                    "answer": answer.answer,
                    "confidence": answer.confidence,
                    "evidence": to_json(list(answer.evidence)),
                    "missing": answer.missing,
                }
            )

    def answers(self, identifier: str) -> list[Answer]:
        """Every answer given, oldest first."""
        with self._connection.read() as database:
            rows = list(database.query("SELECT * FROM answers WHERE case_id = ? ORDER BY seq", [identifier]))
        return [
            Answer(r["question"], r["answer"], r["confidence"], tuple(json.loads(r["evidence"])), r["missing"])
            for r in rows
        ]


def _case(row: dict[str, Any]) -> Case:
    return Case(row["id"], row["content"], row["kind"], row["path"], json.loads(row["facts"]), row["committed_world"])
