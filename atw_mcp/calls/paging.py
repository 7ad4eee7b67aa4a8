"""Parts of a stored result: at a path, some fields of it, some items of a list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.calls.results import room, rounded
from evidence_store import Evidence, to_json

PLACE = 100  # characters of a page beside its path and items: where it is in the list
MOST_ITEMS = 1000  # of a list on one page


def part_of(
    evidence: Evidence, path: str | None, fields: Sequence[str] | None, cursor: int, limit: int | None
) -> Evidence:
    """Return the record with only the part of its data at `path`, only `fields` of that, and no pictures.

    Of a list, `limit` items from `cursor` on; default as many as an agent is shown at once, at least one. Raises
    ToolError naming the parts or the fields there are.
    """
    part = _at(evidence, path)
    if fields is not None:
        part = _with_fields(part, fields, f"{evidence.id}{f' at {path!r}' if path else ''}")
    if path is None:
        data = part
    elif isinstance(part, list):
        left = room(evidence) - PLACE - len(path)
        shown = part[cursor : cursor + limit] if limit is not None else fitting(part[cursor:], left)
        end = cursor + len(shown)
        data = {"path": path, "value": shown, "next_cursor": end if end < len(part) else None, "of": len(part)}
    else:
        data = {"path": path, "value": part}
    # A limit that was asked for holds, whatever room the items take.
    return replace(evidence, arguments={} if limit is None else {"limit": limit}, payload={"data": data}, pictures={})


def fitting(items: list[Any], left: int) -> list[Any]:
    """Return the first items that fit in so many characters; at least one."""
    count = 0
    for item in items[:MOST_ITEMS]:
        left -= len(to_json(rounded(item))) + 1
        if left < 0 and count:
            break
        count += 1
    return items[:count]


def _at(evidence: Evidence, path: str | None) -> Any:
    part: Any = evidence.payload.get("data", {})
    walked: list[str] = []
    for step in path.split(".") if path is not None else ():
        keys = [
            str(key) for key in (part if isinstance(part, dict) else range(len(part) if isinstance(part, list) else 0))
        ]
        if step not in keys:
            there = f"{keys[0]}..{keys[-1]}" if isinstance(part, list) and keys else keys
            where = f"{evidence.id} at {'.'.join(walked)!r}" if walked else evidence.id
            raise ToolError(f"{where} has no part {step!r}; parts: {there}")
        part = part[step] if isinstance(part, dict) else part[int(step)]
        walked.append(step)
    return part


def _with_fields(part: Any, fields: Sequence[str], where: str) -> Any:
    """Some fields of an object, of each object of a list, or some columns of a table (`columns` and `rows`)."""
    if isinstance(part, list) and all(isinstance(item, dict) for item in part):
        _check(fields, list(dict.fromkeys(key for item in part for key in item)), where)
        return [{key: item[key] for key in fields if key in item} for item in part]
    if not isinstance(part, dict):
        raise ToolError(f"{where} has no fields: leave fields out")
    columns = part.get("columns")
    if isinstance(columns, list) and "rows" in part and set(fields) <= set(columns):
        places = [columns.index(name) for name in fields]
        return {**part, "columns": list(fields), "rows": [[row[place] for place in places] for row in part["rows"]]}
    _check(fields, list(part), where)
    return {key: part[key] for key in fields}


def _check(fields: Sequence[str], known: Sequence[str], where: str) -> None:
    unknown = [name for name in fields if name not in known]
    if unknown:
        raise ToolError(f"{where} has no field {', '.join(unknown)}; fields: {', '.join(known)}")
