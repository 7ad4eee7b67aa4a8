"""The server over real pipes: lines that are no messages, and how its process ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from evidence_store import EvidenceStore
from tests.atw_mcp.connections import REPOSITORY

ENVELOPE = {
    "io.modelcontextprotocol/protocolVersion": "2026-07-28",
    "io.modelcontextprotocol/clientInfo": {"name": "test", "version": "1"},
    "io.modelcontextprotocol/clientCapabilities": {},
}
HELLO = {
    "protocolVersion": "2025-11-25",
    "clientInfo": {"name": "test", "version": "1"},
    "capabilities": {},
}


class Pipes:
    """A server process, spoken to line by line."""

    def __init__(self, store: Path, *, modern: bool, **options: Any) -> None:
        self.modern = modern
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.atw_mcp.stdio_process", str(store)],
            cwd=REPOSITORY,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            **options,
        )

    def line(self, data: bytes) -> dict[str, Any]:
        """Send a line, return the next one."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(data + b"\n")
        self.process.stdin.flush()
        received: dict[str, Any] = json.loads(self.process.stdout.readline())
        return received

    def request(self, identifier: int, method: str, **params: Any) -> dict[str, Any]:
        if self.modern:
            params["_meta"] = ENVELOPE
        message = {"jsonrpc": "2.0", "id": identifier, "method": method, "params": params}
        return self.line(json.dumps(message).encode())

    def ended(self, seconds: float = 20.0) -> tuple[int, str]:
        """Exit code and stderr of the process once it has ended."""
        code = self.process.wait(seconds)
        assert self.process.stderr is not None
        return code, self.process.stderr.read().decode()


@contextmanager
def pipes(store: Path, *, modern: bool) -> Iterator[Pipes]:
    opened = Pipes(store, modern=modern)
    try:
        if not modern:
            assert "result" in opened.request(0, "initialize", **HELLO)
        yield opened
    finally:
        opened.process.kill()
        opened.process.wait()
        for stream in (opened.process.stdin, opened.process.stdout, opened.process.stderr):
            assert stream is not None
            with suppress(BrokenPipeError):
                stream.close()


@pytest.fixture
def store(tmp_path: Path) -> Path:
    created = EvidenceStore(tmp_path / "atw.db")
    created.cases.add("c", content="x", kind="data", path="/x", facts={})
    created.close()
    return created.path


def working(server: Pipes) -> None:
    """Begin work that takes a minute, whose record is ev-1."""
    call = {"case": "c", "seconds": 60, "patience_seconds": 0.1}
    started = server.request(1, "tools/call", name="WorkSlowly", arguments=call)
    assert json.loads(started["result"]["content"][0]["text"])["status"] == "running"


def left_in_order(store: Path) -> None:
    """The work is recorded as ended, and the file holds everything."""
    assert [path.name for path in store.parent.iterdir()] == [store.name]
    assert EvidenceStore(store).evidence.get("ev-1").status in ("cancelled", "failed")


# Lines are answered before the era matters, so the default run pays for one process.
@pytest.mark.parametrize("modern", [True, pytest.param(False, marks=pytest.mark.benchmark)])
def test_a_line_that_is_no_message_is_answered_and_the_server_goes_on(store: Path, modern: bool) -> None:
    with pipes(store, modern=modern) as server:
        for line, code, identifier in (
            (b'{"jsonrpc": "2.0", "id": 11, "method": "tools/li', -32700, 11),
            (b'{"jsonrpc": "2.0", "id": 12, "method": "\\ud800"}', -32700, 12),
            (b'{"jsonrpc": "2.0", "id": 13, "method": "\xff\xfe"}', -32700, 13),
            (b'[{"jsonrpc": "2.0", "id": 14, "method": "ping"}]', -32600, None),
            (b"[" * 50_000, -32700, None),
            (b'{"jsonrpc": "2.0", "id": 15, "method": "' + b"x" * 9_000_000 + b'"}', -32600, 15),
        ):
            reply = server.line(line)
            assert (reply["error"]["code"], reply["id"]) == (code, identifier)
        working(server)
        if modern:
            server.process.send_signal(signal.SIGTERM)
            assert server.ended() == (128 + signal.SIGTERM, "")
        else:
            assert server.process.stdin is not None
            server.process.stdin.close()
            assert server.ended() == (0, "")
    left_in_order(store)


@pytest.mark.benchmark  # another process of seconds; test_ending.py has the same in little
@pytest.mark.skipif(os.name != "posix", reason="sends signals")
def test_a_stuck_call_does_not_keep_the_process_from_ending(store: Path) -> None:
    with pipes(store, modern=True) as server:
        working(server)
        assert server.process.stdin is not None
        call = {"name": "BlockThread", "arguments": {"seconds": 60}, "_meta": ENVELOPE}
        message = {"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": call}
        server.process.stdin.write(json.dumps(message).encode() + b"\n")
        server.process.stdin.flush()
        time.sleep(0.5)
        server.process.send_signal(signal.SIGINT)
        code, said = server.ended()
        assert code == 128 + signal.SIGINT
        assert "Traceback" not in said
    left_in_order(store)
