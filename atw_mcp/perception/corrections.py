"""Corrections of an observation, as an agent gives them."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from atw_mcp.perception.eye.seeds import KINDS, Seed
from atw_mcp.perception.masks import MaskError, RunLengthMask
from atw_mcp.perception.observation import ObservationError

Pixel = Annotated[list[float], Field(min_length=2, max_length=2)]
Name = Annotated[str, Field(max_length=64)]
FIELDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {  # of each kind: those it needs, and those it may have
    "outline": (("object", "frame"), KINDS),
    "add": (("object", "frame"), KINDS),
    "place": (("object", "frame", "position"), ()),
    "exclude": (("frame",), ("last_frame", "object", "box", "mask")),
    "rest": (("object", "frame", "last_frame"), ()),
    "merge": (("first", "second"), ()),
    "split": (("object", "frame", "name"), ()),
    "rename": (("object", "name"), ()),
    "drop": (("object",), ()),
}


class MaskArgument(BaseModel):
    """A mask of the whole image as a COCO run-length record."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    size: Annotated[list[Annotated[int, Field(gt=0, le=16384)]], Field(min_length=2, max_length=2)] = Field(
        description="height, width [px]"
    )
    counts: str = Field(max_length=1_000_000, description="COCO's compressed text")


class Correction(BaseModel):
    """One correction. outline: object, frame and one of outline, circle, box, centre, mask say where a known object is,
    add: the same for one that was missed (centre needs a known shape); they are followed to all frames. An outline or
    circle on one frame is the surest hint. place: object's centre is at position in frame. exclude: in
    frame..last_frame nothing of object (or of any) is in box or mask, or object is nowhere. rest: object does not move
    in frame..last_frame. merge: first, second are one; split: object is another one called name from frame on; rename:
    object, name; drop: object is none."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    kind: Literal["outline", "add", "place", "exclude", "rest", "merge", "split", "rename", "drop"] = Field(
        description="what kind of correction"
    )
    object: Name | None = Field(default=None, description="the object concerned")
    frame: int | None = Field(default=None, ge=0, description="frame number")
    last_frame: int | None = Field(default=None, ge=0, description="exclude, rest: last frame for which it holds")
    position: Annotated[list[float], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="place: x, y, z in the world [m]"
    )
    outline: list[Pixel] | None = Field(
        default=None, min_length=3, max_length=200, description="its outline in that frame: pixels u, v in order"
    )
    circle: Annotated[list[float], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="the circle around a round object: u, v, radius [px]"
    )
    box: Annotated[list[float], Field(min_length=4, max_length=4)] | None = Field(
        default=None, description="box around it, or region: left, top, width, height [px]"
    )
    centre: Pixel | None = Field(default=None, description="u, v of its centre, to a third of its radius")
    mask: MaskArgument | None = Field(default=None, description="its mask in that frame, or region")
    first: Name | None = Field(default=None, description="merge: the name that stays")
    second: Name | None = Field(default=None, description="merge: the name that goes")
    name: Name | None = Field(default=None, description="split, rename: the new name")

    def check(self) -> None:
        """Raise ObservationError where fields of the kind are missing, or others are given."""
        needed, more = FIELDS[self.kind]
        given = {name for name in type(self).model_fields if name != "kind" and getattr(self, name) is not None}
        wrong = [f"{n} is missing" for n in needed if n not in given]
        wrong += [f"{n} does not belong to it" for n in sorted(given - {*needed, *more})]
        if wrong:
            raise ObservationError(f"{self.kind}: fields are {[*needed, *more]}; {', '.join(wrong)}")

    def seed(self, width: int, height: int) -> Seed:
        """Seed that an outline is in an image; raises ObservationError where it has not one shape, or lies outside."""
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        name, frame = self.object or "", self.frame or 0
        where = f"{name} in frame {frame}"
        if len(given) != 1:
            raise ObservationError(f"{where}: give one of {', '.join(KINDS)}, not {', '.join(given) or 'none'}")
        if self.mask is not None:
            return Seed(name, "mask", frame, self.stored_mask(width, height))
        values = np.array(getattr(self, given[0]), dtype=float).ravel()
        if given[0] == "circle" and values[2] < 1:
            raise ObservationError(f"{where}: a circle has a radius of 1 px or more")
        if given[0] == "box":
            if values[2:].min() < 3:
                raise ObservationError(f"{where}: a box is left, top, width, height of at least 3 px")
            values[2:] += values[:2]
        seed = Seed(name, given[0], frame, tuple(values.tolist()))
        points = seed.points()
        if (points.max(axis=0) < 0).any() or (points.min(axis=0) >= [width, height]).any():
            raise ObservationError(f"{where}: the {seed.kind} lies outside the image of {width} x {height}")
        return seed

    def region(self, width: int, height: int) -> RunLengthMask | None:
        """Region that an exclusion names, None for the whole image; raises ObservationError for one outside it."""
        if self.box is not None and self.mask is not None:
            raise ObservationError("give box or mask, not both: a region is one of them")
        if self.box is None:
            return None if self.mask is None else self.stored_mask(width, height)
        left, top, wide, tall = self.box
        region = np.zeros((height, width), dtype=bool)
        region[max(round(top), 0) : max(round(top + tall), 0), max(round(left), 0) : max(round(left + wide), 0)] = True
        if not region.any():
            raise ObservationError(f"the box {self.box} lies outside the image of {width} x {height}")
        return RunLengthMask.encode(region)

    def stored_mask(self, width: int, height: int) -> RunLengthMask:
        """Mask of an image that is given; raises ObservationError for one of another size."""
        assert self.mask is not None
        try:
            mask = RunLengthMask.from_dict(self.mask.model_dump())
        except MaskError as error:
            raise ObservationError(f"{self.kind}: {error}") from error
        if (mask.height, mask.width) != (height, width):
            raise ObservationError(f"the mask is {mask.width} x {mask.height}, the image {width} x {height}")
        return mask
