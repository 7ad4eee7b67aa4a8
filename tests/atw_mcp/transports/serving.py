"""The HTTP server as `atw-mcp serve --http` sets it up, in a thread of the test's process."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mcp.server.auth.provider import TokenVerifier

from atw_mcp.server import build_server
from atw_mcp.transports.guard import Guard
from atw_mcp.transports.limits import HTTP_LIMITS, LIMITS, HttpLimits, WireLimits
from atw_mcp.transports.stores import StoreFiles, StoreRouter
from atw_mcp.transports.web import web_server


@contextmanager
def served(
    store: Path, *, tokens: TokenVerifier | None = None, limits: HttpLimits = HTTP_LIMITS, wire: WireLimits = LIMITS
) -> Iterator[tuple[str, StoreRouter]]:
    """Yield the address of the server and its router."""
    router = StoreRouter(build_server, StoreFiles(store), limits=limits)
    guard = Guard(router.application(), verifier=tokens, limits=limits, wire=wire)
    running = web_server(guard, limits)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=running.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        deadline = time.monotonic() + 20
        while not running.started:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        try:
            yield f"http://127.0.0.1:{listening.getsockname()[1]}/mcp", router
        finally:
            running.should_exit = True
            thread.join(20)
            assert not thread.is_alive()


def initialize(identifier: int = 1) -> dict[str, Any]:
    """Return the opening request of the handshake era."""
    hello = {"protocolVersion": "2025-11-25", "clientInfo": {"name": "t", "version": "1"}, "capabilities": {}}
    return {"jsonrpc": "2.0", "id": identifier, "method": "initialize", "params": hello}
