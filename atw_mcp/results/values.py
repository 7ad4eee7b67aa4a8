"""Types of values that results of several tools have: vectors, pixels, matrices, spans, JSON documents."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, JsonValue, WithJsonSchema

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Frames = Annotated[list[int], Field(min_length=2, max_length=2)]
"""First and last frame."""
Interval = Annotated[list[float], Field(min_length=2, max_length=2)]
"""Lower and upper end."""
DOCUMENT = "JSON document"  # describes what has no fields of its own: a part of a world, a JSON schema
Json = Annotated[dict[str, JsonValue], WithJsonSchema({"type": "object", "description": DOCUMENT})]
"""An object whose form another schema gives, as arguments of tools and worlds have it."""
AnyJson = Annotated[JsonValue, WithJsonSchema({"description": DOCUMENT})]
"""The same, of any kind."""
