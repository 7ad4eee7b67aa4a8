"""Errors of resources, which say to clients what is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mcp.server.mcpserver.exceptions import ResourceError, ResourceNotFoundError, ToolError

from evidence_store import StoreError, UnknownRecord


@contextmanager
def explaining() -> Iterator[None]:
    """Turn refusals into errors of resources that say what is wrong."""
    try:
        yield
    except (UnknownRecord, ToolError) as error:
        raise ResourceNotFoundError(str(error)) from error
    except (StoreError, ValueError) as error:
        raise ResourceError(str(error)) from error
