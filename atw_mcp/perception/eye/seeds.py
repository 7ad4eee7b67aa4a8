"""Seeds: hints at where a body is in a frame, all turned into a pose there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from atw_mcp.perception.eye.bodies import CIRCLE, Body, Outline, outline_of
from atw_mcp.perception.eye.pixels import Floats

Kind = Literal["outline", "circle", "box", "centre", "mask"]


@dataclass(frozen=True)
class Seed:
    """A hint: a body's name, a frame, and an outline (V, 2), circle (u, v, radius), box (u0, v0, u1, v1), centre (u, v)
    [px] or mask (H, W)."""

    body: str
    kind: Kind
    frame: int
    value: object

    def polygon(self) -> Floats | None:
        """Outline (V, 2) [px] of hints that have one."""
        if self.kind == "outline":
            return np.asarray(self.value, dtype=float)
        if self.kind == "circle":
            u, v, radius = np.asarray(self.value, dtype=float)
            return np.asarray(CIRCLE * radius + [u, v])
        if self.kind == "box":
            u0, v0, u1, v1 = np.asarray(self.value, dtype=float)
            return np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]])
        if self.kind == "mask":
            mask = np.asarray(self.value).astype(np.uint8)
            contours = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
            return None if not contours else np.asarray(max(contours, key=cv2.contourArea)[:, 0], dtype=float)
        return None

    def centre(self) -> Floats | None:
        """Centre (2,) [px] of hints that have one."""
        if self.kind == "centre":
            return np.asarray(self.value, dtype=float)
        polygon = self.polygon()
        return None if polygon is None else outline_of("", polygon)[1][:2]


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
