"""Statements of somebody who looked at a video: kept with the observation, and never altered by what follows.

A seed is an object's whole mask in one frame; an exclusion says where in which frames an object, or any, is not; a
shade says that a region is shadow; a rest says that an object does not move from one frame to another.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from atw_mcp.perception.masks import RunLengthMask

Position = tuple[float, float, float]


@dataclass(frozen=True)
class Seed:
    """mask of an object in a frame; position: where its centre is in the world then [m], where that was said."""

    object: str
    frame: int
    mask: RunLengthMask
    position: Position | None = None


@dataclass(frozen=True)
class Exclusion:
    """In frames first..last nothing of an object (None: of any) is in the region of `mask` (None: anywhere)."""

    first: int
    last: int
    object: str | None = None
    mask: RunLengthMask | None = None


@dataclass(frozen=True)
class Shade:
    """The region of `mask` is shadow in a frame; object: whose mask holds it (None: any that does)."""

    frame: int
    mask: RunLengthMask
    object: str | None = None


@dataclass(frozen=True)
class Rest:
    """An object does not move in frames first..last."""

    object: str
    first: int
    last: int


Constraint = Seed | Exclusion | Shade | Rest
_KINDS: dict[str, type[Constraint]] = {"seed": Seed, "exclusion": Exclusion, "shade": Shade, "rest": Rest}


def to_dict(constraint: Constraint) -> dict[str, Any]:
    """JSON-ready values; `from_dict` reads them back."""
    kind = next(k for k, made in _KINDS.items() if isinstance(constraint, made))
    values: dict[str, Any] = {"kind": kind}
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
    values = {k: v for k, v in data.items() if k != "kind"}
    if "mask" in values:
        values["mask"] = RunLengthMask.from_dict(values["mask"])
    if "position" in values:
        values["position"] = tuple(float(v) for v in values["position"])
    return _KINDS[data["kind"]](**values)


def renamed(constraint: Constraint, old: str, new: str) -> Constraint:
    """Return the constraint, said of `new` where it was said of `old`."""
    return replace(constraint, object=new) if constraint.object == old else constraint


def ordered(constraints: list[Constraint]) -> tuple[Constraint, ...]:
    """Constraints in an order that does not depend on when each was given."""
    return tuple(sorted(constraints, key=lambda c: sorted((k, str(v)) for k, v in to_dict(c).items())))
