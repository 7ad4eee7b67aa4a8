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
Style = Literal["solid", "dotted"]
Box = tuple[float, float, float, float]  # left, top, right, bottom

SIMULATED: Color = (255, 60, 255)
OBSERVED: Color = (255, 255, 255)
DARK: Color = (20, 20, 20)
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.45
TOP_LINE = 20  # [px] kept free for the line that says which frame this is
LONGEST_SIDE = 960  # [px] larger frames are reduced to it
SMALLEST_SIDE = 720  # [px] smaller ones are enlarged, so that a thin outline is still seen
ROOM = 560_000  # bytes of all pictures of one result: 1 MB is the limit of some clients, base64 adds a third


@dataclass(frozen=True)
class Canvas:
    """A picture being drawn on, how much larger it is than the frame it came from, and where names stand."""

    image: Image
    scale: float
    taken: list[Box] = field(default_factory=list)

    @classmethod
    def of(cls, frame: Image) -> Canvas:
        """A copy of a frame (H, W, 3), brought to a size at which outlines and names are legible."""
        longest = max(frame.shape[:2])
        scale = min(LONGEST_SIDE / longest, 1.0) if longest > LONGEST_SIDE else max(SMALLEST_SIDE / longest, 1.0)
        if scale == 1.0:
            return cls(frame.copy(), 1.0)
        method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        return cls(_bytes(cv2.resize(frame, None, fx=scale, fy=scale, interpolation=method)), scale)

    def outline(self, mask: Mask, color: Color, style: Style = "solid") -> None:
        """Draw the outline of a mask of the original frame."""
        large = mask.astype(np.uint8)
        if self.scale != 1.0:
            size = (self.image.shape[1], self.image.shape[0])
            large = _bytes(cv2.resize(large, size, interpolation=cv2.INTER_NEAREST))
        found, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        if style == "solid":
            cv2.drawContours(self.image, found, -1, DARK, 3, cv2.LINE_AA)
            cv2.drawContours(self.image, found, -1, color, 1, cv2.LINE_8)
            return
        for contour in found:
            points = contour[:, 0]
            for start in range(0, len(points), 8):
                cv2.polylines(self.image, [points[start : start + 5]], False, DARK, 2, cv2.LINE_AA)
                cv2.polylines(self.image, [points[start : start + 4]], False, color, 1, cv2.LINE_AA)

    def path(self, points: NDArray[np.float64], color: Color) -> None:
        """Draw a line through points (k, 2) of the original frame; NaN breaks it."""
        scaled = np.asarray(points) * self.scale
        for a, b in pairwise(scaled):
            if np.all(np.isfinite([a, b])) and np.abs([a, b]).max() < 1e5:
                cv2.line(self.image, _pixel(a), _pixel(b), color, 1, cv2.LINE_AA)

    def name(self, text: str, mask: Mask, color: Color) -> None:
        """Write a name beside a mask of the original frame: above, below, right or left, where no other name is."""
        rows, columns = np.nonzero(mask)
        if not len(rows):
            return
        (width, height), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
        left, right, top, bottom = (
            self.scale * v for v in (columns.min(), columns.max() + 1, rows.min(), rows.max() + 1)
        )
        centred, level = (left + right - width) / 2, (top + bottom + height) / 2
        places = [
            (centred, top - 6),
            (centred, bottom + height + 6),
            (right + 5, level),
            (left - width - 5, level),
        ]
        boxes = [self._inside((x, y - height - 2, x + width, y + 3)) for x, y in places]
        chosen = next((box for box in boxes if not any(_overlap(box, other) for other in self.taken)), boxes[0])
        self.taken.append(chosen)
        self.write(text, (chosen[0], chosen[3] - 3), color)

    def write(self, text: str, at: tuple[float, float], color: Color = OBSERVED) -> None:
        """Write text with its lower left corner at a point of the canvas, legible on any ground."""
        x, y = _pixel(np.asarray(at))
        for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            cv2.putText(self.image, text, (x + dx, y + dy), FONT, FONT_SCALE, DARK, 1, cv2.LINE_AA)
        cv2.putText(self.image, text, (x, y), FONT, FONT_SCALE, color, 1, cv2.LINE_AA)

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


def encoded(pictures: dict[str, Image]) -> dict[str, bytes]:
    """JPEG files by name ("frame 12" becomes "frame 12.jpg"), together no larger than `ROOM`."""
    for quality, scale in ((92, 1.0), (80, 1.0), (75, 0.75), (70, 0.5), (60, 0.35)):
        files = {f"{name}.jpg": _jpeg(image, quality, scale) for name, image in pictures.items()}
        if sum(map(len, files.values())) <= ROOM:
            break
    return files


def _jpeg(image: Image, quality: int, scale: float) -> bytes:
    if scale != 1.0:
        image = _bytes(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    done, file = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"a picture of {image.shape[1]} x {image.shape[0]} pixels could not be encoded")
    return bytes(file.tobytes())


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _bytes(image: Any) -> Image:
    return np.asarray(image, dtype=np.uint8)


def _pixel(point: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))
