"""Records and lineage in SQLite: cases, observations, worlds, rollouts, fits, evidence. No physics, no MCP.

`worlds` keeps a world and the worlds it was made from, `cases` its origin and observation, `evidence` which tool was
called with which arguments.
"""

from evidence_store.canonical import content_id, to_json
from evidence_store.cases import Answer, Binding, Case
from evidence_store.content import Content, ContentTable
from evidence_store.errors import (
    BadArchive,
    NotAStore,
    RecordDamaged,
    StoreDamaged,
    StoreDiskError,
    StoreError,
    StoreFull,
    StoreLocked,
    StoreReadOnly,
    StoreTooNew,
    StoreTooOld,
    UnknownRecord,
)
from evidence_store.evidence import Evidence, EvidencePage, Status
from evidence_store.jobs import Job
from evidence_store.reading import ChangeWatch, revision
from evidence_store.store import EvidenceStore
from evidence_store.tasks import Task
from evidence_store.worlds import Descent

__all__ = [
    "Answer",
    "BadArchive",
    "Binding",
    "Case",
    "ChangeWatch",
    "Content",
    "ContentTable",
    "Descent",
    "Evidence",
    "EvidencePage",
    "EvidenceStore",
    "Job",
    "NotAStore",
    "RecordDamaged",
    "Status",
    "StoreDamaged",
    "StoreDiskError",
    "StoreError",
    "StoreFull",
    "StoreLocked",
    "StoreReadOnly",
    "StoreTooNew",
    "StoreTooOld",
    "Task",
    "UnknownRecord",
    "content_id",
    "revision",
    "to_json",
]
