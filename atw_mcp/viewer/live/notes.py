"""Notes that a person leaves at a moment of a case: kept as evidence, which the agent reads as any other."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from evidence_store import Evidence, EvidenceStore, StoreError

TOOL = "Note"
"""Stands in the place of the tool that made a record."""


class Note(BaseModel):
    """A note as the page sends it."""

    model_config = ConfigDict(extra="forbid", str_strip_whitespace=True)

    text: str = Field(min_length=1, max_length=2000)
    time: float = Field(ge=0, allow_inf_nan=False, description="[s]")
    object: str | None = Field(default=None, max_length=64, description="that was chosen")
    rollout: str | None = Field(default=None, max_length=64, description="that was shown")


def keep(store: Path, case: str, note: Note) -> str:
    """Store a note with its moment; returns its evidence id. Raises StoreError, UnknownRecord for another's ids."""
    if not store.is_file():  # else one would be made
        raise StoreError(f"{store} is no longer there")
    opened = EvidenceStore(store)
    try:
        opened.cases.get(case)
        world = None if note.rollout is None else str(opened.rollouts.get(note.rollout).document["world"])
        record = Evidence(
            TOOL,
            {"case": case, "time": note.time, "text": note.text},
            case=case,
            world=world,
            rollout=note.rollout,
            objects=() if note.object is None else (note.object,),
            interval=(note.time, note.time),
            summary=note.text,
            payload={"data": {"time": note.time, "text": note.text, "written_by": "a person, in the viewer"}},
        )
        return opened.evidence.add(record).id
    finally:
        opened.close()
