"""Resources by which the viewer in an MCP host reads a case: a table of contents, then its parts.

Clients of HTTP refuse messages above 1 MB, and a document with its film has several. Parts are addressed by the SHA-256
of the whole that they belong to, so that no two states of a case are mixed.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ResourceNotFoundError
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.calls.files import FileRefused
from atw_mcp.calls.resource_errors import explaining
from atw_mcp.viewer.document import Film, ViewDocument
from atw_mcp.viewer.packing import Blocks, packed
from polyworld.core.kept import BOUNDS

if TYPE_CHECKING:
    from evidence_store import Case

PART = 360_000  # bytes, 480 kB in base64: half of what clients take; a multiple of 3, so that texts of parts join
KEPT = 4  # views in memory: two conversations at once, each with the state before a change and after it


@dataclass(frozen=True)
class View:
    """A packed document, and the bytes of the film that goes with it, empty where there is none."""

    document: bytes
    film: bytes
    mime: str

    def contents(self) -> dict[str, Any]:
        """Return what there is to read."""
        film = {**_about(self.film), "mime": self.mime} if self.film else None
        return {"document": _about(self.document), "film": film}

    def part(self, digest: str, number: int) -> bytes | None:
        """Return a part of the document or the film, whichever has this digest; None where there is no such part."""
        whole = next((data for data in (self.document, self.film) if data and _digest(data) == digest), b"")
        return whole[number * PART : (number + 1) * PART] or None


class Views:
    """The views of a store's cases. The last few are kept, as their parts are read one by one."""

    def __init__(self, app: App) -> None:
        self._app = app
        self._kept: list[tuple[str, tuple[str, ...], View]] = []  # latest last
        self._films: dict[tuple[Any, ...], _Film] = {}
        self._lock = Lock()

    def made(self, case: str, rollouts: tuple[str, ...]) -> View:
        """Return the present state of a case; raises StoreError where it or a rollout cannot be read."""
        from atw_mcp.viewer.case_document import case_document  # the engine

        document, blocks = case_document(self._app.store, case, first=rollouts)
        found = self._film(document)
        film = found.film and found.film.model_copy(update={"media_times": blocks.floats(found.times)})
        missing = [*document.missing, *([found.why_not] if found.why_not else [])]
        document = document.model_copy(update={"film": film, "missing": missing})
        view = View(packed(document, blocks), found.data, "" if film is None else film.mime)
        with self._lock:
            self._kept = [*self._kept, (case, rollouts, view)][-KEPT:]
            while len(self._kept) > 1 and sum(len(v.document) + len(v.film) for *_, v in self._kept) > BOUNDS.views:
                self._kept = self._kept[1:]
        return view

    def part(self, case: str, rollouts: tuple[str, ...], digest: str, number: int) -> bytes:
        """Return a part of a view; raises ResourceNotFoundError where the case is no longer as it was."""
        with self._lock:
            kept = [view for name, first, view in reversed(self._kept) if (name, first) == (case, rollouts)]
        # Where another server on the same store answered before, what it made is made again.
        for view in (*kept, None):
            found = (view or self.made(case, rollouts)).part(digest, number)
            if found is not None:
                return found
        raise ResourceNotFoundError(
            f"case {case!r} has no part {number} of {digest[:12]}...: it has changed. Read atw://view/{case} again"
        )

    def _film(self, document: ViewDocument) -> _Film:
        """Return the film of a case, kept as long as the file is the same: transcoding takes seconds."""
        case = self._app.store.cases.get(document.case.id)
        if case.kind != "video":
            return _Film()
        try:
            path = self._app.files.film(case.path)
        except FileRefused as refused:  # it is gone, or in a folder that calls may not read
            return _Film(why_not=f"The video is not shown: {self._app.files.redacted(str(refused))}.")
        covered = max((world.frame_count for world in document.worlds), default=0)
        state = path.stat()
        key = (case.id, case.content, covered, path, state.st_mtime_ns, state.st_size)
        with self._lock:
            if key not in self._films:
                self._films = dict([*self._films.items(), (key, _film_of(case, path, covered))][-KEPT:])
            return self._films[key]


@dataclass(frozen=True)
class _Film:
    """A film without its arrays, the times of its frames [s], and its bytes; or why there is none."""

    film: Film | None = None
    times: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    data: bytes = b""
    why_not: str = ""


def _film_of(case: Case, path: Path, covered: int) -> _Film:
    from atw_mcp.viewer.film import film  # OpenCV

    blocks = Blocks()
    found, why_not = film(case, path, blocks, covered)
    if found is None or found.data is None:
        return _Film(why_not=why_not)
    section = memoryview(blocks.joined())
    times = np.frombuffer(section, "<f4", found.frame_count, found.media_times.offset)
    data = section[found.data.offset :][: found.data.shape[0]].tobytes()
    return _Film(found.model_copy(update={"data": None}), times, data)


def register(server: MCPServer[Any], app: App) -> None:
    """Serve the views of a store's cases."""
    views = Views(app)

    @server.resource(
        "atw://view/{case}{?rollouts}",
        title="A case for the viewer",
        description="digest, bytes and number of parts of the viewer's document and film; rollouts: ids of one or two "
        "to open with, separated by a comma",
        mime_type="application/json",
    )
    def contents(case: str, rollouts: str = "") -> str:
        with explaining():
            return json.dumps(views.made(case, _ids(rollouts)).contents())

    @server.resource(
        "atw://view/{case}/{digest}/{part}{?rollouts}",
        title="A part of a case for the viewer",
        description="bytes of the document or film of this digest, by number from 0",
        mime_type="application/octet-stream",
    )
    def part(case: str, digest: str, part: str, rollouts: str = "") -> bytes:
        if not part.isdecimal():
            raise ResourceNotFoundError(f"a part is a number from 0, got {part!r}")
        with explaining():
            return views.part(case, _ids(rollouts), digest, int(part))


def _ids(text: str) -> tuple[str, ...]:
    return tuple(part for part in text.split(",") if part)


def _about(data: bytes) -> dict[str, Any]:
    return {"digest": _digest(data), "bytes": len(data), "parts": -(-len(data) // PART)}


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
