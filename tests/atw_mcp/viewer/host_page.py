"""A host page for MCP Apps: `host/host.ts`, bundled with the ext-apps package when a test asks for it.

npm install --prefix tests/atw_mcp/viewer/host
python -m pytest -m benchmark tests/atw_mcp/viewer/test_app_in_host.py
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from mcp.server import MCPServer
from starlette.responses import HTMLResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from atw_mcp.serving import http_app
from tests.atw_mcp.connections import on_loopback

FOLDER = Path(__file__).parent / "host"
# What the specification has hosts allow an app that declares no domains.
POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
    "img-src 'self' data:; font-src 'self'; media-src 'self' data:; frame-src 'none'; object-src 'none'; "
    "base-uri 'self'"
)


def bundled() -> str:
    """Return the script of the host page; skips the test where Node.js or the packages are not installed."""
    node = shutil.which("node")
    if node is None or not (FOLDER / "node_modules" / "@modelcontextprotocol" / "ext-apps").exists():
        pytest.skip(f"the host page's packages are not installed: npm install --prefix {FOLDER}")
    script = "import { build } from 'esbuild'; const made = await build({ entryPoints: ['host.ts'], bundle: true, "
    script += "write: false, format: 'iife', target: 'es2022' }); process.stdout.write(made.outputFiles[0].text)"
    command = [node, "--input-type=module", "-e", script]
    return subprocess.run(command, cwd=FOLDER, capture_output=True, text=True, check=True).stdout


@contextmanager
def hosting(server: MCPServer[Any], script: str) -> Iterator[tuple[str, str]]:
    """Serve a server and the host page; yields the addresses of that page and, of another origin, of its sandbox."""
    with on_loopback(_Pages(http_app(server), script)) as url:
        port = url.rsplit(":", 1)[1]
        yield f"{url}/host.html", f"http://localhost:{port}/sandbox.html"


class _Pages:
    """The host page and its sandbox; all else goes to the MCP server."""

    def __init__(self, app: ASGIApp, script: str) -> None:
        self._app = app
        inside = script.replace("</script", "<\\/script")
        page = f'<!doctype html><meta charset="utf-8"><title>Host</title><script type="module">{inside}</script>'
        sandbox = (FOLDER / "sandbox.html").read_text(encoding="utf-8")
        self._pages = {
            "/host.html": HTMLResponse(page),
            "/sandbox.html": HTMLResponse(sandbox, headers={"content-security-policy": POLICY}),
            "/favicon.ico": HTMLResponse("", status_code=204),
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one ASGI connection."""
        page = self._pages.get(scope.get("path", "")) if scope["type"] == "http" else None
        await (page or self._app)(scope, receive, send)
