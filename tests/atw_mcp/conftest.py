"""Fixtures of all tests of the server and its front doors."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import nullcontext

import pytest

from atw_mcp import server_process
from atw_mcp.calls import result_schemas
from atw_mcp.server import build_server


@pytest.fixture
def server_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the client's own server run in this process: another one needs seconds to start."""
    monkeypatch.setattr(server_process, "started", lambda store: nullcontext(build_server(store)))


@pytest.fixture(autouse=True)
def results_as_declared() -> Iterator[None]:
    """Fail a test in which a tool of this process returned what its output schema does not allow."""
    mismatches: list[str] = []

    class Collecting(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            mismatches.append(record.getMessage())

    handler = Collecting(logging.ERROR)
    result_schemas.logger.addHandler(handler)
    try:
        yield
    finally:
        result_schemas.logger.removeHandler(handler)
    assert not mismatches
