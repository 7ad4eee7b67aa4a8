"""Make what the live page shows of a store when it is asked for, and keep it as long as nothing in it changes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.viewer.case_document import case_document
from atw_mcp.viewer.document import Film
from atw_mcp.viewer.film import film
from atw_mcp.viewer.packing import Blocks, packed
from atw_mcp.viewer.running import running_views
from evidence_store import Case, ChangeWatch, EvidenceStore, revision
from polyworld.core.kept import BOUNDS, Kept

NO_TIMES = np.zeros(0, np.float32)
KEPT = 4  # films, each of `viewer.film.MAX_BYTES` at most: of the cases looked at last


@dataclass(frozen=True)
class PlayedFilm:
    """A film as it is served: its description without data, when its frames begin, the file or why there is none."""

    film: Film | None
    times: NDArray[np.float32]
    data: bytes
    missing: str


class LiveContent:
    """Documents and films of the cases of one store. Safe for several threads."""

    def __init__(self, store: EvidenceStore) -> None:
        self.store = store
        self._films: OrderedDict[tuple[str, str], PlayedFilm] = OrderedDict()
        self._documents: Kept[tuple[str, str], bytes] = Kept(BOUNDS.views)
        self._guard = threading.Lock()

    def revision(self, case: str) -> str:
        """Return which state of its records a case is in; raises UnknownRecord."""
        self.store.cases.get(case)
        return revision(self.store.connection, case)

    def document(self, case: str) -> tuple[str, bytes]:
        """Return a revision and the packed document that shows it, or a later one; raises UnknownRecord."""
        at = self.revision(case)
        with self._guard:  # two pages that ask at once wait for one document
            return at, self._documents.get((case, at), lambda: self._packed(case))

    def film(self, case: str) -> PlayedFilm:
        """Return the film of a case; raises UnknownRecord."""
        with self._guard:
            return self._film(self.store.cases.get(case))

    def running(self, case: str) -> list[dict[str, Any]]:
        """Return the work under way, JSON-ready."""
        return [item.model_dump(mode="json") for item in running_views(self.store, case)]

    def _packed(self, case: str) -> bytes:
        document, blocks = case_document(self.store, case)
        played = self._film(self.store.cases.get(case))
        if played.film is not None:
            document.film = played.film.model_copy(update={"media_times": blocks.floats(played.times)})
        elif played.missing:
            document.missing.append(played.missing)
        return packed(document, blocks)

    def _film(self, case: Case) -> PlayedFilm:
        key = (case.content, case.path)
        if key not in self._films:
            played = _played(case)
            if played.film is None:  # the file may come back
                return played
            self._films[key] = played
        self._films.move_to_end(key)
        while len(self._films) > KEPT:
            self._films.popitem(last=False)
        return self._films[key]


class CaseFollower:
    """Looks whether a case has changed: cheaply, as often as it is asked. For one thread at a time."""

    def __init__(self, content: LiveContent, case: str) -> None:
        self._content, self._case = content, case
        self._watch = ChangeWatch(content.store.path)
        self._state: dict[str, Any] = {"revision": "", "running": []}
        self._file = _identity(content.store.path)

    def gone(self) -> bool:
        """Whether the store's file is no longer where it was: removed, renamed, or another in its place."""
        return _identity(self._content.store.path) != self._file

    def look(self) -> dict[str, Any] | None:
        """Return the revision and the work under way where either has changed since the last look, else None.

        Raises StoreError and sqlite3.Error where the store cannot be read.
        """
        # The end of a worker that was killed changes nothing in the store.
        if not self._watch.changed() and not self._state["running"]:
            return None
        state = {"revision": self._content.revision(self._case), "running": self._content.running(self._case)}
        if state == self._state:
            return None
        self._state = state
        return state

    def close(self) -> None:
        """Stop looking."""
        self._watch.close()


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        state = path.stat()
    except OSError:
        return None
    return state.st_dev, state.st_ino


def _played(case: Case) -> PlayedFilm:
    if case.kind != "video":
        return PlayedFilm(None, NO_TIMES, b"", "")
    blocks = Blocks()
    found, missing = film(case, Path(case.path), blocks)
    if found is None or found.data is None:
        return PlayedFilm(None, NO_TIMES, b"", missing)
    whole = blocks.joined()
    data = whole[found.data.offset : found.data.offset + found.data.shape[0]]
    times = np.frombuffer(whole, "<f4", found.frame_count, found.media_times.offset)
    return PlayedFilm(found.model_copy(update={"data": None, "url": "film"}), times, data, "")
