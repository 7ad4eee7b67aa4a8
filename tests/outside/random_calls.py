"""Calls of every tool: valid ones, ones drawn from the published schemas, and valid ones with a part made hostile."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

from hypothesis import strategies as st

HOSTILE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63), 10**30, 0.5, -0.0, 1e-300, 1e300, 1.7e308,
    "", " ", "a", "discs", "..", "../../etc/passwd", "/etc/passwd", "/dev/zero", "/proc/self/environ", "file:///etc/passwd",
    "\u0000", "\ud7ff", "‮", "💥" * 50, "x" * 10_000, "ev-1", "ev-999999999", "ev--1", "'; DROP TABLE evidence; --",
    "{{7*7}}", "__import__('os').system('true')", "NaN", "1e999", "%s%s%n", "$ref", "objects.0", "a.b.c.d",
    [], [[]], [None], [0] * 3, [1e300] * 3, ["striker"] * 100, {}, {"": None}, {"action": 3}, {"action": "remove"},
    {"kind": []}, {"a": {"b": {"c": {"d": {}}}}}, [{"action": "remove", "object": "striker"}] * 20,
)  # fmt: skip


def from_schema(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    """Values that an inlined schema allows: bounds, lengths, enums, choices; patterns and formats are not followed."""
    choices = schema.get("anyOf") or schema.get("oneOf")
    if choices:
        return st.one_of([from_schema(choice) for choice in choices])
    if "const" in schema or "enum" in schema:
        return st.sampled_from(schema.get("enum", [schema.get("const")]))
    kind = schema.get("type", "any")
    low, high = (schema.get(f"{word}imum", schema.get(f"exclusive{word.title()}imum")) for word in ("min", "max"))
    if kind == "integer":
        return st.integers(low, high)
    if kind == "number":
        return st.floats(low, high, allow_nan=False, allow_infinity=False)
    if kind == "array":
        return st.lists(
            from_schema(schema.get("items", {})),
            min_size=schema.get("minItems", 0),
            max_size=min(schema.get("maxItems", 6), max(6, schema.get("minItems", 0))),
        )
    if kind == "object":
        properties, required = schema.get("properties", {}), schema.get("required", [])
        return st.fixed_dictionaries(
            {key: from_schema(part) for key, part in properties.items() if key in required},
            optional={key: from_schema(part) for key, part in properties.items() if key not in required},
        )
    simple = {"string": st.text(max_size=20) | st.sampled_from(("striker", "discs", "slide", "clip", "x"))}
    return {**simple, "boolean": st.booleans(), "null": st.none()}.get(kind, st.sampled_from(HOSTILE))


def paths(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Where the parts of nested arguments are, outermost first."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (*path, key)
        yield from paths(item, (*path, key))


def with_part(arguments: dict[str, Any], path: tuple[str | int, ...], part: Any) -> dict[str, Any]:
    """A copy of the arguments with another value at a path."""
    changed: Any = copy.deepcopy(arguments)
    inner = changed
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = part
    return changed  # type: ignore[no-any-return]


@st.composite
def calls(
    draw: st.DrawFn, schemas: dict[str, dict[str, Any]], valid: list[tuple[str, dict[str, Any]]]
) -> tuple[str, dict[str, Any]]:
    """Draw a tool and its arguments.

    schemas: input schema of each tool. valid: calls that succeed, a few of each tool.
    """
    way = draw(
        st.sampled_from(("valid", "valid", "hostile part", "hostile part", "part of the schema", "schema", "anything"))
    )
    tool, arguments = draw(st.sampled_from(valid))
    properties = schemas[tool].get("properties", {})
    if way == "valid" or not properties:
        draw(st.integers(0, 10**9))  # else Hypothesis, which repeats no example, would make each valid call but once
        return tool, arguments
    if way == "anything":
        names = st.sampled_from([*properties, "no_such_argument"])
        return tool, draw(st.dictionaries(names, st.sampled_from(HOSTILE), max_size=4))
    if way == "hostile part" and arguments:
        path = draw(st.sampled_from(list(paths(arguments))))
        return tool, with_part(arguments, path, draw(st.sampled_from(HOSTILE)))
    name = draw(st.sampled_from(sorted(properties)))
    if way == "schema":
        required = [key for key in schemas[tool].get("required", []) if key not in arguments]
        arguments = {**arguments, **{key: draw(from_schema(properties[key])) for key in required}}
    return tool, {**arguments, name: draw(from_schema(properties[name]))}
