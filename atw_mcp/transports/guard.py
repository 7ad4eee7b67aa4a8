"""Checks of every HTTP request before the server sees it: where it comes from, whose it is, how much it takes."""

from __future__ import annotations

import ipaddress
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import anyio
from mcp.server.auth.middleware.bearer_auth import AuthenticatedUser
from mcp.server.auth.provider import TokenVerifier
from mcp_types import INTERNAL_ERROR, INVALID_REQUEST, ErrorData, JSONRPCError
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from atw_mcp.transports.limits import HTTP_LIMITS, LIMITS, HttpLimits, WireLimits
from atw_mcp.transports.messages import NotAMessage, encoded, read_message

LOOPBACK = ("127.0.0.1", "localhost", "::1")
HEALTH = "/health"  # answered to everybody: probes know neither a name of the server nor a token
METHOD = "atw.method"  # key of the scope: the JSON-RPC method of a request that passed


class Refused(Exception):
    """A request that is refused: an HTTP status, the sentence that says why, headers, and the JSON-RPC error."""

    def __init__(
        self, status: int, reason: str, *, headers: Mapping[str, str] | None = None, code: int = 0, data: Any = None
    ) -> None:
        super().__init__(reason)
        self.status = status
        self.headers = headers or {}
        code = code or (INTERNAL_ERROR if status >= 500 else INVALID_REQUEST)
        error = ErrorData(code=code, message=reason, **({} if data is None else {"data": data}))
        self.reply = JSONRPCError(jsonrpc="2.0", id=None, error=error)


class Guard:
    """Lets through requests that name an allowed host, carry a token where one is needed, and keep the limits.

    hosts, origins: allowed besides those of loopback. verifier: knows the tokens; None lets everybody in.
    challenge: parameters of WWW-Authenticate. open_paths: prefixes of paths that need no token.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        hosts: Collection[str] = (),
        origins: Collection[str] = (),
        verifier: TokenVerifier | None = None,
        challenge: str = "",
        open_paths: tuple[str, ...] = (),
        wire: WireLimits = LIMITS,
        limits: HttpLimits = HTTP_LIMITS,
    ) -> None:
        self._app = app
        self._hosts = {*LOOPBACK, *(host.lower().strip("[]") for host in hosts)}
        self._origins = {origin.lower().rstrip("/") for origin in origins}
        self._verifier = verifier
        self._challenge = challenge
        self._open_paths = open_paths
        self._wire = wire
        self._limits = limits
        self._counts = {"requests": 0, "bodies": 0, "streams": 0}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        if scope["path"] == HEALTH:
            await _send(send, 200, b'{"status":"ok"}', {})
            return
        headers = Headers(scope=scope)
        try:
            self._check_origin(headers)
            scope = {**scope, **await self._client(scope["path"], headers)}
            with self._counted("streams" if scope["method"] == "GET" else "requests"):
                if scope["method"] == "POST":
                    body = await self._body(headers, receive)
                    if body is None:
                        return  # the client has gone
                    scope[METHOD] = getattr(read_message(body), "method", "")
                    receive = _replayed(body, receive)
                await self._app(scope, receive, send)
        except NotAMessage as refused:
            await respond(send, 400, refused.reply)
        except Refused as refused:
            # The rest of a body that is not read would be taken for the next request.
            await respond(send, refused.status, refused.reply, connection="close", **refused.headers)

    def _check_origin(self, headers: Headers) -> None:
        host = _hostname(f"//{headers.get('host', '')}")
        if host not in self._hosts:
            raise Refused(421, "this server does not answer for the host that was asked for: --allow-host HOST adds it")
        origin = headers.get("origin")
        if origin is None or origin.lower().rstrip("/") in self._origins or _hostname(origin) in self._hosts:
            return
        raise Refused(403, "pages of this origin may not call this server: --allow-origin ORIGIN adds it")

    async def _client(self, path: str, headers: Headers) -> dict[str, object]:
        if self._verifier is None or path.startswith(self._open_paths or ("\0",)):
            return {}
        scheme, _, token = headers.get("authorization", "").partition(" ")
        given = token.strip() if scheme.lower() == "bearer" else ""
        client = await self._verifier.verify_token(given) if given else None
        if client is None:
            wrong = 'error="invalid_token"' if given else ""
            challenge = ", ".join(part for part in ('Bearer realm="atw-mcp"', wrong, self._challenge) if part)
            reason = "the token is not valid" if given else "this server needs a token: Authorization: Bearer TOKEN"
            raise Refused(401, reason, headers={"www-authenticate": challenge})
        return {"user": AuthenticatedUser(client)}

    async def _body(self, headers: Headers, receive: Receive) -> bytes | None:
        most = self._wire.message_bytes
        declared = headers.get("content-length", "")
        if declared.isdecimal() and int(declared) > most:
            raise Refused(413, f"the message is longer than {most} bytes")
        body = bytearray()
        with self._counted("bodies"), anyio.move_on_after(self._limits.body_seconds):
            while True:
                message = await receive()
                if message["type"] != "http.request":
                    return None
                body += message.get("body", b"")
                if len(body) > most:
                    raise Refused(413, f"the message is longer than {most} bytes")
                if not message.get("more_body", False):
                    return bytes(body)
        raise Refused(408, f"the message did not arrive within {self._limits.body_seconds:g} s")

    @contextmanager
    def _counted(self, what: str) -> Iterator[None]:
        if self._counts[what] >= getattr(self._limits, what):
            wait = str(self._limits.retry_after_seconds)
            raise Refused(503, f"the server has as many {what} open as it takes", headers={"retry-after": wait})
        self._counts[what] += 1
        try:
            yield
        finally:
            self._counts[what] -= 1


async def respond(send: Send, status: int, error: JSONRPCError, **headers: str) -> None:
    """Send a JSON-RPC error as a whole HTTP response."""
    await _send(send, status, encoded(error), headers)


async def _send(send: Send, status: int, body: bytes, headers: Mapping[str, str]) -> None:
    named = {"content-type": "application/json", "content-length": str(len(body)), **headers}
    raw = [(name.encode(), value.encode()) for name, value in named.items()]
    await send({"type": "http.response.start", "status": status, "headers": raw})
    await send({"type": "http.response.body", "body": body})


def is_loopback(host: str) -> bool:
    """Return whether an address to listen on is reached from this machine only."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def _hostname(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


def _replayed(body: bytes, receive: Receive) -> Receive:
    first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def replay() -> Message:
        return first.pop() if first else await receive()

    return replay
