"""Opening a case: finding out what a file is, and naming the case after it."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evidence_store import Case, EvidenceStore

if TYPE_CHECKING:
    from atw_mcp.perception.video import VideoInfo


def content_hash(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def path_hash(path: Path) -> str:
    """SHA-256 of a file, or of the names and contents of all files of a folder."""
    if path.is_file():
        return content_hash(path)
    digest = hashlib.sha256()
    for file in sorted(p for p in path.rglob("*") if p.is_file()):
        digest.update(f"{file.relative_to(path).as_posix()}\0{content_hash(file)}\n".encode())
    return digest.hexdigest()


def video_facts(info: VideoInfo) -> dict[str, Any]:
    """Return what is kept of a video's probe: facts of the content, not of where the file lies."""
    facts = info.to_dict()
    for key in ("path", "sha256"):
        facts.pop(key)
    return facts


def case_name(path: Path, content: str) -> str:
    """A name for the case of a file: its stem and six digits of its hash."""
    stem = re.sub(r"[^A-Za-z0-9]+", "-", path.stem).strip("-").lower()[:40] or "case"
    return f"{stem}-{content[:6]}"


def open_case(
    store: EvidenceStore, path: Path, *, kind: str, facts: dict[str, Any], name: str | None, questions: list[str]
) -> Case:
    """The case of a file's content, new or as it was; raises StoreError where the name is taken by another."""
    content = path_hash(path)
    with store.transaction():
        known = [case.id for case in store.cases.all() if case.content == content and case.kind == kind]
        identifier = name or (known[0] if known else case_name(path, content))
        case = store.cases.add(identifier, content=content, kind=kind, path=str(path), facts=facts)
        for question in questions:
            store.cases.add_question(case.id, question)
    return case
