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
