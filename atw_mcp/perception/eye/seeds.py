"""Seeds: hints at where a body is in a frame, all turned into a pose there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

import cv2
import numpy as np

from atw_mcp.perception.eye.bodies import CIRCLE, Body, Outline, outline_of
from atw_mcp.perception.eye.pixels import Floats
from atw_mcp.perception.masks import RunLengthMask

Kind = Literal["outline", "circle", "box", "centre", "mask"]
KINDS: tuple[Kind, ...] = ("outline", "circle", "box", "centre", "mask")


@dataclass(frozen=True)
class Seed:
    """Hint at where an object is in a frame, in that frame's own pixels, or in steady ones inside the eye.

    value: an outline's points (u, v, u, v, ...), circle (u, v, radius), box (left, top, right, bottom), centre (u, v)
    [px] or a mask. position: where its centre is in the world then [m], where that was stated.
    """

    object: str
    kind: Kind
    frame: int
    value: tuple[float, ...] | RunLengthMask
    position: tuple[float, float, float] | None = None

    @classmethod
    def outlined(cls, name: str, frame: int, points: Floats) -> Self:
        """Seed of an outline (V, 2) [px]."""
        return cls(name, "outline", frame, tuple(points.ravel().tolist()))

    def points(self) -> Floats:
        """Points (N, 2) [px] that a hint without a mask gives; a circle's centre."""
        assert not isinstance(self.value, RunLengthMask)
        return np.array(self.value[:2] if self.kind == "circle" else self.value, dtype=float).reshape(-1, 2)

    def moved(self, points: Floats) -> tuple[float, ...]:
        """Value of the hint with other points (N, 2) [px]."""
        assert not isinstance(self.value, RunLengthMask)
        return (*points.ravel().tolist(), *(self.value[2:] if self.kind == "circle" else ()))

    def polygon(self) -> Floats | None:
        """Outline (V, 2) [px] of hints that have one."""
        if isinstance(self.value, RunLengthMask):
            mask = self.value.decode().astype(np.uint8)
            contours = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
            return None if not contours else np.asarray(max(contours, key=cv2.contourArea)[:, 0], dtype=float)
        if self.kind == "circle":
            return np.asarray(CIRCLE * self.value[2] + self.points())
        if self.kind == "box":
            (u0, v0), (u1, v1) = self.points()
            return np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]])
        return self.points() if self.kind == "outline" else None

    def centre(self) -> Floats | None:
        """Centre (2,) [px]; None of an empty mask."""
        polygon = self.points() if self.kind == "centre" else self.polygon()
        if polygon is None or len(polygon) == 1:
            return None if polygon is None else np.asarray(polygon[0])
        return outline_of("", polygon)[1][:2]


def outline_body(name: str, seed: Seed) -> Outline:
    """Body of unknown shape, from the first seed that has an outline."""
    polygon = seed.polygon()
    if polygon is None:
        raise ValueError(f"{name}: a body of unknown shape needs an outline, a circle, a box or a mask in one frame")
    return outline_of(name, polygon, round=seed.kind == "circle")[0]


def seed_pose(body: Body, seed: Seed) -> Floats:
    """Pose (4,) of a body at a seed's frame. Raises ValueError for one that is nowhere."""
    centre = seed.centre()
    if centre is None:
        raise ValueError(f"{body.name}: the mask of frame {seed.frame} is empty")
    pose = body.placed(centre, np.zeros(4))
    polygon = seed.polygon()
    if isinstance(body, Outline) and body.scales and polygon is not None:
        pose[3] = np.log(outline_of("", polygon)[0].radius(np.zeros(4)) / body.radius(np.zeros(4)))
    if not np.isfinite(pose).all():
        raise ValueError(f"{body.name}: the seed of frame {seed.frame} lies above the horizon of the plane of motion")
    return pose
