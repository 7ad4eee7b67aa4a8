"""Cases, their questions, bindings, answers, and which observations and worlds belong to them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from sqlite_utils import Database

from evidence_store.canonical import to_json
from evidence_store.checksums import intact, label
from evidence_store.connection import Connection, next_number
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
        """Every case whose record is intact, oldest first; `damaged` names the others."""
        return [_case(row) for row in self._rows() if intact("cases", row)]

    def damaged(self) -> list[str]:
        """Names of the records of cases that are damaged."""
        return [label("cases", row) for row in self._rows() if not intact("cases", row)]

    def get(self, identifier: str) -> Case:
        """One case; raises UnknownRecord naming the cases there are, RecordDamaged where it is not intact."""
        with self._connection.read() as database:
            rows = self._of(database, identifier)
        if not rows:
            raise UnknownRecord(f"no case {identifier!r}; cases: {[case.id for case in self.all()]}")
        return _case(rows[0])

    def add(self, identifier: str, *, content: str, kind: str, path: str, facts: dict[str, Any]) -> Case:
        """Store a case, or find the one of this id again (its path is brought up to date)."""
        with self._connection.write() as database:
            rows = self._of(database, identifier)
            if rows and rows[0]["content"] != content:
                raise StoreError(f"case {identifier!r} already exists with another content: choose another name")
            if rows:
                self._connection.change("cases", "id", {**rows[0], "path": path})
            else:
                self._connection.insert(
                    "cases",
                    {
                        "id": identifier,
                        "content": content,
                        "kind": kind,
                        "path": path,
                        "facts": to_json(facts),
                        "committed_world": None,
                        "seq": next_number(database, "cases"),
                    },
                )
        return self.get(identifier)

    def commit_world(self, identifier: str, world_id: str) -> None:
        """Set the world that probes of the case start from; earlier ones remain worlds of the case."""
        with self._connection.write() as database:
            rows = self._of(database, identifier)
            if not rows:
                raise UnknownRecord(f"no case {identifier!r}; cases: {[case.id for case in self.all()]}")
            self._connection.change("cases", "id", {**rows[0], "committed_world": world_id})

    def add_question(self, identifier: str, text: str) -> None:
        """Note a question of the case, once."""
        with self._connection.write() as database:
            self._connection.insert(
                "questions",
                {"seq": next_number(database, "questions"), "case_id": identifier, "text": text},
                ignore=True,
            )

    def questions(self, identifier: str) -> list[str]:
        """The questions of the case, oldest first."""
        return [row["text"] for row in self._relation("questions", identifier)]

    def add_observation(self, identifier: str, kind: str, observation_id: str) -> None:
        """Make an observation the case's latest of its kind."""
        with self._connection.write() as database:
            self._connection.insert(
                "case_observations",
                {
                    "seq": next_number(database, "case_observations"),
                    "case_id": identifier,
                    "kind": kind,
                    "observation_id": observation_id,
                },
            )

    def observations(self, identifier: str, kind: str | None = None) -> list[tuple[str, str]]:
        """(kind, observation id) of the case, latest first, each id once."""
        rows = self._relation("case_observations", identifier)[::-1]
        pairs = [(row["kind"], row["observation_id"]) for row in rows if kind is None or row["kind"] == kind]
        return list(dict.fromkeys(pairs))

    def add_world(self, identifier: str, world_id: str, origin: str, observation: str | None = None) -> None:
        """Make a world one of the case's, once; `observation` is the track record it models."""
        with self._connection.write() as database:
            self._connection.insert(
                "case_worlds",
                {
                    "seq": next_number(database, "case_worlds"),
                    "case_id": identifier,
                    "world_id": world_id,
                    "origin": origin,
                    "observation_id": observation,
                },
                ignore=True,
            )

    def prefer_world(self, identifier: str, world_id: str) -> None:
        """Make a world that is one of the case's already its latest."""
        with self._connection.write() as database:
            where, key = "case_id = ? AND world_id = ?", [identifier, world_id]
            rows = self._connection.verified(
                "case_worlds", database.query(f"SELECT * FROM case_worlds WHERE {where}", key)
            )
            database.conn.execute(f"DELETE FROM case_worlds WHERE {where}", key)
            for row in rows:
                self._connection.insert("case_worlds", {**row, "seq": next_number(database, "case_worlds")})

    def modelled_observation(self, identifier: str, world_id: str) -> str | None:
        """The track record that a world of the case models, where it models one."""
        return self.modelled_observations(identifier).get(world_id)

    def modelled_observations(self, identifier: str) -> dict[str, str]:
        """The track record that each world of the case models, by the world's id, of those that model one."""
        rows = self._relation("case_worlds", identifier)
        return {row["world_id"]: row["observation_id"] for row in rows if row["observation_id"] is not None}

    def worlds(self, identifier: str) -> list[tuple[str, str]]:
        """(world id, origin) of the case, oldest first."""
        return [(row["world_id"], row["origin"]) for row in self._relation("case_worlds", identifier)]

    def has_world(self, identifier: str, world_id: str) -> bool:
        """Whether a world is one of the case's; raises RecordDamaged where the record of that is not intact."""
        with self._connection.read() as database:
            rows = database.query(
                "SELECT * FROM case_worlds WHERE case_id = ? AND world_id = ?", [identifier, world_id]
            )
            return bool(self._connection.verified("case_worlds", rows))

    def bind(self, identifier: str, binding: Binding) -> None:
        """Record a binding; it replaces an earlier one of the same name."""
        with self._connection.write() as database:
            self._connection.insert(
                "bindings",
                {
                    "seq": next_number(database, "bindings"),
                    "case_id": identifier,
                    "name": binding.name,
                    "track": binding.track,
                    "object": binding.object,
                    "reason": binding.reason,
                },
            )

    def bindings(self, identifier: str) -> dict[str, Binding]:
        """The binding in force for each name."""
        rows = self._relation("bindings", identifier)
        latest = {row["name"]: Binding(row["name"], row["track"], row["object"], row["reason"]) for row in rows}
        return dict(sorted(latest.items()))

    def add_answer(self, identifier: str, answer: Answer) -> None:
        """Record an answer; a later one for the same question does not erase it."""
        with self._connection.write() as database:
            self._connection.insert(
                "answers",
                {
                    "seq": next_number(database, "answers"),
                    "case_id": identifier,
                    "question": answer.question,
                    "answer": answer.answer,
                    "confidence": None if answer.confidence is None else float(answer.confidence),
                    "evidence": to_json(list(answer.evidence)),
                    "missing": answer.missing,
                },
            )

    def answers(self, identifier: str) -> list[Answer]:
        """Every answer given, oldest first."""
        rows = self._relation("answers", identifier)
        return [
            Answer(r["question"], r["answer"], r["confidence"], tuple(json.loads(r["evidence"])), r["missing"])
            for r in rows
        ]

    def _rows(self) -> list[dict[str, Any]]:
        with self._connection.read() as database:
            return list(database.query("SELECT * FROM cases ORDER BY seq"))

    def _of(self, database: Database, identifier: str) -> list[dict[str, Any]]:
        rows = database.query("SELECT * FROM cases WHERE id = ?", [identifier])
        return self._connection.verified("cases", rows)

    def _relation(self, table: str, identifier: str) -> list[dict[str, Any]]:
        """Rows that belong to a case, oldest first; raises RecordDamaged: without one of them the list would lie."""
        with self._connection.read() as database:
            rows = database.query(f"SELECT * FROM {table} WHERE case_id = ? ORDER BY seq", [identifier])
            return self._connection.verified(table, rows)


def _case(row: dict[str, Any]) -> Case:
    return Case(row["id"], row["content"], row["kind"], row["path"], json.loads(row["facts"]), row["committed_world"])
