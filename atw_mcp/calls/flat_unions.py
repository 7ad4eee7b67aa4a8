"""One flat JSON schema for a choice among several forms, small enough to show an agent in a list of tools.

The exact schema of an edit spells out every shape an added object may have, some four thousand tokens. The flat
one lists each field once and says which forms have it; validation still goes by the exact types.
"""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from atw_mcp.calls.schemas import inlined

BOUNDS = ("minimum", "exclusiveMinimum", "maximum")
NESTED = "written as in a world: DescribeTool(tool='BuildWorld', argument='world')"


def flat_schema(union: Any, tag: str) -> dict[str, Any]:
    """Return the schema of a union of models, discriminated by the constant field `tag`, as a single object."""
    forms = inlined(TypeAdapter(union).json_schema())["oneOf"]
    fields: dict[str, dict[str, list[str]]] = {}
    kinds: dict[str, list[dict[str, Any]]] = {}
    says = []
    for form in forms:
        name = form["properties"][tag]["const"]
        required = [key for key in form.get("required", []) if key != tag]
        optional = [key for key in form["properties"] if key != tag and key not in required]
        takes = ", ".join([*required, *(f"[{key}]" for key in optional)])
        first = " ".join(form["description"].split("\n\n")[0].split()).split(". ")[0].rstrip(".")
        says.append(f"{name}({takes}): {first}")
        for key, schema in form["properties"].items():
            if key == tag:
                continue
            simple = _simple(schema)
            note = simple.pop("description", "")
            fields.setdefault(key, {}).setdefault(note, []).append(name)
            if simple not in kinds.setdefault(key, []):
                kinds[key].append(simple)
    names = [form["properties"][tag]["const"] for form in forms]
    properties: dict[str, Any] = {tag: {"type": "string", "enum": names, "description": "which form"}}
    for key, notes in fields.items():
        described = "; ".join(
            f"{', '.join(names)}: {note}" if note else ", ".join(names) for note, names in notes.items()
        )
        options = kinds[key]
        properties[key] = {**(options[0] if len(options) == 1 else {"anyOf": options}), "description": described}
    return {
        "type": "object",
        "additionalProperties": False,
        "required": [tag],
        "properties": properties,
        "description": "; ".join(says),
    }


def _simple(schema: dict[str, Any]) -> dict[str, Any]:
    """A field's schema without null, default and the inside of nested objects."""
    options = [option for option in schema.get("anyOf", []) if option.get("type") != "null"]
    chosen = {**options[0], **{k: v for k, v in schema.items() if k == "description"}} if len(options) == 1 else schema
    if chosen.get("type") == "object" or "oneOf" in chosen or "properties" in chosen:
        return {"type": "object", "description": f"{schema.get('description', '')}; {NESTED}".lstrip("; ")}
    return {
        key: value
        for key, value in chosen.items()
        if key in ("type", "items", "minItems", "maxItems", "description")
        or (key in BOUNDS and chosen["type"] == "integer")
    }
