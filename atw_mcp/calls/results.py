"""Results that tools return, and the form in which an agent receives them."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import CallToolResult, ContentBlock, ImageContent, ResourceLink, TextContent
from pydantic import ValidationError

from atw_mcp.calls.error_text import LIMITS, and_more, short_repr, without_middle
from evidence_store import Evidence, Status, StoreError, to_json

ROOM = 4_500  # characters of a result: about 1,500 tokens, at the 3 characters a token that results of tools have
WIDE = 40_000  # characters of one whose length was asked for: about 13k tokens, below the 25k that clients cut at
SHORT = 4  # numbers: a list of so few is a vector, which is never cut
NAMED_AT_MOST = 10  # damaged records named in a summary
MOST_NAMES = 40  # of objects listed beside the data; the resource has all
DIGITS = 6  # significant digits shown; the evidence keeps all of them


@dataclass(frozen=True)
class Answer:
    """The result of one tool call, before it is recorded.

    summary: one or two sentences an agent can act on. data: the whole result, JSON-ready except that numpy
    values and NaN are allowed (NaN becomes null). shown: what the agent sees where the whole is too much;
    default data. whole: not to be cut to `ROOM`, which would spoil a schema. The rest is provenance: what the
    result was computed from and what it covers.
    pictures: encoded image files by name ("overlay.png").
    record: id of a stored result that keeps the numbers behind them, which agents are not shown.
    """

    summary: str
    data: dict[str, Any]
    shown: dict[str, Any] | None = None
    whole: bool = False
    case: str | None = None
    world: str | None = None
    rollout: str | None = None
    observation: str | None = None
    objects: tuple[str, ...] = ()
    interval: tuple[float, float] | None = None
    status: Status = "completed"
    pictures: dict[str, bytes] = field(default_factory=dict)
    record: str | None = None

    def to_evidence(self, tool: str, arguments: dict[str, Any]) -> Evidence:
        """The record of this answer, as yet without an id."""
        return Evidence(
            tool=tool,
            arguments=plain(arguments),
            case=self.case,
            world=self.world,
            rollout=self.rollout,
            observation=self.observation,
            objects=self.objects,
            interval=self.interval,
            status=self.status,
            summary=self.summary,
            payload={
                "data": plain(self.data),
                "shown": None if self.shown is None else plain(self.shown),
                **({"whole": True} if self.whole else {}),
                **({} if self.record is None else {"record": self.record}),
            },
            pictures=self.pictures,
        )


def to_result(evidence: Evidence, *, whole: bool = False) -> CallToolResult:
    """A record as MCP content: compact JSON in both places, or JSON text and pictures without structured content.

    Long lists are cut to `ROOM`, or to `WIDE` where the caller gave a limit. whole: all the data, up to `WIDE`.
    Some clients drop pictures when structured content is present, so a result with pictures has none.
    """
    whole = whole or evidence.payload.get("whole", False)
    shown = None if whole else evidence.payload.get("shown")
    cut = shown is not None
    names = list(evidence.objects[:MOST_NAMES])
    most = WIDE if whole or evidence.arguments.get("limit") is not None else ROOM
    data, shortened = fit_to_room(rounded(shown if cut else evidence.payload.get("data", {})), room(evidence, most))
    body: dict[str, Any] = {
        "evidence": evidence.id or None,
        "tool": evidence.tool,
        "status": evidence.status,
        "summary": evidence.summary,
        "case": evidence.case,
        "source": {"world": evidence.world, "rollout": evidence.rollout, "observation": evidence.observation},
        "objects": names,
        "interval": None if evidence.interval is None else rounded(list(evidence.interval)),
        "data": data,
    }
    content: list[ContentBlock] = []
    if shortened:
        body["shortened"] = shortened
    if (cut or shortened or len(evidence.objects) > MOST_NAMES) and evidence.id:
        body["resource"] = f"atw://evidence/{evidence.id}"
        content.append(
            ResourceLink(
                type="resource_link",
                uri=body["resource"],
                name=evidence.id,
                description=f"the whole result of {evidence.tool}",
                mime_type="application/json",
            )
        )
    if (
        evidence.rollout is not None and isinstance(data, dict) and data.get("rollout") == evidence.rollout
    ):  # made by it
        content.append(
            ResourceLink(
                type="resource_link",
                uri=f"atw://rollouts/{evidence.rollout}/trajectory.csv",
                name="trajectories",
                mime_type="text/csv",
            )
        )
    text = json.dumps(body, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    content.insert(0, TextContent(type="text", text=text))
    for name, picture in evidence.pictures.items():
        kind = "image/png" if name.endswith(".png") else "image/jpeg"
        content.append(ImageContent(type="image", data=base64.b64encode(picture).decode(), mime_type=kind))
    return CallToolResult(content=content, structured_content=None if evidence.pictures else body)


def room(evidence: Evidence, most: int = ROOM) -> int:
    """Return how many characters the data of a record may take, of so many for the result: the rest is said beside."""
    return most - len(evidence.summary) - len(to_json(list(evidence.objects[:MOST_NAMES])))


def plain(value: Any) -> Any:
    """JSON-ready copy of nested values: numpy to Python, tuples to lists, NaN and infinity to None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int | bool):
        return value
    if hasattr(value, "model_dump"):
        return plain(value.model_dump(mode="json"))
    raise TypeError(f"a result cannot hold a {type(value).__name__}")


