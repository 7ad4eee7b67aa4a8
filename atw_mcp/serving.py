"""Serving over stdio, and one server over streamable HTTP, in both protocol eras or only in the older one."""

from __future__ import annotations

import asyncio
from typing import Any

import anyio
from mcp.server import MCPServer
from mcp.server.runner import serve_dual_era_loop, serve_loop
from mcp_types.version import HANDSHAKE_PROTOCOL_VERSIONS
from starlette.types import ASGIApp, Receive, Scope, Send

from atw_mcp.calls.app import App
from atw_mcp.transports.ending import ending_in_order
from atw_mcp.transports.guard import Guard
from atw_mcp.transports.lines import stdio_streams
from atw_mcp.transports.stores import PATH, unsupported


def serve_stdio(server: MCPServer[App], *, legacy_only: bool = False) -> int:
    """Serve one client over stdin and stdout until it leaves or a signal ends the process; returns the exit code.

    legacy_only: speak only the handshake-era revisions. For clients that probe the newer era and then
    initialize in the older one, which a connection whose era is settled by its first request refuses.
    """
    return anyio.run(_serve_stdio, server, legacy_only)


async def _serve_stdio(server: MCPServer[App], legacy_only: bool) -> int:
    lowlevel = server._lowlevel_server  # the SDK has no public way to choose the era of a stdio connection
    serve: Any = serve_loop if legacy_only else serve_dual_era_loop
    loop, serving = asyncio.get_running_loop(), anyio.CancelScope()
    with ending_in_order(lambda: loop.call_soon_threadsafe(serving.cancel)) as ending:
        async with lowlevel.lifespan(lowlevel) as app:
            ending.last_resort = app.close
            with serving:
                async with stdio_streams(on_end=ending.begin) as (incoming, outgoing):
                    options = lowlevel.create_initialization_options()
                    await serve(lowlevel, incoming, outgoing, lifespan_state=app, init_options=options)
        await anyio.to_thread.run_sync(app.close)
    return ending.exit_code


def http_app(server: MCPServer[App], *, legacy_only: bool = False) -> ASGIApp:
    """Return the ASGI application of one server, whose store all clients at /mcp share; for tests and embedding.

    `atw-mcp serve --http` gives clients stores of their own: see `atw_mcp.transports.stores`.
    """
    app = server.streamable_http_app(streamable_http_path=PATH)
    return Guard(HandshakeOnly(app) if legacy_only else app)


class HandshakeOnly:
    """Refuses requests of the newer era with the versions that are served, so that clients fall back."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI connection."""
        asked = dict(scope.get("headers", ())).get(b"mcp-protocol-version", b"").decode("latin-1")
        if scope["type"] == "http" and asked and asked not in HANDSHAKE_PROTOCOL_VERSIONS:
            raise unsupported(f"this server was started with --legacy-only and does not speak {asked}", asked)
        await self._app(scope, receive, send)
