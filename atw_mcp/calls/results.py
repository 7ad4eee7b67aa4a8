"""Results that tools return, and the form in which an agent receives them."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import CallToolResult, ContentBlock, ImageContent, ResourceLink, TextContent
from pydantic import ValidationError

from atw_mcp.calls.error_text import LIMITS, and_more, short_repr, without_middle
from evidence_store import Evidence, Status, StoreError, to_json

ROOM = 40_000  # characters of JSON an agent is shown at once: about 15k tokens, below the 25k that clients cut at
NAMED_AT_MOST = 10  # damaged records named in a summary
DIGITS = 6  # significant digits shown; the evidence keeps all of them


@dataclass(frozen=True)
class Answer:
    """The result of one tool call, before it is recorded.

    summary: one or two sentences an agent can act on. data: the whole result, JSON-ready except that numpy
    values and NaN are allowed (NaN becomes null). shown: what the agent sees where the whole is too much;
    default data. The rest is provenance: what the result was computed from and what it covers.
    pictures: encoded image files by name ("overlay.png").
    """

    summary: str
    data: dict[str, Any]
    shown: dict[str, Any] | None = None
    case: str | None = None
    world: str | None = None
    rollout: str | None = None
    observation: str | None = None
    objects: tuple[str, ...] = ()
    interval: tuple[float, float] | None = None
    status: Status = "completed"
    pictures: dict[str, bytes] = field(default_factory=dict)

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
            payload={"data": plain(self.data), "shown": None if self.shown is None else plain(self.shown)},
            pictures=self.pictures,
        )


def to_result(evidence: Evidence) -> CallToolResult:
    """A record as MCP content: compact JSON in both places, or JSON text and pictures without structured content.

    Some clients drop pictures when structured content is present, so a result with pictures has none.
    """
    shown = evidence.payload.get("shown")
    cut = shown is not None
    data, shortened = fit_to_room(rounded(shown if cut else evidence.payload.get("data", {})))
    body: dict[str, Any] = {
        "evidence": evidence.id or None,
        "tool": evidence.tool,
        "status": evidence.status,
        "summary": evidence.summary,
        "case": evidence.case,
        "source": {"world": evidence.world, "rollout": evidence.rollout, "observation": evidence.observation},
        "objects": list(evidence.objects),
        "interval": None if evidence.interval is None else rounded(list(evidence.interval)),
        "data": data,
    }
    content: list[ContentBlock] = []
    if shortened:
        body["shortened"] = shortened
    if (cut or shortened) and evidence.id:
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
    text = json.dumps(body, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    content.insert(0, TextContent(type="text", text=text))
    for name, picture in evidence.pictures.items():
        kind = "image/png" if name.endswith(".png") else "image/jpeg"
        content.append(ImageContent(type="image", data=base64.b64encode(picture).decode(), mime_type=kind))
    return CallToolResult(content=content, structured_content=None if evidence.pictures else body)


def page(evidence: Evidence, path: str, cursor: int, limit: int) -> Evidence:
    """The record with only the part of its data at `path`; of a list, `limit` items from `cursor` on.

    Raises ToolError naming the parts there are.
    """
    part: Any = evidence.payload.get("data", {})
    walked: list[str] = []
    for step in path.split("."):
        keys = [
            str(key) for key in (part if isinstance(part, dict) else range(len(part) if isinstance(part, list) else 0))
        ]
        if step not in keys:
            there = f"{keys[0]}..{keys[-1]}" if isinstance(part, list) and keys else keys
            where = f"{evidence.id} at {'.'.join(walked)!r}" if walked else evidence.id
            raise ToolError(f"{where} has no part {step!r}; parts: {there}")
        part = part[step] if isinstance(part, dict) else part[int(step)]
        walked.append(step)
    data: dict[str, Any] = {"path": path, "value": part}
    if isinstance(part, list):
        rest = cursor + limit if cursor + limit < len(part) else None
        data = {"path": path, "value": part[cursor : cursor + limit], "next_cursor": rest, "of": len(part)}
    return replace(evidence, payload={"data": data}, pictures={})


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


def fit_to_room(data: dict[str, Any], room: int = ROOM) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The data with its longest lists cut until their JSON fits, and which lists were cut: path, shown, of."""
    cut: dict[str, dict[str, Any]] = {}
    while len(to_json(data)) > room:
        path, longest = max(_lists(data, ""), key=lambda found: len(to_json(found[1])) * (len(found[1]) > 1))
        if len(longest) <= 1:
            break
        whole = cut.get(path, {"of": len(longest)})["of"]
        keep = max(1, len(longest) // 2)
        data = _replaced(data, path.split("."), longest[:keep])
        cut[path] = {"path": path, "shown": keep, "of": whole}
    return data, [cut[path] for path in sorted(cut)]


def _lists(value: Any, path: str) -> Iterator[tuple[str, list[Any]]]:
    if isinstance(value, list):
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
