"""Seeds: hints at where a body is in a frame, all turned into a pose there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye.bodies import CIRCLE, Body, Outline, outline_of
from atw_mcp.perception.eye.pixels import Array, Floats

Kind = Literal["outline", "circle", "box", "centre", "words", "mask"]


@dataclass(frozen=True)
class Seed:
    """A hint: a body's name, a frame, and an outline (V, 2), circle (u, v, radius), box (u0, v0, u1, v1), centre (u, v)
    [px], mask (H, W) or colour word. Words alone may leave the frame open."""

    body: str
    kind: Kind
    frame: int | None
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


def seed_pose(body: Body, seed: Seed) -> Floats | None:
    """Pose (4,) of a body at a seed's frame; None for words, which are searched for. Raises ValueError."""
    centre = seed.centre()
    if centre is None:
        return None
    pose = body.placed(centre, np.zeros(4))
    polygon = seed.polygon()
    if isinstance(body, Outline) and body.scales and polygon is not None:
        pose[3] = np.log(outline_of("", polygon)[0].radius(np.zeros(4)) / body.radius(np.zeros(4)))
    if not np.isfinite(pose).all():
        raise ValueError(f"{body.name}: the seed of frame {seed.frame} lies above the horizon of the plane of motion")
    return pose


HUES = {  # OpenCV's hue, 0..180
    "red": ((-9, 8),),
    "brown": ((8, 20),),
    "orange": ((6, 20),),
    "yellow": ((20, 37),),
    "green": ((37, 84),),
    "cyan": ((84, 102),),
    "blue": ((102, 131),),
    "purple": ((131, 169),),
    "pink": ((150, 172),),
}
GREYS = ("gray", "grey", "white", "black")


def word_map(frame: NDArray[np.uint8], word: str, background: Array) -> Array:
    """Evidence (H, W) [nats] that pixels of a frame have a colour and are not the background, less of those that have
    its log brightness (H, W); grey bodies always differ from it. Raises ValueError for a word that is no colour."""
    hsv = cv2.cvtColor(cv2.GaussianBlur(frame, (3, 3), 0), cv2.COLOR_BGR2HSV).astype(np.int16)
    hue, saturation, value = hsv[..., 0], hsv[..., 1], hsv[..., 2]
    differs = np.abs(np.log(frame.astype(np.float32) + 12).mean(axis=-1) - background) > 0.1
    if word in GREYS:
        low, high = {"black": (0, 90), "white": (150, 255)}.get(word, (0, 255))  # in any shade and light
        fits = (saturation < 45) & differs & (value >= low) & (value <= high)
        return np.where(fits, 1.5, -1.0).astype(np.float32)
    if word not in HUES:
        raise ValueError(f"no colour is called {word!r}: {', '.join([*HUES, *GREYS])}")
    wrapped = np.where(hue > 172, hue - 180, hue)
    fits = np.any([(wrapped >= low) & (wrapped <= high) for low, high in HUES[word]], axis=0)
    fits &= (saturation > 75) & (value > 25)
    return np.where(fits, np.where(differs, 2.0, 0.6), -0.7).astype(np.float32)


def word_places(
    evidence: Array, body: Body, count: int, hidden: NDArray[np.bool_] | None = None
) -> list[tuple[float, Floats]]:
    """Poses of largest mean evidence in a box of a body's size, at most `count`, with that mean.

    hidden (H, W): pixels that cannot show it; the mean is then between that of the others and that of all.
    """
    height, width = evidence.shape
    shown = np.ones_like(evidence) if hidden is None else (~hidden).astype(np.float32)
    total, counted = cv2.integral(evidence * shown), cv2.integral(shown)
    v, u = np.mgrid[0:height:4, 0:width:4]
    places = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    radius = _radii(body, places)
    low, high = places - radius[:, None], places + radius[:, None]
    size = [width, height]
    a, b = (
        np.clip(np.nan_to_num(low).round(), 0, size).astype(int),
        np.clip(np.nan_to_num(high).round(), 0, size).astype(int),
    )
    sums, area = (
        t[b[:, 1], b[:, 0]] - t[a[:, 1], b[:, 0]] - t[b[:, 1], a[:, 0]] + t[a[:, 1], a[:, 0]] for t in (total, counted)
    )
    box = np.maximum(4 * radius**2, 1.0)
    area = box if hidden is None else np.sqrt(np.maximum(area, 1.0) * box)
    means = np.where(radius > 1.5, sums / area, -np.inf)
    found: list[tuple[float, Floats]] = []
    for _ in range(count):
        best = int(np.argmax(means))
        if means[best] < 0.25:
            break
        found.append((float(means[best]), body.placed(places[best], np.zeros(4))))
        means[np.hypot(*(places - places[best]).T) < 2.2 * radius[best]] = -np.inf
    return found


def hidden_places(body: Body, hiding: Array) -> NDArray[np.bool_]:
    """Pixels (H, W) at which a body's centre would lie behind what is at depths (H, W)."""
    height, width = hiding.shape
    poses = [body.placed(np.array([width / 2, row]), np.zeros(4)) for row in range(height)]
    depths = np.array([body.depth(pose) if np.isfinite(pose).all() else np.inf for pose in poses])
    return np.asarray(hiding < depths[:, None])


def _radii(body: Body, places: Floats) -> Floats:
    """Radius (M,) [px] of a body with its centre at places (M, 2), zero where it cannot be."""
    rows = np.unique(places[:, 1])
    middle = float(np.median(places[:, 0]))
    radii = []
    for row in rows:
        pose = body.placed(np.array([middle, row]), np.zeros(4))
        radii.append(body.radius(pose) if np.isfinite(pose).all() else 0.0)
    return np.asarray(radii)[np.searchsorted(rows, places[:, 1])]
