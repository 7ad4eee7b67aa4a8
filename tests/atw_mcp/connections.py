"""The ways a client can reach the server, so that tests can run over all of them."""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import uvicorn
from mcp import Client, StdioServerParameters
from mcp.server import MCPServer
from starlette.types import ASGIApp

from atw_mcp.server import build_server
from atw_mcp.serving import http_app

REPOSITORY = Path(__file__).parents[2]
TRANSPORTS = ("memory", "stdio", "http")
Mode = Literal["auto", "legacy"]


@contextmanager
def connection(
    transport: str, store: Path, mode: Mode, *, legacy_only: bool = False, **options: Any
) -> Iterator[Client]:
    """A client of a server on `store`, not yet entered. options: of the client."""
    if transport == "memory":
        yield Client(build_server(store), mode=mode, **options)
    elif transport == "stdio":
        yield Client(stdio_parameters(store, *(["--legacy-only"] if legacy_only else [])), mode=mode, **options)
    else:
        with served_over_http(build_server(store), legacy_only=legacy_only) as url:
            yield Client(url, mode=mode, **options)


def stdio_parameters(store: Path, *options: str) -> StdioServerParameters:
    """How to start this server as a child process. The SDK strips the environment, so it is given."""
    return StdioServerParameters(
        command=sys.executable,
        args=["-m", "tests.atw_mcp.stdio_process", str(store), *options],
        cwd=str(REPOSITORY),
        env=dict(os.environ),
    )


@contextmanager
def served_over_http(server: MCPServer[Any], *, legacy_only: bool = False) -> Iterator[str]:
    """The server on a free loopback port; yields its address."""
    with on_loopback(http_app(server, legacy_only=legacy_only)) as url:
        yield f"{url}/mcp"


@contextmanager
def on_loopback(app: ASGIApp) -> Iterator[str]:
    """An application on a free loopback port; yields the address of its root, without a slash."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    config = uvicorn.Config(app, host="127.0.0.1", port=port, log_level="error")
    running = uvicorn.Server(config)
    thread = threading.Thread(target=running.run, daemon=True)
    thread.start()
    deadline = time.monotonic() + 20
    while not running.started:
        if time.monotonic() > deadline:
            raise TimeoutError("the HTTP server did not start")
        time.sleep(0.02)
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        running.should_exit = True
        thread.join(10)
