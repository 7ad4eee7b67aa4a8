"""Roots of the client: folders that it says its user works in, and that may therefore be read."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

import anyio
from mcp.server.mcpserver.context import Context
from mcp.shared.exceptions import MCPDeprecationWarning

from atw_mcp.calls.app import App

PATIENCE = 5.0  # [s] for a client to list its roots
logger = logging.getLogger(__name__)


async def allow_roots(app: App, context: Context[App, Any]) -> None:
    """Allow the client's roots; asked for again by every call that names a file, as they may change.

    Only a client of the handshake era that runs this process itself, over stdio, is asked: what a client over HTTP
    says of this machine's folders is no permission.
    """
    capabilities = context.client_capabilities
    if context.request_context.request is not None or capabilities is None or capabilities.roots is None:
        return
    try:
        with anyio.fail_after(PATIENCE), warnings.catch_warnings():
            warnings.simplefilter("ignore", MCPDeprecationWarning)
            listed = await context.session.list_roots()
    except Exception as error:  # whatever the client answered, its roots are not known
        logger.warning("the client's roots could not be listed: %s", error)
        return
    app.files.set_roots(path for root in listed.roots if (path := local_path(str(root.uri))) is not None)


def local_path(uri: str) -> Path | None:
    """Return the path of a file URI of this machine, None for any other."""
    parts = urlsplit(uri)
    if parts.scheme != "file" or parts.netloc not in ("", "localhost"):
        return None
    return Path(url2pathname(parts.path))
