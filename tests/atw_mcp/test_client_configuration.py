"""Configurations printed for MCP clients: JSON in the client's form, whose command starts a server."""

from __future__ import annotations

import json
import os
import subprocess
import tomllib
from pathlib import Path

import pytest

from atw_mcp.cli import main
from atw_mcp.client_configuration import FORMS, NAME, configuration, write


@pytest.mark.parametrize("client", sorted(FORMS))
def test_configuration_is_printed_as_json_with_its_place_on_stderr(
    capfd: pytest.CaptureFixture[str], client: str
) -> None:
    assert main(["config", client, "--allow", "clips", "--allow", "/data", "--store", "a.db"]) == 0
    out, err = capfd.readouterr()
    entry = (tomllib.loads if client == "codex" else json.loads)(out)[FORMS[client].key][NAME]
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


def test_writing_keeps_what_the_file_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / ".vscode" / "mcp.json"
    assert write("vscode", [Path("clips")]) == file
    held = json.loads(file.read_text())
    file.write_text(json.dumps({"inputs": [1], "servers": {**held["servers"], "other": {"command": "x"}}}))
    file.chmod(0o600)
    write("vscode")
    now = json.loads(file.read_text())
    assert os.name != "posix" or file.stat().st_mode & 0o777 == 0o600
    assert now["inputs"] == [1]
    assert now["servers"]["other"] == {"command": "x"}
    assert now["servers"][NAME] == configuration("vscode")["servers"][NAME]


@pytest.mark.parametrize(("client", "content"), [("claude-code", "{ // servers\n}"), ("claude-code", "[]")])
def test_a_file_that_cannot_be_read_is_left_as_it_is(
    client: str, content: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / FORMS[client].place
    file.write_text(content)
    assert main(["config", client, "--write"]) == 1
    assert file.read_text() == content
    assert "by hand" in capfd.readouterr().err


def test_claude_code_is_given_a_command_line(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "claude-code", "--allow", "/data"]) == 0
    assert f"claude mcp add --scope user {NAME} -- " in capfd.readouterr().err


def test_an_unknown_client_is_refused_with_those_known(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["config", "emacs"])
    assert "claude-desktop" in capfd.readouterr().err
