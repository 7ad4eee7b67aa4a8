"""Who may read the live page and leave notes in it: whoever has its address, from this machine, and from this page."""

from __future__ import annotations

import hmac

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

NAMES = ("127.0.0.1", "localhost")
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Frame-Options": "DENY",
}
MOST_BYTES = 10_000  # of a note
POLICY = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"


class Access:
    """Passes on requests to read what lies below /TOKEN/, and notes for it, with the token removed; refuses all others.

    A page of another site that has its name resolve to this machine (DNS rebinding) still sends that name as Host. The
    token is in no other place than the address, which `no-referrer` keeps from other sites. A note comes from a page of
    this origin, which browsers say of every request that writes, and as JSON, which forms of other sites cannot send.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app, self._token = app, token.encode()
        self._hosts = {f"{name}:{port}" for name in NAMES}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
                headers.setdefault("Content-Security-Policy", f"{POLICY}; frame-ancestors 'none'")
            await send(message)

        refusal = self._refusal(scope)
        if refusal is not None:
            await refusal(scope, receive, guarded)
            return
        _, _, path = scope["path"].removeprefix("/").partition("/")
        await self._app({**scope, "path": f"/{path}", "raw_path": None}, receive, guarded)

    def _refusal(self, scope: Scope) -> PlainTextResponse | None:
        headers = Headers(scope=scope)
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if host not in self._hosts:
            return PlainTextResponse("this page is reached under its own address only", 403)
        if origin is not None and origin.lower().removeprefix("http://") not in self._hosts:
            return PlainTextResponse("pages of other origins may not read this one", 403)
        if scope["method"] == "POST" and scope["path"].endswith("/notes"):
            if origin is None or headers.get("content-type", "") != "application/json":
                return PlainTextResponse("notes are written in the page itself", 403)
            if not 0 < int(headers.get("content-length") or 0) <= MOST_BYTES:
                return PlainTextResponse(f"a note has at most {MOST_BYTES} bytes", 413)
        elif scope["method"] not in ("GET", "HEAD"):
            return PlainTextResponse("this page can only be read", 405, {"Allow": "GET, HEAD"})
        given, slash, _ = scope["path"].removeprefix("/").partition("/")
        if not slash or not hmac.compare_digest(given.encode("utf-8", "surrogatepass"), self._token):
            return PlainTextResponse("there is nothing at this address", 404)
        return None
