"""Drawing on frames: outlines in two styles, names, paths; and encoding within the room a message has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Color = tuple[int, int, int]  # blue, green, red, as OpenCV has it
Crop = tuple[int, int, int, int]  # left, top, width, height, pixels of the frame
Style = Literal["solid", "dashed"]
Box = tuple[float, float, float, float]  # left, top, right, bottom

SIMULATED: Color = (255, 60, 255)
SIMULATED_NAME: Color = (255, 170, 255)  # lighter: thin letters are read by their brightness
OBSERVED: Color = (255, 255, 255)
DARK: Color = (20, 20, 20)
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.45
TOP_LINE = 20  # [px] kept free for the line that says which frame this is
HALO = 3  # [px] dark ground about writing
DASH, GAP = 5, 4  # [px] of dashed lines
FINE_BITS = 4  # binary places of a coordinate
AROUND = (
    (0, -1),
    (0, 1),
    (1, 0),
    (-1, 0),
    (0.5, -1),
    (-0.5, -1),
    (0.5, 1),
    (-0.5, 1),
    (1, -1),
    (-1, -1),
    (1, 1),
    (-1, 1),
)
LONGEST_SIDE = 960  # [px] larger frames are reduced to it
LARGEST_SIDE = 1600  # [px] of a picture whose zoom was asked for
SMALLEST_SIDE = 720  # [px] smaller ones are enlarged, so that a thin outline is still seen
ROOM = 560_000  # bytes of all pictures of one result: 1 MB is the limit of some clients, base64 adds a third


@dataclass(frozen=True)
class Canvas:
    """A picture being drawn on, how much larger it is than the frame it came from, the corner (left, top) of the part
    of the frame that it shows, and where names stand."""

    image: Image
    scale: float
    taken: list[Box] = field(default_factory=list)
    corner: tuple[int, int] = (0, 0)

    @classmethod
    def of(cls, frame: Image, crop: Crop | None = None, zoom: float | None = None) -> Canvas:
        """A copy of a frame (H, W, 3), brought to a size at which outlines and names are legible.

        crop: the part shown; zoom: how many times as large. Raises ValueError for a part outside the frame and for a
        picture that would be too large.
        """
        left, top, width, height = crop or (0, 0, frame.shape[1], frame.shape[0])
        part = frame[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)]
        if min(part.shape[:2]) < 2:
            raise ValueError(
                f"crop {[left, top, width, height]} (left, top, width, height) lies outside the frame of "
                f"{frame.shape[1]} x {frame.shape[0]}"
            )
        longest = max(part.shape[:2])
        if zoom is not None and zoom * longest > LARGEST_SIDE:
            raise ValueError(
                f"{part.shape[1]} x {part.shape[0]} pixels at zoom {zoom:g} are more than {LARGEST_SIDE} along a "
                f"side: zoom at most {LARGEST_SIDE / longest:.2g}, or a smaller crop"
            )
        scale = min(LONGEST_SIDE / longest, 1.0) if longest > LONGEST_SIDE else max(SMALLEST_SIDE / longest, 1.0)
        scale = scale if zoom is None else zoom
        corner = max(left, 0), max(top, 0)
        if scale == 1.0:
            return cls(part.copy(), 1.0, corner=corner)
        method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        return cls(_bytes(cv2.resize(part, None, fx=scale, fy=scale, interpolation=method)), scale, corner=corner)

    def tint(self, mask: Mask, color: Color, share: float = 0.45) -> None:
        """Lay a colour over a mask of the original frame."""
        inside = self._large(mask) > 0
        mixed = self.image[inside] * (1.0 - share) + np.asarray(color, dtype=float) * share
        self.image[inside] = np.rint(mixed).astype(np.uint8)

    def outline(self, mask: Mask, color: Color, style: Style = "solid") -> None:
        """Draw the outline of a mask of the original frame; dashes are to be drawn last, over what is solid."""
        found, _ = cv2.findContours(self._large(mask), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        if style == "solid":
            cv2.drawContours(self.image, found, -1, DARK, 5, cv2.LINE_AA)
            cv2.drawContours(self.image, found, -1, color, 2, cv2.LINE_AA)
            return
        for contour in found:
            points = contour[:, 0]
            dashes = [points[start : start + DASH] for start in range(0, len(points), DASH + GAP)]
            cv2.polylines(self.image, dashes, False, DARK, 4, cv2.LINE_AA)
            cv2.polylines(self.image, dashes, False, color, 2, cv2.LINE_AA)

    def path(
        self, points: NDArray[np.float64], color: Color, marks: Sequence[int] = (), dashed_from: int | None = None
    ) -> None:
        """Draw a line through points (k, 2) of the original frame; NaN breaks it.

        marks: points that get a dot. dashed_from: the point from which the line is dashed.
        """
        scaled = (np.asarray(points) - np.asarray(self.corner)) * self.scale
        drawable = np.all(np.isfinite(scaled), axis=1) & (np.abs(scaled).max(axis=1, initial=0.0) < 1e5)
        pieces: list[NDArray[np.int32]] = []
        travelled = 0.0
        for k, (a, b) in enumerate(pairwise(scaled)):
            if not (drawable[k] and drawable[k + 1]):
                continue
            if dashed_from is None or k < dashed_from:
                pieces.append(fine(np.stack([a, b])))
                continue
            length = float(np.linalg.norm(b - a))
            pieces += [fine(a + np.outer(part, b - a)) for part in _dashes(travelled, length)]
            travelled += length
        cv2.polylines(self.image, pieces, False, DARK, 3, cv2.LINE_AA, FINE_BITS)
        cv2.polylines(self.image, pieces, False, color, 1, cv2.LINE_AA, FINE_BITS)
        for k in marks:
            if drawable[k]:
                cv2.circle(self.image, _pixel(scaled[k]), 4, DARK, -1, cv2.LINE_AA)
                cv2.circle(self.image, _pixel(scaled[k]), 2, color, -1, cv2.LINE_AA)

    def faint(self, points: NDArray[np.float64], color: Color, share: float = 0.8) -> None:
        """Draw a thin dotted line through points (k, 2) of the canvas that lets what is below show through."""
        drawable = np.all(np.isfinite(points), axis=1) & (np.abs(points).max(axis=1, initial=0.0) < 1e5)
        ink = np.zeros(self.image.shape[:2], np.uint8)
        pieces, travelled = [], 0.0
        for k, (a, b) in enumerate(pairwise(points)):
            if drawable[k] and drawable[k + 1]:
                length = float(np.linalg.norm(b - a))
                pieces += [fine(a + np.outer(part, b - a)) for part in _dashes(travelled, length, 3, 3)]
                travelled += length
        cv2.polylines(ink, pieces, False, 255, 1, cv2.LINE_AA, FINE_BITS)
        inked = ink > 0
        weight = ink[inked][:, None] / 255.0 * share
        mixed = self.image[inked] * (1.0 - weight) + weight * np.asarray(color, dtype=float)
        self.image[inked] = np.rint(mixed).astype(np.uint8)

    def names(self, masks: dict[str, Mask], color: Color, others: Mask | None = None) -> None:
        """Write each name near its mask of the original frame where it covers least, with a line when it is away.

        A name keeps off names already written, the other masks and `others`, and then off its own mask.
        """
        large = {name: self._large(mask) for name, mask in masks.items()}
        large = {name: mask for name, mask in large.items() if mask.any()}
        shape = self.image.shape[:2]
        union = np.zeros(shape, np.uint8) if others is None else self._large(others)
        for mask in large.values():
            union = _bytes(np.maximum(union, mask))
        everything = np.asarray(cv2.integral(union))
        chosen: dict[str, Box] = {}
        for name in sorted(large, key=lambda name: int(np.argmax(large[name].any(axis=1)))):
            chosen[name] = self._place(name, large[name], everything)
            self.taken.append(chosen[name])
        for name, box in chosen.items():
            self._leader(box, large[name], color)
        for name, box in chosen.items():
            self.write(name, (box[0], box[3] - 3), color)

    def _place(self, text: str, mask: Image, everything: NDArray[Any]) -> Box:
        """The box for a name, of those around a mask, that covers least."""
        (width, height), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
        width, height = width + 2, height + 5
        left, top, columns, rows = cv2.boundingRect(mask)
        own = np.asarray(cv2.integral(mask))
        best, least = (0.0, 0.0, 0.0, 0.0), float("inf")
        for away in (4, 14, 26, 40, 60, 85):
            for rank, (dx, dy) in enumerate(AROUND):
                x = left + columns / 2 + dx * (columns / 2 + width / 2 + away)
                y = top + rows / 2 + dy * (rows / 2 + height / 2 + away)
                box = self._inside((x - width / 2, y - height / 2, x + width / 2, y + height / 2))
                itself = _pixels(own, box)
                cost = 20.0 * (_pixels(everything, box) - itself) + 4.0 * itself + 3.0 * away + 0.5 * rank
                cost += 100.0 * sum(_shared(box, other) for other in self.taken)
                if cost < least:
                    best, least = box, cost
        return best

    def _leader(self, box: Box, mask: Image, color: Color) -> None:
        """A line from a name to its mask, where they are apart."""
        rows, columns = np.nonzero(mask)
        x, y = np.clip(columns, box[0], box[2]), np.clip(rows, box[1], box[3])
        nearest = int(np.argmin(np.hypot(columns - x, rows - y)))
        if np.hypot(columns[nearest] - x[nearest], rows[nearest] - y[nearest]) > 10:
            ends = (round(float(x[nearest])), round(float(y[nearest]))), (int(columns[nearest]), int(rows[nearest]))
            cv2.line(self.image, *ends, DARK, 3, cv2.LINE_AA)
            cv2.line(self.image, *ends, color, 1, cv2.LINE_AA)

    def _large(self, mask: Mask) -> Image:
        """A mask of the original frame at the size of the canvas, 0 and 1."""
        left, top = self.corner
        size = (self.image.shape[1], self.image.shape[0])
        width, height = round(size[0] / self.scale), round(size[1] / self.scale)
        mask = mask[top : top + height, left : left + width]
        if self.scale == 1.0:
            return mask.astype(np.uint8)
        return _bytes(cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST))

    def write(self, text: str, at: tuple[float, float], color: Color = OBSERVED) -> None:
        """Write text with its lower left corner at a point of the canvas, legible on any ground."""
        x, y = _pixel(np.asarray(at))
        (width, height), below = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
        left, top = max(x - HALO, 0), max(y - height - below - HALO, 0)
        patch = self.image[top : y + below + HALO, left : x + width + 2 * HALO]
        if not patch.size:
            return
        ink = np.zeros(patch.shape[:2], np.uint8)
        cv2.putText(ink, text, (x - left, y - top), FONT, FONT_SCALE, 255, 1, cv2.LINE_AA)
        # The dark ground is the writing itself made wider: a thicker pen would draw other, wider letters.
        ground = cv2.dilate(ink, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * HALO + 1, 2 * HALO + 1)))
        for layer, tone in ((ground, DARK), (ink, color)):
            share = np.asarray(layer, dtype=float)[..., None] / 255.0
            patch[:] = np.rint(patch * (1.0 - share) + share * np.asarray(tone, dtype=float)).astype(np.uint8)

    def _inside(self, box: Box) -> Box:
        """The box moved into the picture, below the line on top."""
        height, width = self.image.shape[:2]
        dx = max(0.0, 2 - box[0]) - max(0.0, box[2] - width + 2)
        dy = max(0.0, TOP_LINE - box[1]) - max(0.0, box[3] - height + 2)
        return box[0] + dx, box[1] + dy, box[2] + dx, box[3] + dy


def contact_sheet(pictures: Sequence[Image], columns: int = 3) -> Image:
    """Pictures of one size side by side, row by row."""
    if not pictures or columns < 1:
        raise ValueError("a contact sheet needs at least one picture and one column")
    shapes = {p.shape for p in pictures}
    if len(shapes) > 1:
        raise ValueError(f"pictures of a contact sheet must have one size, got {sorted(shapes)}")
    columns = min(columns, len(pictures))
    height, width = pictures[0].shape[:2]
    rows = -(-len(pictures) // columns)
    sheet = np.zeros((rows * height, columns * width, 3), dtype=np.uint8)
    for k, picture in enumerate(pictures):
        y, x = divmod(k, columns)
        sheet[y * height : (y + 1) * height, x * width : (x + 1) * width] = picture
    return sheet


def encoded(pictures: dict[str, Image]) -> tuple[dict[str, bytes], float]:
    """JPEG files by name ("frame 12" becomes "frame 12.jpg"), together no larger than `ROOM`, and their scale."""
    for quality, scale in ((92, 1.0), (80, 1.0), (75, 0.75), (50, 0.75), (70, 0.5), (60, 0.35)):
        files = {f"{name}.jpg": _jpeg(image, quality, scale) for name, image in pictures.items()}
        if sum(map(len, files.values())) <= ROOM:
            break
    return files, scale


def _jpeg(image: Image, quality: int, scale: float) -> bytes:
    if scale != 1.0:
        image = _bytes(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    done, file = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"a picture of {image.shape[1]} x {image.shape[0]} pixels could not be encoded")
    return bytes(file.tobytes())


def _shared(a: Box, b: Box) -> float:
    """Area two boxes share [px^2]."""
    return max(0.0, min(a[2], b[2]) - max(a[0], b[0])) * max(0.0, min(a[3], b[3]) - max(a[1], b[1]))


def _pixels(integral: NDArray[Any], box: Box) -> float:
    """How many pixels of a mask, given as its integral image, a box covers."""
    rows, columns = integral.shape
    left, right = (min(max(round(v), 0), columns - 1) for v in (box[0], box[2]))
    top, bottom = (min(max(round(v), 0), rows - 1) for v in (box[1], box[3]))
    return float(integral[bottom, right] - integral[top, right] - integral[bottom, left] + integral[top, left])


def _dashes(travelled: float, length: float, dash: float = DASH, gap: float = GAP) -> list[NDArray[np.float64]]:
    """The parts (start, end), in 0..1, of a segment that are drawn, the line having come `travelled` px so far."""
    if length <= 0.0:
        return []
    period = float(dash + gap)
    first = np.floor(travelled / period) * period
    starts = np.arange(first, travelled + length, period) - travelled
    parts = np.clip(np.stack([starts, starts + dash], axis=1) / length, 0.0, 1.0)
    return [part for part in parts if part[1] > part[0]]


def fine(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Points as OpenCV takes them with `FINE_BITS` binary places."""
    return np.rint(points * 2.0**FINE_BITS).astype(np.int32)


def _bytes(image: Any) -> Image:
    return np.asarray(image, dtype=np.uint8)


def _pixel(point: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
