"""What tools return is typed throughout: a client generated from their schemas reads every field without guessing."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

import pytest

from atw_mcp.calls.result_schemas import result_schema
from atw_mcp.results.values import DOCUMENT
from atw_mcp.tools import manifest

GROUPS = [import_module(f"atw_mcp.tools.{module}").GROUP for module in manifest.MODULES]
TOOLS = {tool.name: tool for group in GROUPS for tool in group.tools}


def untyped(schema: dict[str, Any], path: str) -> Iterator[str]:
    """Paths of values of any type."""
    choices = [(word, i, part) for word in ("anyOf", "oneOf") for i, part in enumerate(schema.get(word, []))]
    for word, i, part in choices:
        yield from untyped(part, f"{path}/{word}/{i}")
    if choices or DOCUMENT in schema.get("description", ""):
        return
    kind = schema.get("type")
    if kind == "array":
        yield from untyped(schema.get("items", {}), f"{path}/items")
    elif kind == "object":
        for name, part in schema.get("properties", {}).items():
            yield from untyped(part, f"{path}/{name}")
        others = schema.get("additionalProperties", True)
        if others is not False:
            yield from [f"{path}/*"] if others is True else untyped(others, f"{path}/*")
    elif kind is None and not {"enum", "const"} & set(schema):
        yield path


@pytest.mark.parametrize("name", sorted(TOOLS))
def test_every_field_of_a_result_has_a_type(name: str) -> None:
    assert TOOLS[name].returns is not None
    assert not list(untyped(result_schema(TOOLS[name].returns, long=False)["properties"]["data"], name))


def test_a_field_of_any_type_would_be_found() -> None:
    schema = {"type": "object", "properties": {"a": {}, "b": {"type": "array", "items": {"type": "object"}}}}
    assert list(untyped(schema, "")) == ["/a", "/b/items/*", "/*"]
