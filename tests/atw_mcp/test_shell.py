"""The shell as a script that is piped into it and a person at a terminal see it."""

from __future__ import annotations

import io
import json
import os
import pty
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest

from atw_mcp.cli import main
from atw_mcp.demo.truth import FOLDER

CLIP = str(FOLDER / "collision.mp4")


def piped(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, store: Path, text: str, *pairs: str
) -> tuple[int, list[str], str]:
    """Exit code, lines printed and stderr of a shell that reads `text` from a pipe."""
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    code = main(["shell", *pairs, "--store", str(store)])
    out, err = capfd.readouterr()
    return code, out.splitlines(), err


@pytest.mark.usefixtures("server_here")
def test_piped_calls_share_results_and_print_as_single_calls_do(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    text = (
        "# what is there?\n\n"
        "open: OpenCase video=$clip \\\n  questions='[\"Why?\"]'\n"
        "> the case is ${open.case}\n"
        "OpenCase case=$open.case\n"
        "ReadEvidence evidence=$last.evidence"
    )
    code, out, err = piped(capfd, monkeypatch, tmp_path / "a.db", text, f"clip={CLIP}")
    assert code == 0
    assert "atw>" not in "".join(out) + err
    first, second, third = map(json.loads, out)
    assert first["data"]["questions"] == ["Why?"]
    assert second["case"] == first["case"]
    assert third["evidence"] == second["evidence"]
    assert f"the case is {first['case']}" in err

    assert main(["call", "ReadEvidence", "evidence=ev-2", "--store", str(tmp_path / "a.db")]) == 0
    assert capfd.readouterr().out.strip() == out[2]


@pytest.mark.usefixtures("server_here")
def test_a_failed_line_is_named_and_the_next_one_runs(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    lines = [
        "OpenCase video=/no/such/film.mp4",
        "OpenKase",
        "OpenCase video",
        'OpenCase name="unfinished',
        "OpenCase case=$nothing.case",
        "tools OpenKase",
        "OpenCase",
        "exit",
        "OpenCase",
    ]
    code, out, err = piped(capfd, monkeypatch, tmp_path / "a.db", "\n".join(lines))
    assert code == 1
    assert [json.loads(line)["summary"] for line in out] == ["0 cases"]
    assert [line for line in err.splitlines() if not line.startswith("atw-mcp: ")] == []
    for complaint in ("--allow DIR", "did you mean 'OpenCase'?", "'video' is not key=value", "nothing is called"):
        assert complaint in err


@pytest.mark.usefixtures("server_here")
def test_help_and_tools_are_answered_without_a_call(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    code, out, _ = piped(capfd, monkeypatch, tmp_path / "a.db", "help\ntools\ntools CommitWorld\n")
    assert code == 0
    text = "\n".join(out)
    assert "Ctrl-D" in text
    assert any(line.startswith("Rollout  ") for line in out)
    assert "  case: required, text\n" in text
    assert "  world: text\n      id of the world every probe will start from" in text


def test_a_terminal_has_a_prompt_and_failures_do_not_fail_the_session(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    command = [sys.executable, "-m", "atw_mcp", "shell", "--store", str(tmp_path / "a.db")]
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path), "TERM": "dumb"}
    process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=environment)
    os.close(slave)
    try:
        shown = seen_until(master, "atw> ")
        os.write(master, b"OpenKase\n")
        shown = seen_until(master, "atw> ")
        assert "did you mean 'OpenCase'?" in shown
        os.write(master, b"OpenCase \\\n")
        assert "...> " in seen_until(master, "...> ")
        os.write(master, b"\n")
        assert '"summary":"0 cases"' in seen_until(master, "atw> ")
        os.write(master, b"\x04")
        assert process.wait(60) == 0
    finally:
        process.kill()
        os.close(master)
    assert (tmp_path / "atw-mcp" / "history").read_text().splitlines()[0] == "OpenKase"


def seen_until(terminal: int, text: str, seconds: float = 120.0) -> str:
    """What a terminal shows until `text` is at its end."""
    shown, deadline = "", time.monotonic() + seconds
    while not shown.endswith(text):
        ready, _, _ = select.select([terminal], [], [], max(0.0, deadline - time.monotonic()))
        assert ready, f"{text!r} was not shown: {shown}"
        shown += os.read(terminal, 65536).decode()
    return shown
