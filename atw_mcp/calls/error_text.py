"""Errors of a bounded size: what reaches a client says what is wrong and not all that was given."""

from __future__ import annotations

import re
import reprlib
from dataclasses import dataclass
from typing import Any

from mcp.server.context import CallNext, HandlerResult, ServerRequestContext
from mcp.shared.exceptions import MCPError


@dataclass(frozen=True)
class ErrorLimits:
    """Sizes of the parts of an error, in characters unless said otherwise."""

    text: int = 4000  # about 1,000 tokens: enough for every refusal that lists the valid choices of a real case
    quoted: int = 160  # of one value that is quoted in a text that is too long
    given: int = 80  # of one value that failed validation
    place: int = 200  # of the path to such a value
    findings: int = 8  # values that failed validation, of which a caller corrects one kind at a time
    listed: int = 40  # items of one list in a text that is too long


LIMITS = ErrorLimits()
_LONG = LIMITS.quoted * 2  # a value a little above the limit is left: the note would save little
_QUOTED = re.compile(rf"'[^'\n]{{{_LONG},}}'|\"[^\"\n]{{{_LONG},}}\"")
_WORD = re.compile(rf"\S{{{_LONG},}}")
_LIST = re.compile(r"\[[^\[\]]*\]")
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxdict = 3, 12, 6
_SHORT.maxstring = _SHORT.maxother = LIMITS.given


def shortened(text: str, most: int = LIMITS.text) -> str:
    """Return the text, at most `most` characters long.

    A longer one loses the middle of long values and the rest of long lists, each with the count of what was left
    out; where that is not enough, its own middle.
    """
    if len(text) <= most:
        return text
    text = _LIST.sub(_shortened_list, text)
    text = _QUOTED.sub(lambda found: without_middle(found[0], LIMITS.quoted), text)
    text = _WORD.sub(lambda found: without_middle(found[0], LIMITS.quoted), text)
    return without_middle(text, most)


def without_middle(text: str, most: int) -> str:
    """Return the text, its middle replaced by the count of what was left out where it is longer than `most`."""
    if len(text) <= most:
        return text
    note = f"... ({len(text) - most:,} characters left out) ..."
    room = max(0, most - len(note))
    tail = room // 3  # an error's end says what to do next, its beginning what is wrong
    return text[: room - tail] + note + text[len(text) - tail :]


def short_repr(value: Any) -> str:
    """Return a value as Python writes it, shortened without writing all of it first."""
    text = _SHORT.repr(value)
    return text if len(text) <= LIMITS.given else text[: LIMITS.given - 3] + "..."


def and_more(left_out: int) -> str:
    """Return the end of an enumeration that was cut, or nothing."""
    return f"; and {left_out:,} more" if left_out > 0 else ""


async def bounded_errors(ctx: ServerRequestContext[Any, Any], call_next: CallNext) -> HandlerResult:
    """Shorten the errors of every request (middleware): those of the protocol, and results that say isError."""
    try:
        result = await call_next(ctx)
    except MCPError as error:
        raise MCPError(error.code, shortened(error.message), _bounded(error.data)) from error
    if isinstance(result, dict) and result.get("isError"):
        for block in result.get("content", []):
            if block.get("type") == "text":
                block["text"] = shortened(block["text"])
    return result


def _bounded(data: Any) -> Any:
    if isinstance(data, str):
        return without_middle(data, LIMITS.quoted)
    if isinstance(data, dict):
        return {without_middle(str(key), LIMITS.quoted): _bounded(data[key]) for key in list(data)[: LIMITS.listed]}
    if isinstance(data, list):
        return [_bounded(item) for item in data[: LIMITS.listed]]
    return data


def _shortened_list(found: re.Match[str]) -> str:
    items = found[0][1:-1].split(", ")
    left_out = len(items) - LIMITS.listed
    return found[0] if left_out <= 0 else f"[{', '.join(items[: LIMITS.listed])}, and {left_out:,} more]"
