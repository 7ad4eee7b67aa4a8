"""Fixtures of all tests of the server and its front doors."""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from atw_mcp import server_process
from atw_mcp.calls import result_schemas
from atw_mcp.calls.files import VARIABLE
from atw_mcp.tools import observation
from tests.atw_mcp.observed_once import shared
from tests.atw_mcp.session import Session, server_in_this_process
from tests.real_data import FOLDER

# Files of tests lie where pytest makes them, and measured data beside the repository.
os.environ.setdefault(VARIABLE, os.pathsep.join([tempfile.gettempdir(), str(FOLDER)]))


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A session on a store of its own."""
    return Session(tmp_path / "atw.db")


@pytest.fixture(scope="session", autouse=True)
def observed_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Share observations of the tools among all tests, over the workers of a run too."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "observed"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as replaced:
        for function in (observation.observe, observation.observe_known):
            replaced.setattr(observation, function.__name__, shared(function, folder))
        yield


@pytest.fixture
def server_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the client's own server run in this process: another one needs seconds to start."""
    monkeypatch.setattr(server_process, "started", server_in_this_process)


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
