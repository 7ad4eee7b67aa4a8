"""Corrections of an observation, and how to read them from JSON."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from atw_mcp.perception.masks import MaskError, RunLengthMask
from atw_mcp.perception.observation import ObservationError

Point = tuple[float, float]
Box = tuple[float, float, float, float]
_NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$")


@dataclass(frozen=True)
class Outline:
    """Says where an object is in one frame; it is then followed from there in both directions.

    Give one of outline (u, v points), circle (u, v, radius), box (left, top, width, height), centre (u, v) [px], and
    mask (height, width). add: a new object.
    """

    object: str
    frame: int
    outline: tuple[Point, ...] | None = None
    circle: tuple[float, float, float] | None = None
    box: Box | None = None
    centre: Point | None = None
    mask: RunLengthMask | None = None
    add: bool = False


@dataclass(frozen=True)
class Place:
    """Says where the centre of an object is in the world in one frame, position (x, y, z) [m]."""

    object: str
    frame: int
    position: tuple[float, float, float]


@dataclass(frozen=True)
class Exclude:
    """Says that in frames frame..last_frame (default: that frame) nothing of an object, or of any, is in a box or mask;
    without box and mask: that the object is nowhere in the image."""

    frame: int
    last_frame: int | None = None
    object: str | None = None
    box: Box | None = None
    mask: RunLengthMask | None = None


@dataclass(frozen=True)
class Stay:
    """Says that an object is at rest in frames frame..last_frame."""

    object: str
    frame: int
    last_frame: int


@dataclass(frozen=True)
class Merge:
    """Two tracks are one object: `second` becomes part of `first`."""

    first: str
    second: str


@dataclass(frozen=True)
class Split:
    """From `frame` on a track is another object, called `name`."""

    object: str
    frame: int
    name: str


@dataclass(frozen=True)
class Rename:
    """An object gets another name."""

    object: str
    name: str


@dataclass(frozen=True)
class Drop:
    """Removal of a track that is no object."""

    object: str


Statement = Outline | Place | Exclude | Stay
Correction = Statement | Merge | Split | Rename | Drop
_KINDS: dict[str, type[Correction]] = {
    "outline": Outline,
    "add": Outline,
    "place": Place,
    "exclude": Exclude,
    "rest": Stay,
    "merge": Merge,
    "split": Split,
    "rename": Rename,
    "drop": Drop,
}


def correction_of(data: dict[str, Any]) -> Correction:
    """Return a correction from JSON: {"kind": "outline" | "add" | "place" | ..., ...fields}.

    A mask is a COCO run-length record. Raises ObservationError naming kinds and fields.
    """
    kind = data.get("kind")
    if kind not in _KINDS:
        raise ObservationError(f"unknown kind of correction {kind!r}; kinds: {list(_KINDS)}")
    fields = {k: v for k, v in data.items() if k != "kind" and v is not None}
    try:
        if isinstance(fields.get("mask"), dict):
            fields["mask"] = RunLengthMask.from_dict(fields["mask"])
        if "outline" in fields:
            fields["outline"] = tuple((float(u), float(v)) for u, v in fields["outline"])
        for key, count in (("box", 4), ("circle", 3), ("centre", 2), ("position", 3)):
            if key in fields:
                fields[key] = tuple(float(v) for v in fields[key])
                if len(fields[key]) != count:
                    raise ValueError(f"{key} has {count} numbers")
        if kind == "add":
            fields["add"] = True
        return _KINDS[kind](**fields)
    except MaskError as error:
        raise ObservationError(f"{kind}: {error}") from error
    except (TypeError, ValueError) as error:
        names = [f for f in _KINDS[kind].__dataclass_fields__ if f != "add"]
        raise ObservationError(f"{kind}: fields are {names}; {error}") from error


def checked_name(name: str, taken: list[str]) -> str:
    """Return a name for an object; raises ObservationError where it is taken or not allowed."""
    if not _NAME.match(name):
        raise ObservationError(
            f"{name!r} is not a name: 1 to 64 letters, digits, _ or -, beginning with one of the first two"
        )
    if name in taken:
        raise ObservationError(f"the name {name!r} is taken; objects: {taken}")
    return name
