"""Short forms of tools for `tools/list`, derived from their full declarations.

An agent pays for the list in every session. The short form keeps the name, type, default and a line about every
argument, one example of what is nested, and the top-level fields of the result. It refuses nothing that the full
schema accepts; DescribeTool and the resources atw://schema/tools/{tool} give what it leaves out.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

from mcp_types import Tool, ToolAnnotations

Schema = dict[str, Any]


@dataclass(frozen=True)
class Room:
    """Most characters that each part of a tool may take in the list. Together they keep all tools within 41 kB."""

    description: int = 180  # of a tool, beside its "Next: ..."
    argument: int = 60  # clauses of an argument's description; the first one is always kept
    enum: int = 140  # JSON of an enumeration
    forms: int = 1200  # signatures of a tagged object's forms; above it their names alone
    output: int = 140  # JSON of a result's schema; above it types are left out, then fields


ROOM = Room()
FEW_FIELDS = 5  # an object of so few fields needs no more than its line


def brief_tool(tool: Tool) -> Tool:
    """Return the tool as the list shows it."""
    return tool.model_copy(
        update={
            "description": brief_description(tool.description or ""),
            "input_schema": brief_input(tool.input_schema),
            "output_schema": None if tool.output_schema is None else brief_output(tool.output_schema),
            "annotations": None if tool.annotations is None else brief_hints(tool.annotations),
        }
    )


def brief_description(text: str) -> str:
    """Return the first sentences, and the one that begins with "Next:"."""
    sentences = [part for part in re.split(r"(?<=[.])\s+", text) if part]
    others = [sentence for sentence in sentences if not sentence.startswith("Next:")]
    kept = others[:1]
    for sentence in others[1:]:
        if len(" ".join([*kept, sentence])) > ROOM.description:
            break
        kept.append(sentence)
    return " ".join([*kept, *(sentence for sentence in sentences if sentence.startswith("Next:"))])


def brief_hints(hints: ToolAnnotations) -> ToolAnnotations:
    """Return the hints that differ from the protocol's defaults, without the title.

    Of a tool that only reads, it says nothing that it may be repeated and destroys nothing.
    """
    if hints.read_only_hint:
        return ToolAnnotations(read_only_hint=True, open_world_hint=hints.open_world_hint)
    return ToolAnnotations(
        destructive_hint=hints.destructive_hint,
        idempotent_hint=hints.idempotent_hint or None,
        open_world_hint=hints.open_world_hint,
    )


def brief_input(schema: Schema) -> Schema:
    """Return the schema of a tool's arguments with nested objects described in words instead of spelled out."""
    short: Schema = {
        "type": "object",
        "properties": {name: _argument(part) for name, part in schema.get("properties", {}).items()},
    }
    if schema.get("required"):
        short["required"] = schema["required"]
    return short


def brief_output(schema: Schema) -> Schema:
    """Return the schema of a result with the top-level fields of its data and their types, as far as there is room.

    Of a union of models every field is listed once.
    """
    fields: dict[str, Schema] = {}
    for form in _forms_of(schema.get("properties", {}).get("data", {})):
        for name, part in form.get("properties", {}).items():
            fields[name] = _either(fields[name], _typed(part)) if name in fields else _typed(part)
    if _size(_result(fields)) > ROOM.output:
        fields = {name: {} for name in fields}
    while _size(_result(fields)) > ROOM.output:
        fields.popitem()
    return _result(fields)


def _result(fields: dict[str, Schema]) -> Schema:
    data: Schema = {"type": "object", **({"properties": fields} if fields else {})}
    return {"type": "object", "properties": {"data": data}}


def _forms_of(schema: Schema) -> list[Schema]:
    """The object schemas of a union, without the one of work that is not finished, which every tool may return."""
    choices = schema.get("anyOf") or schema.get("oneOf")
    if not choices:
        return [schema]
    return [form for choice in choices for form in _forms_of(choice) if set(form.get("properties", {})) != {"progress"}]