def rounded(value: Any) -> Any:
    """The same JSON with numbers to `DIGITS` significant digits."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    return value


def fit_to_room(data: dict[str, Any], most: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The data with its longest lists cut until their JSON fits, and which lists were cut: path, shown, of."""
    cut: dict[str, dict[str, Any]] = {}
    while (excess := len(to_json(data)) - most) > 0:
        lists = [(len(to_json(items)), path, items) for path, items in _lists(data, "") if len(items) > 1]
        if not lists:
            break
        size, path, longest = max(lists, key=lambda found: found[0])
        whole = cut.get(path, {"of": len(longest)})["of"]
        share = max(0.5, 1.0 - excess / size)  # at most a half at once: another list may be the longest then
        keep = max(1, min(len(longest) - 1, int(share * len(longest))))
        data = _replaced(data, path.split("."), longest[:keep])
        cut[path] = {"path": path, "shown": keep, "of": whole}
    return data, [cut[path] for path in sorted(cut)]


def _lists(value: Any, path: str) -> Iterator[tuple[str, list[Any]]]:
    if isinstance(value, list) and not (len(value) <= SHORT and all(isinstance(item, int | float) for item in value)):
        yield path, value
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from _lists(item, f"{path}.{key}" if path else str(key))


def _replaced(value: Any, path: list[str], new: Any) -> Any:
    if not path:
        return new
    if isinstance(value, dict):
        return {key: _replaced(item, path[1:], new) if key == path[0] else item for key, item in value.items()}
    return [_replaced(item, path[1:], new) if str(index) == path[0] else item for index, item in enumerate(value)]


@contextmanager
def explained(next_step: str = "") -> Iterator[None]:
    """Hand the message of a refusal (KeyError, ValueError, StoreError) to the agent, with what to call next.

    Wrap only calls whose messages are written for a reader: a bug's KeyError must not look like advice.
    """
    try:
        yield
    except ValidationError as error:
        raise ToolError(_sentence(validation_text(error), next_step)) from error
    except (KeyError, ValueError, StoreError, OSError) as error:
        text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
        raise ToolError(_sentence(text, next_step)) from error


def damage_note(damaged: list[str]) -> str:
    """Name the damaged records that a listing leaves out, as the end of a summary; empty where there are none."""
    if not damaged:
        return ""
    more = f" and {len(damaged) - NAMED_AT_MOST} more" if len(damaged) > NAMED_AT_MOST else ""
    named = ", ".join(damaged[:NAMED_AT_MOST])
    return f"; damaged in the store and left out: {named}{more} (`atw-mcp doctor` lists what is damaged)"


def validation_text(error: ValidationError) -> str:
    """pydantic's findings, one clause each: where, what, and the value that was given; the first few and a count."""
    clauses = []
    findings = error.errors(include_url=False, include_context=False)
    for found in findings[: LIMITS.findings]:
        where = without_middle(".".join(str(part) for part in found["loc"]), LIMITS.place)
        given = "" if found["type"] in ("missing", "extra_forbidden") else f" (got {short_repr(found['input'])})"
        message = {"missing": "is required", "extra_forbidden": "is not known"}.get(
            found["type"], found["msg"].removeprefix("Value error, ")
        )
        clauses.append(f"{where}: {message}{given}" if where else f"{message}")
    return "; ".join(clauses) + and_more(len(findings) - len(clauses))


def _sentence(text: str, next_step: str) -> str:
    return f"{text.rstrip('.')}. Next: {next_step}" if next_step else text
