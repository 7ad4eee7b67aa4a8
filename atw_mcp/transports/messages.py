"""One JSON-RPC message from bytes, or the error that answers bytes which are none."""

from __future__ import annotations

import json
import re
from typing import Any

from mcp_types import (
    INTERNAL_ERROR,
    INVALID_REQUEST,
    PARSE_ERROR,
    ErrorData,
    JSONRPCError,
    JSONRPCMessage,
    JSONRPCNotification,
    JSONRPCRequest,
    JSONRPCResponse,
    RequestId,
)
from pydantic import ValidationError
from pydantic_core import from_json

from atw_mcp.transports.limits import LIMITS

_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\]:,]|[^\s"{}\[\]:,]+', re.DOTALL)


class NotAMessage(Exception):
    """Bytes that are no JSON-RPC message. `reply` is the error that answers them."""

    def __init__(self, code: int, reason: str, line: bytes) -> None:
        super().__init__(reason)
        head = line[: LIMITS.id_search_characters].decode("utf-8", errors="replace")
        self.reply = JSONRPCError(jsonrpc="2.0", id=readable_id(head), error=ErrorData(code=code, message=reason))


def read_message(line: bytes) -> JSONRPCMessage:
    """Parse one JSON-RPC message.

    Raises NotAMessage: -32700 for bytes that are no JSON in UTF-8, -32600 for JSON that is no single message. The
    reply's id is the message's own where it can be read, else null.
    """
    try:
        text = line.decode("utf-8")
    except UnicodeDecodeError as error:
        raise NotAMessage(PARSE_ERROR, f"the message is not UTF-8 (byte {error.start})", line) from error
    try:
        value: Any = from_json(text)
    except ValueError as error:
        raise NotAMessage(PARSE_ERROR, f"the message is not valid JSON: {error}", line) from error
    if not isinstance(value, dict):
        batch = "batches are not served: send one message a line"
        raise NotAMessage(INVALID_REQUEST, batch if isinstance(value, list) else "a message is a JSON object", line)
    try:
        # By its keys: the SDK's union of all four reads a message four times, and an id that is none as no id at all.
        return _kind(value).model_validate(value, by_name=False)
    except ValidationError as error:
        raise NotAMessage(INVALID_REQUEST, _wrong(error), line) from error


def encoded(message: JSONRPCMessage) -> bytes:
    """Write a message as one line of JSON; one that JSON cannot hold becomes an internal error of the same id."""
    try:
        # An error's null id is set, so `exclude_unset` keeps it; parameters that were not given are left out.
        return message.model_dump_json(by_alias=True, exclude_unset=True).encode() + b"\n"
    except ValueError:  # pydantic's serialization error, as for text with a lone surrogate out of a file name
        identifier = getattr(message, "id", None)
        error = ErrorData(code=INTERNAL_ERROR, message="the reply holds text that JSON cannot carry")
        return JSONRPCError(jsonrpc="2.0", id=identifier, error=error).model_dump_json().encode() + b"\n"


def readable_id(text: str) -> RequestId | None:
    """Return the id at the top level of a JSON object that may be truncated or otherwise broken, else None."""
    depth, key, after_colon = 0, "", False
    for found in _TOKEN.finditer(text):
        token = found[0]
        if token in "{[":
            depth += 1
            if depth == 1 and token == "[":
                return None  # a batch has several ids
            after_colon = False
        elif token in "}]":
            depth -= 1
        elif depth != 1:
            continue
        elif token == ":":
            after_colon = True
        elif token == ",":
            key, after_colon = "", False
        elif not after_colon:
            key = token
        elif key == '"id"':
            complete = found.end() < len(text)  # 12 may be the beginning of 123
            return _id(token) if complete else None
    return None


def _id(token: str) -> RequestId | None:
    try:
        value: Any = json.loads(token)
    except ValueError:
        return None
    if isinstance(value, bool) or not isinstance(value, int | str):
        return None
    if isinstance(value, str) and any("\ud800" <= letter <= "\udfff" for letter in value):
        return None  # a lone surrogate cannot be written back
    return value


def _kind(value: dict[str, Any]) -> type[JSONRPCRequest | JSONRPCNotification | JSONRPCResponse | JSONRPCError]:
    if "method" in value or not value.keys() & {"result", "error"}:
        return JSONRPCRequest if "id" in value else JSONRPCNotification
    return JSONRPCResponse if "result" in value else JSONRPCError


def _wrong(error: ValidationError) -> str:
    fields = sorted({str(found["loc"][0]) for found in error.errors(include_url=False, include_input=False)})
    return (
        f"the object is no JSON-RPC 2.0 message ({', '.join(fields)}): it needs "
        '"jsonrpc": "2.0", "method" as text, "params" as an object, and for a request "id" as text or an integer'
    )