def _argument(schema: Schema) -> Schema:
    """The schema of one argument, with its description cut to a line."""
    text = schema.get("description", "")
    short = _shallow(schema)
    if "default" in schema:
        short["default"] = schema["default"]
    nested = _nested(schema)
    if nested is None:
        about = [_line(text)]
    else:
        forms = _signatures(nested)
        about = [_line(text.split(forms[0])[0] if forms else text), _fields(nested, forms)]
    if "examples" in schema:
        about.append(f"E.g. {json.dumps(schema['examples'][0], separators=(',', ':'), ensure_ascii=False)}")
    if nested is not None and len(nested["properties"]) > FEW_FIELDS:
        about.append("More: DescribeTool")
    short["description"] = ". ".join(part for part in about if part)
    return short


def _shallow(schema: Schema) -> Schema:
    """A schema without descriptions, bounds and the inside of objects; it accepts whatever the schema accepts."""
    choices = schema.get("anyOf") or schema.get("oneOf")
    if choices:
        shown = [_shallow(choice) for choice in choices]
        return {"anyOf": [choice for number, choice in enumerate(shown) if choice not in shown[:number]]}
    if "const" in schema:
        return {"const": schema["const"]}
    short = {"type": schema["type"]} if "type" in schema else {}
    if "enum" in schema and _size(schema["enum"]) <= ROOM.enum:
        short["enum"] = schema["enum"]
    if schema.get("type") == "array":
        short["items"] = _shallow(schema.get("items", {}))
    return short


def _typed(schema: Schema) -> Schema:
    """A field of a result by its type; a choice of types in words, for clients that refuse a list of them."""
    choices = schema.get("anyOf") or schema.get("oneOf")
    if choices:
        return {"description": "|".join(dict.fromkeys(str(choice.get("type", "any")) for choice in choices))}
    return {"type": schema["type"]} if "type" in schema else {}


def _either(one: Schema, other: Schema) -> Schema:
    return one if one == other else {}


def _nested(schema: Schema) -> Schema | None:
    """The object schema inside an argument: itself, an item of a list, or the first object of a choice."""
    if "properties" in schema:
        return schema
    inside = [schema["items"]] if "items" in schema else schema.get("anyOf") or schema.get("oneOf") or []
    return next((found for part in inside if (found := _nested(part)) is not None), None)


def _fields(schema: Schema, forms: list[str]) -> str:
    """The fields of an object in words: its forms where a tag chooses one, else their names, required ones first."""
    tags, required = _tags(schema), schema.get("required", [])
    if forms:
        listed = "; ".join(form.replace("], [", ", ") for form in forms)
        return f"{tags[0]}: {listed if len(listed) <= ROOM.forms else _values(schema['properties'][tags[0]])}"
    names = [f"{name} ({_values(schema['properties'][name])})" if name in tags else name for name in required]
    optional = [name for name in schema["properties"] if name not in required]
    return "Fields: " + ", ".join([*names, *([f"[{', '.join(optional)}]"] if optional else [])])


def _tags(schema: Schema) -> list[str]:
    """Required fields that take one of a few values."""
    return [name for name in schema.get("required", []) if "enum" in schema["properties"][name]]


def _values(schema: Schema) -> str:
    return ", ".join(map(str, schema["enum"]))


def _signatures(schema: Schema) -> list[str]:
    """Signatures such as `remove(object, [part])` that an object's description gives for its tag's values, if any."""
    tags = _tags(schema)
    if len(tags) != 1:
        return []
    named = "|".join(re.escape(value) for value in schema["properties"][tags[0]]["enum"])
    pattern = rf"(?:^|[;.] )((?:{named})(?:\([^)]*\))?)(?=[:;.])"
    found: list[str] = re.findall(pattern, schema.get("description", ""))
    return found if any("(" in form for form in found) else []


def _line(text: str) -> str:
    """The first clauses of a description that fit in a line."""
    kept = ""
    for clause in re.split(r"(?<!e\.g\.)(?<=[.;])\s+", text.split("\n\n")[0]):
        if kept and len(kept) + len(clause) > ROOM.argument:
            break
        kept = f"{kept} {clause}".strip()
    return kept.rstrip(";.")


def _size(value: Any) -> int:
    return len(json.dumps(value, separators=(",", ":"), ensure_ascii=False))
