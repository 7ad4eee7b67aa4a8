"""Serve the live page of `atw-mcp view` until a signal ends the process."""

from __future__ import annotations

import os
import secrets
import socket
import sys
import threading
import webbrowser
from pathlib import Path

from atw_mcp.transports.web import serve_web
from atw_mcp.viewer.live.access import Access
from atw_mcp.viewer.live.site import Site, address
from evidence_store import EvidenceStore

TOKEN_BYTES = 16  # 128 bits


def view(store: Path, case: str | None, port: int, *, browser: bool) -> int:
    """Serve until a signal ends the process; returns the exit code.

    Prints the address as its last line. port: 0 for any that is free. browser: open the page, where there is a display.
    Raises StoreError for a store or a case that cannot be shown, OSError for a port that is taken, FileNotFoundError
    where the page was never built.
    """
    opened = EvidenceStore.to_read(store)
    try:
        if case is not None:
            opened.cases.get(case)
        site = Site(opened)
        listening = socket.create_server(("127.0.0.1", port))
        token = secrets.token_urlsafe(TOKEN_BYTES)
        where = address(token, listening.getsockname()[1], case)
        print(
            f"following {opened.path}; whoever has this address can read it and leave notes, Ctrl-C ends it:\n{where}",
            flush=True,
        )
        if browser and has_display():
            threading.Thread(target=webbrowser.open, args=(where,), daemon=True).start()
        try:
            code = serve_web(Access(site.app, token, listening.getsockname()[1]), listening, opened.close)
        finally:
            site.close()
        return code
    finally:
        opened.close()


def has_display() -> bool:
    """Return whether a browser with a window can be opened here."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
