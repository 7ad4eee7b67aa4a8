"""Types of values that results of several tools have: vectors, pixels, matrices, spans, JSON documents."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, JsonValue

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Frames = Annotated[list[int], Field(min_length=2, max_length=2)]
"""First and last frame."""
Interval = Annotated[list[float], Field(min_length=2, max_length=2)]
"""Lower and upper end."""
Json = JsonValue
"""A value whose form another schema gives, as arguments of tools and worlds have it."""
