"""JSON schemas as clients understand them: no references, no titles that repeat the name."""

from __future__ import annotations

from typing import Any


def inlined(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema with every `$ref` replaced by what it refers to and pydantic's `title`s dropped.

    Raises ValueError for a schema that refers to itself, which cannot be inlined.
    """
    definitions = schema.get("$defs", {})

    def resolve(value: Any, inside: tuple[str, ...]) -> Any:
        if isinstance(value, list):
            return [resolve(item, inside) for item in value]
        if not isinstance(value, dict):
            return value
        if "$ref" in value:
            name = str(value["$ref"]).rsplit("/", 1)[-1]
            if name in inside:
                raise ValueError(f"the schema of {name} contains itself and cannot be inlined")
            rest = {key: item for key, item in value.items() if key != "$ref"}
            return resolve({**definitions[name], **rest}, (*inside, name))
        kept = {}
        for key, item in value.items():
            if key == "properties":  # a property may itself be called title or $defs
                kept[key] = {name: resolve(part, inside) for name, part in item.items()}
            elif key == "discriminator" or key == "$defs" or (key == "title" and isinstance(item, str)):
                continue
            else:
                kept[key] = resolve(item, inside)
        return kept

    result: dict[str, Any] = resolve(schema, ())
    return result


def without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema of an object whose optional properties are left out rather than null: half as long to read.

    Where a property defaults to null, the choice of null beside its real type says nothing more. The server still
    accepts null there.
    """

    def shorten(value: Any) -> Any:
        if isinstance(value, list):
            return [shorten(item) for item in value]
        if not isinstance(value, dict):
            return value
        value = {key: shorten(item) for key, item in value.items()}
        choices = value.get("anyOf")
        if choices is None or "default" not in value or value["default"] is not None:
            return value
        real = [choice for choice in choices if choice != {"type": "null"}]
        rest = {key: item for key, item in value.items() if key not in ("anyOf", "default")}
        return {**(real[0] if len(real) == 1 else {"anyOf": real}), **rest}

    result: dict[str, Any] = shorten(schema)
    return result


def argument_lines(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """The arguments of an inlined object schema, each with name, type in words, default and description."""
    required = schema.get("required", [])
    lines = []
    for name, part in schema.get("properties", {}).items():
        line = {"argument": name, "type": type_in_words(part), "required": name in required}
        if "default" in part:
            line["default"] = part["default"]
        line["description"] = part.get("description", "")
        lines.append(line)
    return lines


def type_in_words(schema: dict[str, Any]) -> str:
    """A schema as a short phrase: `number >= 0 and <= 1`, `list of text`, `"a" | "b"`, `object {name, track}`."""
    choices = schema.get("anyOf") or schema.get("oneOf")
    if choices:
        return " | ".join(dict.fromkeys(type_in_words(part) for part in choices))
    if "enum" in schema or "const" in schema:
        return " | ".join(f'"{value}"' for value in schema.get("enum", [schema.get("const")]))
    kind = schema.get("type", "any")
    if kind == "array":
        size = [
            f"{word} {schema[key]}"
            for key, word in (("minItems", "at least"), ("maxItems", "at most"))
            if key in schema
        ]
        return f"list of {type_in_words(schema.get('items', {}))}" + (f" ({', '.join(size)})" if size else "")
    if kind == "object" and "properties" in schema:
        return "object {" + ", ".join(schema["properties"]) + "}"
    bounds = [
        f"{sign} {schema[key]}"
        for key, sign in (("minimum", ">="), ("exclusiveMinimum", ">"), ("maximum", "<="), ("exclusiveMaximum", "<"))
        if key in schema
    ]
    word = {"string": "text", "null": "null", "boolean": "true or false"}.get(kind, kind)
    return f"{word} {' and '.join(bounds)}".strip()
