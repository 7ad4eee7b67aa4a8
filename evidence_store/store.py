"""The store as a whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

from evidence_store.cases import Cases
from evidence_store.connection import Connection
from evidence_store.content import ContentTable
from evidence_store.errors import StoreFull, StoreReadOnly
from evidence_store.evidence import Evidence, EvidenceTable
from evidence_store.jobs import Jobs
from evidence_store.reading import ReadOnlyConnection
from evidence_store.tasks import Tasks
from evidence_store.worlds import Worlds


class EvidenceStore:
    """Cases, observations, worlds, rollouts, fits and evidence in one SQLite file.

    Safe for several threads and several processes at once. Raises the errors of `evidence_store.errors`.
    """

    def __init__(self, path: str | os.PathLike[str], *, busy_timeout: float | None = None) -> None:
        self._use(Connection(path, busy_timeout=busy_timeout))

    @classmethod
    def to_read(cls, path: str | os.PathLike[str]) -> EvidenceStore:
        """Open a store that exists to read it only, as `ReadOnlyConnection` does."""
        store = cls.__new__(cls)
        store._use(ReadOnlyConnection(path))
        return store

    def _use(self, connection: Connection) -> None:
        self.connection = connection
        self.path = self.connection.path
        self.cases = Cases(self.connection)
        self.worlds = Worlds(self.connection)
        self.observations = ContentTable(self.connection, "observations", "obs")
        self.rollouts = ContentTable(self.connection, "rollouts", "rollout")
        self.fits = ContentTable(self.connection, "fits", "fit")
        self.evidence = EvidenceTable(self.connection)
        self.jobs = Jobs(self.connection)
        self.tasks = Tasks(self.connection)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Everything stored inside is stored together, or not at all."""
        with self.connection.write():
            yield

    def read_evidence(self, identifier: str) -> Evidence:
        """One record of evidence; one whose worker died while it ran is `failed`, and marked so where that can be."""
        record = self.evidence.get(identifier)
        if record.status != "running":
            return record
        job = self.jobs.get(identifier)
        if job is not None and job.alive():
            return record
        where = "" if job is None else f" (process {job.pid} on {job.host})"
        summary = f"the process that worked on this{where} ended before it was done; "
        summary += f"call {record.tool} again with the same arguments"
        with suppress(StoreFull, StoreReadOnly), self.transaction():  # as true where it cannot be written down
            record = self.evidence.get(identifier)
            if record.status == "running":  # else it finished between the two looks
                record = replace(record, status="failed", summary=summary)
                self.evidence.update(record)
                self.jobs.finish(identifier)
        return replace(record, status="failed", summary=summary) if record.status == "running" else record

    def close(self) -> None:
        """Bring the write-ahead log into the file and close it, whatever the state of the disk.

        Nothing acknowledged is lost where this is never called; but a copy of the file alone then lacks what its log
        holds.
        """
        self.connection.close()
