"""The MCP Inspector over the real server on HTTP: strict about schemas, every list, and many calls at once."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator

import pytest

from tests.outside.http_server import serving
from tests.outside.node_tools import node_environment


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    node_environment()
    folder = tmp_path_factory.mktemp("inspector")
    options = ["serve", "--http", "--store", str(folder / "atw.db"), "--port"]
    with serving("atw_mcp", options, folder) as address:
        yield f"{address}/judged"  # a named store, which clients of both eras reach


def inspected(url: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = ["mcp-inspector", "--cli", url, "--transport", "http", *arguments]
    return subprocess.run(command, env=node_environment(), capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("era", ["modern", "legacy"])
def test_every_schema_is_portable(url: str, era: str) -> None:
    done = inspected(url, "--protocol-era", era, "--method", "tools/list", "--strict")
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["tools"]) > 12


@pytest.mark.parametrize(
    ("era", "listed"), [("modern", "resources"), ("legacy", "resourceTemplates"), ("modern", "prompts")]
)
def test_lists_are_read(url: str, era: str, listed: str) -> None:
    method = "resources/templates" if listed == "resourceTemplates" else listed
    done = inspected(url, "--protocol-era", era, "--method", f"{method}/list")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)[listed]


def test_many_calls_at_once_have_no_error(url: str) -> None:
    load = ("--load", "--load-requests", "40", "--load-concurrency", "20")
    done = inspected(url, "--method", "tools/call", "--tool-name", "OpenCase", *load)
    assert done.returncode == 0, done.stderr
    counted = json.loads(done.stdout)
    assert (counted["ok"], counted["errors"], counted["toolErrors"]) == (40, 0, 0)
