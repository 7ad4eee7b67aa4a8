"""Configurations printed for MCP clients: JSON in the client's form, whose command starts a server."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from atw_mcp.cli import main
from atw_mcp.client_configuration import FORMS, NAME, configuration


@pytest.mark.parametrize("client", sorted(FORMS))
def test_configuration_is_printed_as_json_with_its_place_on_stderr(
    capfd: pytest.CaptureFixture[str], client: str
) -> None:
    assert main(["config", client, "--allow", "clips", "--allow", "/data", "--store", "a.db"]) == 0
    out, err = capfd.readouterr()
    entry = json.loads(out)[FORMS[client].key][NAME]
    clips, store = str(Path.cwd() / "clips"), str(Path.cwd() / "a.db")
    assert entry["args"][2:] == ["serve", "--allow", clips, "--allow", "/data", "--store", store]
    assert FORMS[client].place in err


def test_the_command_of_a_configuration_starts_a_server_that_answers(tmp_path: Path) -> None:
    entry = configuration("claude-desktop", store=tmp_path / "atw.db")["mcpServers"][NAME]
    request = {
        "jsonrpc": "2.0",
        "id": 1,
        "method": "initialize",
        "params": {
            "protocolVersion": "2025-11-25",
            "capabilities": {},
            "clientInfo": {"name": "test", "version": "1"},
        },
    }
    finished = subprocess.run(
        [entry["command"], *entry["args"]],
        input=json.dumps(request) + "\n",
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert json.loads(finished.stdout.splitlines()[0])["result"]["serverInfo"]["name"] == NAME


def test_an_unknown_client_is_refused_with_those_known(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["config", "emacs"])
    assert "claude-desktop" in capfd.readouterr().err
