"""The pages of `atw-mcp view`: a list of cases; for each its page, its document, film, changes, and notes in it."""

from __future__ import annotations

import asyncio
import html
import json
import re
import sqlite3
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response, StreamingResponse
from starlette.routing import Route

from atw_mcp.viewer.live.content import CaseFollower, LiveContent
from atw_mcp.viewer.live.notes import Note, keep
from atw_mcp.viewer.page import live_page
from evidence_store import Case, EvidenceStore, StoreError, UnknownRecord

LOOK = 0.5  # [s] between two looks at the store, which work reports to once a second
SILENCE = 15.0  # [s] after which a stream without changes is sent a comment, so that one whose reader is gone ends
THREADS = 2  # that read the store, each with a connection of its own
RANGE = re.compile(r"bytes=(\d*)-(\d*)")
POLICY = re.compile(r'http-equiv="Content-Security-Policy" content="([^"]*)"')
LIST_STYLE = """
:root { color-scheme: light dark; font: 0.875rem/1.5 system-ui, sans-serif; }
body { max-width: 60rem; margin: 2rem auto; padding: 0 1rem; background: light-dark(#f3f5f7, #0e1115);
  color: light-dark(#14181d, #e9edf1); }
h1 { font-size: 1.25rem; }
ul { display: grid; gap: 0.5rem; margin: 0; padding: 0; list-style: none; }
li { padding: 0.5rem 0.75rem; border: 1px solid light-dark(#d9dee4, #2b323b); border-radius: 6px;
  background: light-dark(#ffffff, #171b21); overflow-wrap: anywhere; }
a { color: light-dark(#00659e, #62b9ec); font-weight: 650; }
small { display: block; color: light-dark(#4a5460, #a9b3be); }
"""
Result = TypeVar("Result")


class Site:
    """An ASGI application over a store; `close` ends its threads."""

    def __init__(self, store: EvidenceStore) -> None:
        self._content = LiveContent(store)
        self._threads = ThreadPoolExecutor(THREADS, "view")
        self._page = live_page()
        self._policy = f"{POLICY.findall(self._page)[0]}; frame-ancestors 'none'"
        self.app = Starlette(
            routes=[
                Route("/", self._list),
                Route("/{case:path}/document", self._document),
                Route("/{case:path}/film", self._film),
                Route("/{case:path}/changes", self._changes),
                Route("/{case:path}/notes", self._note, methods=["POST"]),
                Route("/{case:path}/", self._case),
            ],
            exception_handlers={UnknownRecord: _not_found, StoreError: _unreadable},
        )
        self.app.router.redirect_slashes = False

    def close(self) -> None:
        """End the threads that read the store."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _run(self, read: Callable[[], Result]) -> Result:
        return await asyncio.get_running_loop().run_in_executor(self._threads, read)

    async def _list(self, _: Request) -> Response:
        store = self._content.store
        rows = await self._run(lambda: [_row(store, case) for case in reversed(store.cases.all())])
        cases = "".join(rows) or "<li>This store has no case yet.</li>"
        title = f"Cases in {html.escape(store.path.name)}"
        return HTMLResponse(
            f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
            f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{LIST_STYLE}</style>'
            f"<h1>{title}</h1><ul>{cases}</ul></html>"
        )

    async def _case(self, request: Request) -> Response:
        case = _name(request)
        await self._run(lambda: self._content.store.cases.get(case))
        return HTMLResponse(self._page, headers={"Content-Security-Policy": self._policy})

    async def _document(self, request: Request) -> Response:
        case = _name(request)
        revision, data = await self._run(lambda: self._content.document(case))
        return Response(data, media_type="application/octet-stream", headers={"ETag": f'"{revision}"'})

    async def _film(self, request: Request) -> Response:
        case = _name(request)
        played = await self._run(lambda: self._content.film(case))
        if played.film is None:
            raise HTTPException(404, played.missing or "this case has no video")
        first, last, status = _range(request.headers.get("range"), len(played.data))
        headers = {"Accept-Ranges": "bytes"}
        if status == 206:
            headers["Content-Range"] = f"bytes {first}-{last}/{len(played.data)}"
        return Response(played.data[first : last + 1], status, headers, played.film.mime)

    async def _changes(self, request: Request) -> Response:
        case = _name(request)
        await self._run(lambda: self._content.store.cases.get(case))
        return StreamingResponse(self._events(case), media_type="text/event-stream")

    async def _note(self, request: Request) -> Response:
        case, body = _name(request), await request.body()
        try:
            note = Note.model_validate_json(body)
        except ValueError as error:
            raise HTTPException(422, str(error)) from error
        return Response(await self._run(lambda: keep(self._content.store.path, case, note)), 201)

    async def _events(self, case: str) -> AsyncIterator[str]:
        """Yield an event now and at each change: the revision of the case's records, and the work under way."""
        follower = CaseFollower(self._content, case)
        silent, gone = 0.0, False
        try:
            while True:
                was, gone = gone, await self._run(follower.gone)
                if gone != was:
                    said = {"gone": str(self._content.store.path) if gone else ""}
                    yield f"event: store\ndata: {json.dumps(said)}\n\n"
                try:
                    state = await self._run(follower.look)
                except (StoreError, sqlite3.Error):  # busy, or gone: the next look decides
                    state = None
                if state is not None:
                    yield f"event: state\ndata: {json.dumps(state, separators=(',', ':'))}\n\n"
                    silent = 0.0
                elif silent >= SILENCE:
                    yield ": nothing new\n\n"
                    silent = 0.0
                await asyncio.sleep(LOOK)
                silent += LOOK
        finally:
            follower.close()


def _name(request: Request) -> str:
    return str(request.path_params["case"])


def _row(store: EvidenceStore, case: Case) -> str:
    asked = store.cases.questions(case.id)
    counts = ("world", len(store.cases.worlds(case.id))), ("answer", len(store.cases.answers(case.id)))
    said = ", ".join(f"{count} {name}{'' if count == 1 else 's'}" for name, count in counts)
    file = case.path.replace("\\", "/").rsplit("/", 1)[-1]
    about = "; ".join(part for part in (file, said, asked[0] if asked else "") if part)
    return (
        f'<li><a href="{quote(case.id, safe="")}/">{html.escape(case.id)}</a><small>{html.escape(about)}</small></li>'
    )


def _range(header: str | None, size: int) -> tuple[int, int, int]:
    """Return the first and the last byte that are asked for, and the status; raises HTTPException for others."""
    asked = RANGE.fullmatch(header or "")
    if asked is None or asked.groups() == ("", ""):  # none, or several ranges: all of it is a valid reply
        return 0, size - 1, 200
    begin, end = asked.groups()
    first = int(begin) if begin else max(size - int(end), 0)
    last = min(int(end), size - 1) if begin and end else size - 1
    if not first <= last:
        raise HTTPException(416, "the film is shorter", {"Content-Range": f"bytes */{size}"})
    return first, last, 206


def _not_found(_: Request, error: Exception) -> Response:
    return Response(str(error), 404, media_type="text/plain")


def _unreadable(_: Request, error: Exception) -> Response:
    return Response(str(error), 503, media_type="text/plain")


def address(token: str, port: int, case: str | None) -> str:
    """Return the address of the list of cases or of one case."""
    return f"http://127.0.0.1:{port}/{token}/" + ("" if case is None else f"{quote(case, safe='')}/")
