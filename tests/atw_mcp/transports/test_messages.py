"""Lines of a client that are no messages are refused with an error that says why, with their id where it is legible."""

from __future__ import annotations

import json

import pytest
from mcp_types import JSONRPCNotification, JSONRPCRequest, JSONRPCResponse

from atw_mcp.transports.lines import LineReader
from atw_mcp.transports.messages import NotAMessage, encoded, read_message, readable_id


@pytest.mark.parametrize(
    ("line", "code", "identifier"),
    [
        (b'{"jsonrpc": "2.0", "id": 4, "method": "ping"', -32700, 4),
        (b'{"jsonrpc": "2.0", "id": 4', -32700, None),  # perhaps the beginning of 42
        (b'{"method": "a\\ud800", "jsonrpc": "2.0", "id": "x-1"}', -32700, "x-1"),
        (b'{"jsonrpc": "2.0", "id": "\\ud800", "method": "ping"}', -32700, None),
        (b'{"jsonrpc": "2.0", "id": 5, "method": "\xff"}', -32700, 5),
        (b'{"jsonrpc": "2.0", "id": 6, "method": "a", "params": ' + b'{"a":' * 3000 + b"1" + b"}" * 3001, -32700, 6),
        (b"[" * 100_000, -32700, None),
        (b"Content-Length: 20", -32700, None),
        (b'[{"jsonrpc": "2.0", "id": 7, "method": "ping"}]', -32600, None),
        (b"5", -32600, None),
        (b'"ping"', -32600, None),
        (b'{"jsonrpc": "2.0", "id": null, "method": "ping"}', -32600, None),
        (b'{"jsonrpc": "2.0", "id": 1.5, "method": "ping"}', -32600, None),
        (b'{"jsonrpc": "2.0", "id": 8, "method": "ping", "params": [1]}', -32600, 8),
        (b'{"jsonrpc": "2.0", "id": 9}', -32600, 9),
        (b'{"params": {"id": 1}, "id": 10, "method": "ping"}', -32600, 10),
    ],
)
def test_bytes_that_are_no_message_are_refused(line: bytes, code: int, identifier: int | str | None) -> None:
    with pytest.raises(NotAMessage) as refused:
        read_message(line)
    assert refused.value.reply.error.code == code
    assert refused.value.reply.id == identifier
    assert json.loads(encoded(refused.value.reply))["id"] == identifier


def test_messages_of_every_kind_are_read() -> None:
    assert isinstance(read_message(b'{"jsonrpc": "2.0", "id": 1, "method": "ping"}'), JSONRPCRequest)
    assert isinstance(read_message(b'{"jsonrpc": "2.0", "id": 1, "result": {}}'), JSONRPCResponse)
    note = read_message(
        b'{"jsonrpc": "2.0", "method": "notifications/cancelled", "params": {"id": 3, "x": "\xc3\xbc"}}'
    )
    assert isinstance(note, JSONRPCNotification)


def test_the_id_is_that_of_the_message_and_not_of_a_part() -> None:
    assert readable_id('{"params": {"id": 1, "a": [{"id": 2}]}, "x": "\\"id\\": 3", "id": 4, "method": "') == 4
    assert readable_id('{"params": {"id": 1, ') is None


def test_a_reply_that_json_cannot_carry_becomes_an_error_of_its_id() -> None:
    reply = json.loads(encoded(JSONRPCResponse(jsonrpc="2.0", id=3, result={"path": "caf\udce9.mp4"})))
    assert (reply["id"], reply["error"]["code"]) == (3, -32603)


def test_lines_are_split_wherever_the_chunks_end() -> None:
    reader = LineReader(most=10)
    fed = [list(reader.feed(chunk)) for chunk in (b"ab", b"c\nde\n\n \r\nf", b"g", b"\n", b"h", b"")]
    assert fed == [[], [b"abc", b"de"], [], [b"fg"], [], [b"h"]]


def test_a_line_beyond_the_limit_is_refused_once_and_kept_out_of_memory() -> None:
    reader = LineReader(most=40)
    start = list(reader.feed(b'{"jsonrpc": "2.0", "id": 7, "method": "' + b"x" * 100))
    assert [type(part) for part in start] == [NotAMessage]
    assert isinstance(start[0], NotAMessage)
    assert start[0].reply.id == 7
    for _ in range(100):
        assert list(reader.feed(b"x" * 1000)) == []
    assert len(reader._line) == 0
    assert list(reader.feed(b'"}\nnext\n')) == [b"next"]
