"""A server that a command starts: spoken to over its pipes, and gone when the command is."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from atw_mcp.replies import Reply, ServerLost
from atw_mcp.server_process import started
from atw_mcp.sessions import call_tool


def test_a_server_answers_and_ends_with_its_client(tmp_path: Path) -> None:
    shown: list[Reply] = []
    with started(tmp_path / "atw.db") as server:
        assert call_tool(server, "OpenCase", {}, shown.append)
    assert [reply.body["summary"] for reply in shown] == ["0 cases"]
    assert server.exit_code == 0


def test_a_server_that_dies_is_lost_instead_of_waited_for(tmp_path: Path) -> None:
    with started(tmp_path / "atw.db") as server:
        os.kill(server.pid, signal.SIGKILL)
        with pytest.raises(ServerLost):
            call_tool(server, "OpenCase", {}, lambda _: None)


def test_interrupted_command_leaves_no_server_behind(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "atw_mcp", "shell", "--store", str(tmp_path / "atw.db")]
    client = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # tests in a shell's background ignore it
    )
    assert client.stdin is not None
    assert client.stdout is not None
    client.stdin.write(b"OpenCase\n")
    client.stdin.flush()
    assert client.stdout.readline()
    children = Path(f"/proc/{client.pid}/task/{client.pid}/children")
    if not children.exists():
        pytest.skip("only Linux lists the children of a process")
    server = int(children.read_text().split()[0])
    client.send_signal(signal.SIGINT)
    assert client.wait(30) == 130
    deadline = time.monotonic() + 10
    while Path(f"/proc/{server}").exists():
        assert time.monotonic() < deadline, "the server still runs"
        time.sleep(0.05)
