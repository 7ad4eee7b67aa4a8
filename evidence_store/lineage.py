"""The records that the results of a case rest on, and which was derived from which."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal

from evidence_store.canonical import to_json
from evidence_store.cases import Answer
from evidence_store.errors import RecordDamaged
from evidence_store.evidence import Evidence
from evidence_store.references import CONTENTS, EVIDENCE, IDENTIFIER, referred
from evidence_store.store import EvidenceStore
from evidence_store.worlds import Descent

Kind = Literal["case", "observation", "world", "fit", "rollout", "evidence", "answer"]
KINDS: dict[str, Kind] = {"observations": "observation", "rollouts": "rollout", "fits": "fit"}


@dataclass(frozen=True)
class Record:
    """A record of a case: its id, its kind, the kind of content, origin or tool, and what the store says of it.

    The case itself has the id `case-CASE`, its answers `answer-1-CASE`, ...: they have no ids of their own.
    """

    id: str
    kind: Kind
    label: str
    about: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Derivation:
    """`target` was derived from `source`."""

    source: str
    target: str
    how: str
    detail: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Lineage:
    """Records by id, oldest evidence first, and their derivations; unreadable: what is damaged and left out."""

    records: dict[str, Record]
    derivations: tuple[Derivation, ...]
    unreadable: tuple[str, ...]

    def upstream(self, identifier: str) -> set[str]:
        """Ids of all records that one rests on, itself included."""
        sources: dict[str, list[str]] = {}
        for link in self.derivations:
            sources.setdefault(link.target, []).append(link.source)
        reached, new = set[str](), {identifier}
        while new:
            reached |= new
            new = {source for target in new for source in sources.get(target, [])} - reached
        return reached


def lineage(store: EvidenceStore, case: str) -> Lineage:
    """Return the lineage of a case; raises UnknownRecord where there is none, RecordDamaged where it is damaged itself.

    The content of observations, rollouts and fits is not read, so damage to it is not noticed here.
    """
    return _Walk(store, case).lineage()


class _Walk:
    """One pass over the records of a case."""

    def __init__(self, store: EvidenceStore, case: str) -> None:
        self._store, self._case, self._root = store, case, f"case-{case}"
        self._records: dict[str, Record] = {}
        self._links: dict[tuple[str, str], Derivation] = {}
        self._derived = set[str]()
        self._unreadable: list[str] = []

    def lineage(self) -> Lineage:
        found = self._store.cases.get(self._case)
        self._add(Record(self._root, "case", found.kind, {"content": found.content, "path": found.path}))
        self._contents()
        records = self._store.evidence.of_case(self._case)
        self._worlds(found.committed_world, {record.id for record in records})
        self._unreadable += self._store.evidence.damaged(self._case)
        for record in records:
            about = {"summary": record.summary, "status": record.status, "arguments": record.arguments}
            self._add(Record(record.id, "evidence", record.tool, about))
        for record in records:
            self._sources_of(record)
        self._proposals()
        self._answers()
        return Lineage(self._records, tuple(self._links.values()), tuple(self._unreadable))

    def _add(self, record: Record) -> None:
        self._records[record.id] = record

    def _link(self, source: str, target: str, how: str, detail: dict[str, Any] | None = None) -> None:
        """Note a derivation once, where both records are known."""
        if source != target and source in self._records and target in self._records:
            self._links.setdefault((source, target), Derivation(source, target, how, detail or {}))
            self._derived.add(target)

    @contextmanager
    def _without_damaged(self) -> Iterator[None]:
        """Name what is damaged instead of raising; what was to be read stays as it was before."""
        try:
            yield
        except RecordDamaged as error:
            self._unreadable.append(str(error).partition(" in the evidence store ")[0])

    def _contents(self) -> None:
        """Add observations, rollouts and fits, and all worlds, which these name as what they were computed from."""
        inputs: dict[str, str] = {}
        with self._store.connection.read() as database:
            used = referred(database.conn, self._case)
            for world in sorted(used.worlds):
                self._add(Record(world, "world", ""))
            for table in CONTENTS:
                rows = database.conn.execute(f"SELECT id, kind, inputs FROM {table} ORDER BY id")
                for identifier, kind, text in rows:
                    if identifier in used.contents:
                        self._add(Record(identifier, KINDS[table], kind, {"inputs": text}))
                        inputs[identifier] = text
        for identifier, text in inputs.items():
            for source in sorted(set(IDENTIFIER.findall(text))):
                self._link(source, identifier, "computed from")
        with self._without_damaged():
            for _, identifier in self._store.cases.observations(self._case):
                self._link(self._root, identifier, "observed in")

    def _worlds(self, committed: str | None, own: set[str]) -> None:
        """Link worlds to what they were made from: other worlds, tracks, fits, or the case alone.

        own: the evidence of the case. A world may have been made in another case too, from evidence of that one.
        """
        origins: dict[str, str] = {}
        modelled: dict[str, str] = {}
        with self._without_damaged():
            origins = dict(self._store.cases.worlds(self._case))
            modelled = self._store.cases.modelled_observations(self._case)
        for world in [record.id for record in self._records.values() if record.kind == "world"]:
            descents: list[Descent] = []
            with self._without_damaged():
                parents = self._store.worlds.parents(world)
                descents = [d for d in parents if own.issuperset(EVIDENCE.findall(to_json(d.detail)))] or parents
            origin = origins.get(world) or (descents[-1].how if descents else "")
            about = {"committed": world == committed, "detail": descents[-1].detail if descents else {}}
            self._add(Record(world, "world", origin, about))
            for descent in descents:
                self._link(descent.parent, world, descent.how or "built", descent.detail)
                for source in sorted(set(IDENTIFIER.findall(to_json(descent.detail)))):
                    self._link(source, world, "values of")
            if world in modelled:
                self._link(modelled[world], world, "models")
            elif world in origins and not descents:
                self._link(self._root, world, origin)

    def _sources_of(self, record: Evidence) -> None:
        """Link evidence to what it is about and to what its arguments name; to the case where that is all."""
        for source in (record.world, record.rollout, record.observation):
            if source is not None:
                self._link(source, record.id, "about")
        arguments = to_json(record.arguments)
        for source in sorted({*IDENTIFIER.findall(arguments), *EVIDENCE.findall(arguments)}):
            if record.tool != "Finish" or not source.startswith("ev-"):  # an answer rests on those itself
                self._link(source, record.id, "used")
        if record.id not in self._derived:
            self._link(self._root, record.id, "about")

    def _proposals(self) -> None:
        """Link a world with an effect to the evidence that proposed it."""
        for record in [record for record in self._records.values() if record.kind == "world"]:
            proposal = record.about["detail"].get("proposal")
            if isinstance(proposal, str):
                self._link(proposal, record.id, "proposed")

    def _answers(self) -> None:
        answers: list[Answer] = []
        with self._without_damaged():
            answers = self._store.cases.answers(self._case)
        for number, answer in enumerate(answers, start=1):
            name = f"answer-{number}-{self._case}"
            about = {"question": answer.question, "answer": answer.answer, "missing": answer.missing}
            self._add(Record(name, "answer", answer.answer or "unresolved", about))
            for identifier in answer.evidence:
                if identifier not in self._records:
                    self._add(Record(identifier, "evidence", "not readable"))
                self._link(identifier, name, "rests on")
