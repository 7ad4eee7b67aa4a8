"""Statements of somebody who looked at a video: kept with the observation, and never altered by what follows.

A seed says where an object is in one frame; an exclusion says where in which frames an object, or any, is not; a rest
says that an object does not move from one frame to another.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from atw_mcp.perception.eye.seeds import Seed
from atw_mcp.perception.masks import RunLengthMask


@dataclass(frozen=True)
class Exclusion:
    """In frames first..last nothing of an object (None: of any) is in the region of `mask` (None: anywhere)."""

    first: int
    last: int
    object: str | None = None
    mask: RunLengthMask | None = None


@dataclass(frozen=True)
class Rest:
    """An object does not move in frames first..last."""

    object: str
    first: int
    last: int


Constraint = Seed | Exclusion | Rest
_KINDS: dict[str, type[Constraint]] = {"seed": Seed, "exclusion": Exclusion, "rest": Rest}


def to_dict(constraint: Constraint) -> dict[str, Any]:
    """JSON-ready values; `from_dict` reads them back."""
    statement = next(k for k, made in _KINDS.items() if isinstance(constraint, made))
    values: dict[str, Any] = {"statement": statement}
    for item in fields(constraint):
        value = getattr(constraint, item.name)
        if isinstance(value, RunLengthMask):
            value = value.to_dict()
        elif isinstance(value, tuple):
            value = list(value)
        if value is not None:
            values[item.name] = value
    return values


def from_dict(data: dict[str, Any]) -> Constraint:
    """Return the inverse of `to_dict`."""
    values = dict(data)
    made = _KINDS[values.pop("statement")]
    for key in ("mask", "value", "position"):
        value = values.get(key)
        if isinstance(value, dict):
            values[key] = RunLengthMask.from_dict(value)
        elif isinstance(value, list):
            values[key] = tuple(float(v) for v in value)
    return made(**values)


def renamed(constraint: Constraint, old: str, new: str) -> Constraint:
    """Return the constraint, said of `new` where it was said of `old`."""
    return replace(constraint, object=new) if constraint.object == old else constraint


def ordered(constraints: list[Constraint]) -> tuple[Constraint, ...]:
    """Constraints in an order that does not depend on when each was given."""
    return tuple(sorted(constraints, key=lambda c: sorted((k, str(v)) for k, v in to_dict(c).items())))
