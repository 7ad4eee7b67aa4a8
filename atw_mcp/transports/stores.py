"""Which store a client of HTTP works on, so that clients see each other's cases only where they mean to.

A request to /mcp/NAME works on the store of that name, which everyone who knows the name shares. To /mcp comes
- a client with a token: it has a store of its own, by the name of its token, in both protocol eras;
- a client without one: each session of the handshake era has a store of its own, under a random name, by which
  /mcp/NAME reaches it later. A call of the stateless era carries nothing that says whose it is, so here it is
  answered with the revisions that have sessions, on which clients of both eras go on, and with the two ways above.
"""

from __future__ import annotations

import hashlib
import logging
import re
import secrets
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import anyio
import anyio.to_thread
from anyio.abc import TaskGroup, TaskStatus
from mcp.server import MCPServer
from mcp.server.auth.middleware.bearer_auth import AuthenticatedUser
from mcp.server.auth.provider import principal_components
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from mcp_types import UNSUPPORTED_PROTOCOL_VERSION
from mcp_types.version import HANDSHAKE_PROTOCOL_VERSIONS
from starlette.datastructures import Headers
from starlette.routing import BaseRoute, Route, Router
from starlette.types import Message, Receive, Scope, Send

from atw_mcp.calls.app import App
from atw_mcp.transports.guard import METHOD, Refused
from atw_mcp.transports.limits import HTTP_LIMITS, LIMITS, HttpLimits
from atw_mcp.transports.tokens import NAME

logger = logging.getLogger(__name__)

PATH = "/mcp"
SESSION, VERSION = "mcp-session-id", "mcp-protocol-version"
LOOK = 30.0  # [s] between looks for stores that are no longer used


class StoreFiles:
    """Where the stores are: the main one in `file`, which its stem names, all others in a folder beside it."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._folder = file.with_suffix(".stores")
        self.main = re.sub(r"[^A-Za-z0-9._-]", "-", file.stem).lstrip("._-") or "main"

    def named(self, name: str) -> Path:
        """Return the file of the store that everyone who knows its name shares."""
        return self._file if name == self.main else self._folder / "named" / f"{name}.db"

    def of_client(self, user: AuthenticatedUser) -> Path:
        """Return the file of an authenticated client's own store."""
        client, issuer, subject = principal_components(user.access_token)
        if issuer is None and subject is None and NAME.fullmatch(client):
            return self._folder / "clients" / f"{client}.db"
        who = "\n".join(part or "" for part in (issuer, subject, client))
        return self._folder / "principals" / f"{hashlib.sha256(who.encode()).hexdigest()[:32]}.db"


@dataclass
class _OpenStore:
    manager: StreamableHTTPSessionManager
    of_session: bool
    app: App | None = None
    requests: int = 0
    used: float = field(default_factory=time.monotonic)
    stop: anyio.Event = field(default_factory=anyio.Event)


