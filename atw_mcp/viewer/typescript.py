"""Write the types of a document for the page: `python -m atw_mcp.viewer.typescript`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from atw_mcp.viewer.document import ViewDocument

FILE = Path(__file__).parent / "web" / "src" / "document.ts"
HEAD = "// Generated from atw_mcp/viewer/document.py by `python -m atw_mcp.viewer.typescript`. Do not edit.\n"
PLAIN = {"number": "number", "integer": "number", "string": "string", "boolean": "boolean", "null": "null"}


def typescript() -> str:
    """Return TypeScript interfaces of `ViewDocument` and its parts."""
    schema = ViewDocument.model_json_schema(mode="serialization")
    models = {**schema["$defs"], "ViewDocument": schema}
    return "\n".join([HEAD, *(_interface(name, models[name]) for name in models)])


def _interface(name: str, model: dict[str, Any]) -> str:
    lines = [*_comment(model.get("description"), ""), f"export interface {name} {{"]
    for key, field in model["properties"].items():
        lines += [*_comment(field.get("description"), "  "), f"  {key}: {_type(field)};"]
    return "\n".join([*lines, "}", ""])


def _comment(text: str | None, indent: str) -> list[str]:
    return [] if text is None else [f"{indent}/** {' '.join(text.split())} */"]


def _type(field: dict[str, Any]) -> str:
    if "$ref" in field:
        return str(field["$ref"]).rsplit("/", 1)[-1]
    if "const" in field:
        return f'"{field["const"]}"'
    if "enum" in field:
        return " | ".join(f'"{value}"' for value in field["enum"])
    for several in ("anyOf", "oneOf"):
        if several in field:
            return " | ".join(_type(form) for form in field[several])
    if field["type"] == "array":
        inner = _type(field["items"])
        return f"({inner})[]" if " " in inner else f"{inner}[]"
    return PLAIN[field["type"]]


if __name__ == "__main__":
    FILE.write_text(typescript(), encoding="utf-8")
