"""Building blocks of every part of a world description: a closed frozen model, vectors, names, signs, looks."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema


def fixed_length(count: int, item: str = "number") -> WithJsonSchema:
    """Return the schema of a list of `count` items of one JSON type; integers count things or places in a list."""
    # JSON-schema tuples (prefixItems) are refused by some MCP clients; a fixed-length list is not.
    items = {"type": item, "minimum": 0} if item == "integer" else {"type": item}
    return WithJsonSchema({"type": "array", "items": items, "minItems": count, "maxItems": count})


Vec3 = Annotated[tuple[float, float, float], fixed_length(3)]
Interval = Annotated[tuple[float, float], fixed_length(2)]
Quaternion = Annotated[tuple[float, float, float, float], fixed_length(4)]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]*$")]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]

IDENTITY: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
ORIGIN: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Description(BaseModel):
    """Base of every part of a world: frozen, closed to unknown fields, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Appearance(Description):
    """How an object looks; used to draw it and to refer to it, never by the physics."""

    color: str | None = Field(default=None, max_length=32, description="colour name, or #rrggbb")
    material: str | None = Field(default=None, max_length=32, description="e.g. metal, rubber")


def unit_quaternion(value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Normalize a quaternion; raises ValueError for the zero quaternion."""
    norm = math.sqrt(sum(v * v for v in value))
    if norm < 1e-9:
        raise ValueError("orientation must not be the zero quaternion")
    if abs(norm - 1.0) < 1e-12:  # already unit: keep the bytes, so that the hash survives a round trip
        return value
    w, x, y, z = (float(v / norm) for v in value)
    return w, x, y, z