class StoreRouter:
    """Serves each request by the server of its store (an ASGI endpoint), opening and closing servers as needed.

    build: makes the server of a store's file; raises StoreError where the file cannot be used.
    """

    def __init__(
        self,
        build: Callable[[Path], MCPServer[App]],
        files: StoreFiles,
        *,
        legacy_only: bool = False,
        limits: HttpLimits = HTTP_LIMITS,
    ) -> None:
        self._build = build
        self._files = files
        self._legacy_only = legacy_only
        self._limits = limits
        self._open: dict[Path, _OpenStore] = {}
        self._sessions: dict[str, Path] = {}  # of clients without a token at PATH
        self._opening = anyio.Lock()
        self._tasks: TaskGroup | None = None

    def application(self, *more: BaseRoute) -> Router:
        """Return the ASGI application of this router and more routes."""
        routes = [Route(PATH, endpoint=self), Route(PATH + "/{store}", endpoint=self), *more]
        return Router(routes, lifespan=self._running)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request; raises Refused where it names no store that it may use."""
        headers = Headers(scope=scope)
        version = headers.get(VERSION)
        modern = version is not None and version not in HANDSHAKE_PROTOCOL_VERSIONS
        if modern and self._legacy_only:
            raise unsupported(f"this server was started with --legacy-only and does not speak {version}", version)
        name, user = scope["path_params"].get("store"), scope.get("user")
        if name is not None:
            if not NAME.fullmatch(name):
                raise Refused(404, f"{PATH}/NAME needs a name of at most 64 letters, digits and ._-")
            await self._serve(self._files.named(name), scope, receive, send)
        elif isinstance(user, AuthenticatedUser):
            await self._serve(self._files.of_client(user), scope, receive, send)
        elif modern:
            raise unsupported(
                f"calls of {version} have no session, so that without a token nothing says whose cases they mean: "
                f"connect to {PATH}/NAME, which everyone who knows the name shares, or to a server with tokens",
                version,
            )
        else:
            await self._serve_session(headers.get(SESSION), scope, receive, send)

    async def _serve_session(self, session: str | None, scope: Scope, receive: Receive, send: Send) -> None:
        if session is not None:
            path = self._sessions.get(session)
            if path is None:
                raise Refused(404, "no such session: initialize again")
            await self._serve(path, scope, receive, send)
            return
        if scope.get(METHOD) != "initialize":
            raise Refused(400, "a request needs the Mcp-Session-Id that initialize returned")
        name = secrets.token_hex(16)
        path = self._files.named(name)

        async def send_and_note(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = Headers(raw=message["headers"]).get(SESSION)
                if given is not None:
                    self._sessions[given] = path
            await send(message)

        note = f" The cases of this session are its own; {PATH}/{name} on this server reaches them in a later one."
        await self._serve(path, scope, receive, send_and_note, note)

    async def _serve(self, path: Path, scope: Scope, receive: Receive, send: Send, note: str = "") -> None:
        store = await self._opened(path, note)
        store.requests += 1
        try:
            await store.manager.handle_request(scope, receive, send)
        finally:
            store.requests -= 1
            store.used = time.monotonic()

    async def _opened(self, path: Path, note: str) -> _OpenStore:
        async with self._opening:  # two servers on one file would not see each other's subscriptions
            if path in self._open:
                return self._open[path]
            if len(self._open) >= self._limits.stores:
                raise self._later(f"{len(self._open)} stores are open, as many as allowed")
            server = await anyio.to_thread.run_sync(self._build, path)
            lowlevel = server._lowlevel_server  # the SDK has no public way to one session manager a server
            lowlevel.instructions = (lowlevel.instructions or "") + note
            manager = StreamableHTTPSessionManager(
                app=lowlevel,
                max_request_body_size=LIMITS.message_bytes,
                session_idle_timeout=self._limits.session_seconds,
                max_sessions=self._limits.streams,
            )
            store = _OpenStore(manager, of_session=bool(note))
            assert self._tasks is not None
            await self._tasks.start(self._run, path, store)
            self._open[path] = store
            return store

    async def _run(self, path: Path, store: _OpenStore, *, task_status: TaskStatus[None]) -> None:
        lowlevel = store.manager.app
        try:
            async with lowlevel.lifespan(lowlevel) as app, store.manager.run():
                store.app = app
                task_status.started()
                await store.stop.wait()
        finally:
            self._open.pop(path, None)
            self._sessions = {session: of for session, of in self._sessions.items() if of != path}
            if store.app is not None:
                with anyio.CancelScope(shield=True):
                    await anyio.to_thread.run_sync(_close, store.app, store.of_session)

    def _later(self, reason: str) -> Refused:
        return Refused(503, reason, headers={"retry-after": str(self._limits.retry_after_seconds)})

    @asynccontextmanager
    async def _running(self, _: object) -> AsyncIterator[None]:
        async with anyio.create_task_group() as self._tasks:
            self._tasks.start_soon(self._close_unused)
            try:
                yield
            finally:
                self._tasks.cancel_scope.cancel()

    async def _close_unused(self) -> None:
        while True:
            await anyio.sleep(LOOK)
            # A session without a request for as long as this has ended, and later ones open the store again.
            limit = time.monotonic() - self._limits.session_seconds - LOOK
            for store in self._open.values():
                if store.requests == 0 and store.used < limit and (store.app is None or not store.app.jobs.busy):
                    store.stop.set()

    def close(self) -> None:
        """Close every store at once, where the process cannot end in order."""
        for store in list(self._open.values()):
            if store.app is not None:
                store.app.close()


def _close(app: App, of_session: bool) -> None:
    # Every client that connects once and asks nothing would leave a file behind.
    empty = of_session and not app.store.cases.all()
    app.close()
    if empty:
        app.store.path.unlink(missing_ok=True)


def unsupported(reason: str, asked: str | None) -> Refused:
    """Return the refusal of a protocol revision, which names those that are served so that clients fall back."""
    data = {"supported": list(HANDSHAKE_PROTOCOL_VERSIONS), "requested": asked}
    return Refused(400, reason, code=UNSUPPORTED_PROTOCOL_VERSION, data=data)
