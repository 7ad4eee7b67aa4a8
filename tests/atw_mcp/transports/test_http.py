"""HTTP from a client's side: who is let in, how much a request may take, and what a stalled one costs."""

from __future__ import annotations

import os
import socket
import time
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import httpx2
import pytest

from atw_mcp.cli import main
from atw_mcp.transports.limits import HTTP_LIMITS, LIMITS
from atw_mcp.transports.tokens import TokenError, Tokens, read_tokens
from tests.atw_mcp.transports.serving import initialize, served

ACCEPT = {"accept": "application/json, text/event-stream"}
ANNA, BEN = "a" * 32, "b" * 32


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "::"])
def test_without_a_token_only_loopback_is_listened_on(
    host: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ATW_MCP_TOKEN", raising=False)
    assert main(["serve", "--http", "--host", host, "--store", str(tmp_path / "atw.db")]) == 2
    assert "--token-file" in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def test_tokens_come_from_a_private_file_or_the_environment(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    assert read_tokens(None, {}) is None
    assert read_tokens(None, {"ATW_MCP_TOKEN": ANNA}) is not None
    for text, wrong in (
        ("short", "16"),
        ("", "no token"),
        (f"anna {ANNA}\nanna {BEN}", "line 2"),
        (f"an/na {ANNA}", "line 1"),
        (f"anna {ANNA} x", "line 1"),
    ):
        file.write_text(text)
        file.chmod(0o600)
        with pytest.raises(TokenError, match=wrong) as refused:
            read_tokens(file)
        assert ANNA not in str(refused.value)
    file.write_text(f"# who\nanna {ANNA}\nben {BEN}  # a friend\n")
    assert read_tokens(file) is not None
    if os.name == "posix":
        file.chmod(0o644)
        with pytest.raises(TokenError, match="chmod 600"):
            read_tokens(file)


def test_only_a_valid_token_a_known_host_and_a_known_origin_are_let_in(tmp_path: Path) -> None:
    with served(tmp_path / "atw.db", tokens=Tokens({ANNA: "anna"})) as (url, _):

        def status(address: str = url, **headers: str) -> httpx2.Response:
            given = {"authorization": f"Bearer {ANNA}", **ACCEPT, **headers}
            kept = {name: value for name, value in given.items() if value}
            return httpx2.post(address, json=initialize(), headers=kept)

        assert status().status_code == 200
        for missing in ("", "Basic YTpi", f"Bearer {BEN}", "Bearer", f"Bearer {ANNA}{ANNA}"):
            refused = status(authorization=missing)
            assert refused.status_code == 401
            assert refused.headers["www-authenticate"].startswith("Bearer")
        for path in ("/", "/mcp/x", "/openapi.json"):
            assert status(url.removesuffix("/mcp") + path, authorization="").status_code == 401
        health = httpx2.get(url.removesuffix("/mcp") + "/health", headers={"host": "10.0.0.7"})
        assert health.json() == {"status": "ok"}
        assert status(host="evil.example").status_code == 421
        assert status(host="127.0.0.1.evil.example").status_code == 421
        assert status(origin="https://evil.example").status_code == 403
        assert status(origin="null").status_code == 403
        assert status(origin="http://localhost:6274").status_code == 200


def test_a_body_beyond_the_limit_or_that_is_no_message_is_refused(tmp_path: Path) -> None:
    with served(tmp_path / "atw.db", wire=replace(LIMITS, message_bytes=2000)) as (url, _):

        def chunks() -> object:
            for _ in range(100):
                yield b"x" * 100

        assert httpx2.post(url, content=b"x" * 3000, headers=ACCEPT).status_code == 413
        assert httpx2.post(url, content=chunks(), headers=ACCEPT).status_code == 413
        for body, code in ((b'{"jsonrpc"', -32700), (b"[" * 1900, -32700), (b"[]", -32600), (b"\xff", -32700)):
            refused = httpx2.post(url, content=body, headers=ACCEPT)
            assert (refused.status_code, refused.json()["error"]["code"]) == (400, code)


def test_stalled_requests_are_closed_and_leave_room_for_others(tmp_path: Path) -> None:
    limits = replace(HTTP_LIMITS, bodies=30, body_seconds=0.6, header_seconds=0.6)
    with served(tmp_path / "atw.db", limits=limits) as (url, _):
        place = urlsplit(url)
        head = f"POST /mcp HTTP/1.1\r\nHost: {place.netloc}\r\n"
        stalled = []
        for number in range(60):
            connection = socket.create_connection((str(place.hostname), int(place.port or 0)), timeout=10)
            # Half of them send no body, the others not even all headers.
            connection.sendall((head + ("Content-Length: 900\r\n\r\n{" if number % 2 else "X-Slow: ")).encode())
            stalled.append(connection)
        time.sleep(0.2)
        busy = httpx2.post(url, json=initialize(), headers=ACCEPT)
        assert busy.status_code == 503
        assert int(busy.headers["retry-after"]) > 0
        answers = [_until_closed(connection) for connection in stalled]
        assert [answer.split(b"\r\n")[0] for answer in answers[1::2]] == [b"HTTP/1.1 408 Request Timeout"] * 30
        assert answers[0::2] == [b""] * 30
        assert httpx2.post(url, json=initialize(), headers=ACCEPT).status_code == 200


def test_more_requests_at_once_than_allowed_are_asked_to_come_later(tmp_path: Path) -> None:
    with served(tmp_path / "atw.db", limits=replace(HTTP_LIMITS, streams=1)) as (url, _):
        opened = httpx2.post(url, json=initialize(), headers=ACCEPT)
        session = {**ACCEPT, "mcp-session-id": opened.headers["mcp-session-id"]}
        with httpx2.stream("GET", url, headers=session) as stream:
            assert stream.status_code == 200
            busy = httpx2.get(url, headers=session)
            assert (busy.status_code, busy.headers["retry-after"]) == (503, "2")


def _until_closed(connection: socket.socket) -> bytes:
    received = b""
    with connection:
        while chunk := connection.recv(4096):
            received += chunk
    return received
