"""Fixtures of all tests of the server and its front doors."""

from __future__ import annotations

import pytest

from atw_mcp import client
from atw_mcp.server import build_server


@pytest.fixture
def server_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the client's own server run in this process: another one needs seconds to start."""
    monkeypatch.setattr(client, "server_process", build_server)
    monkeypatch.setattr(client, "stdio_client", lambda server, errlog: server)  # noqa: ARG005
