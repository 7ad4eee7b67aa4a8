"""A store with a case, for tests of work on it."""

from __future__ import annotations

from pathlib import Path

import pytest

from evidence_store import EvidenceStore


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Path of a store with an empty case c."""
    path = tmp_path / "atw.db"
    created = EvidenceStore(path)
    created.cases.add("c", content="x", kind="data", path="/x", facts={})
    created.close()
    return path
