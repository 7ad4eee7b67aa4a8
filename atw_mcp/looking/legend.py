"""Legends of pictures: a mark and what it means, in rows below a picture, each mark drawn as in the picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from atw_mcp.looking.overlay import DARK, FINE_BITS, FONT, FONT_SCALE, Canvas, Color, Image, Style, fine

GROUND: Color = (44, 40, 38)  # blue, green, red
ROW = 24  # [px]
SAMPLE = 30  # [px] width of a mark
SPACE = 18  # [px] between entries
STAR = 8  # [px] radius
Mark = Callable[[Canvas, tuple[float, float]], None]


@dataclass(frozen=True)
class Entry:
    """A mark with its meaning. mark: draws it about a point of a canvas."""

    text: str
    mark: Mark


def legend(entries: Sequence[Entry], width: int) -> Image:
    """Rows (h, width, 3) with the entries from left to right; h is 0 without entries."""
    rows: list[list[tuple[float, Entry]]] = []
    x = float(width)
    for entry in entries:
        needs = SAMPLE + 6 + cv2.getTextSize(entry.text, FONT, FONT_SCALE, 1)[0][0] + SPACE
        if x + needs - SPACE > width:
            rows.append([])
            x = 8.0
        rows[-1].append((x, entry))
        x += needs
    canvas = Canvas(np.full((ROW * len(rows), width, 3), GROUND, np.uint8), 1.0)
    for k, row in enumerate(rows):
        for left, entry in row:
            entry.mark(canvas, (left + SAMPLE / 2, ROW * (k + 0.5)))
            canvas.write(entry.text, (left + SAMPLE + 6, ROW * (k + 0.5) + 5))
    return canvas.image


def line(color: Color, style: Style = "solid", *, thin: bool = False) -> Mark:
    """A piece of a path or an outline."""
    return partial(_line, color=color, style=style, thin=thin)


def dot(color: Color) -> Mark:
    """A dot on a path."""
    return partial(_dot, color=color)


def arrow(color: Color) -> Mark:
    """A path with its direction."""
    return partial(_arrow, color=color)


def star(color: Color, *, filled: bool = True) -> Mark:
    """A collision; not filled: one that is to come."""
    return partial(draw_star, color=color, filled=filled)


def cross(color: Color, size: int = 8) -> Mark:
    """A measured position, or something that is gone."""
    return partial(draw_cross, color=color, size=size)


def draw_star(canvas: Canvas, at: tuple[float, float], color: Color, *, filled: bool = True) -> None:
    """A star with eight points, which no object looks like."""
    angle = np.arange(16) * (np.pi / 8)
    radius = np.where(np.arange(16) % 2 == 0, STAR, 0.45 * STAR)
    corners = np.asarray(at) + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    polygon = fine(corners)
    cv2.polylines(canvas.image, [polygon], True, DARK, 4, cv2.LINE_AA, FINE_BITS)
    if filled:
        cv2.fillPoly(canvas.image, [polygon], color, cv2.LINE_AA, FINE_BITS)
    else:
        cv2.polylines(canvas.image, [polygon], True, color, 1, cv2.LINE_AA, FINE_BITS)


def draw_cross(canvas: Canvas, at: tuple[float, float], color: Color, size: int = 8) -> None:
    """A tilted cross on dark ground; size [px]."""
    x, y = round(at[0]), round(at[1])
    thick = max(1, size // 7)
    cv2.drawMarker(canvas.image, (x, y), DARK, cv2.MARKER_TILTED_CROSS, size + 1, thick + 2, cv2.LINE_AA)
    cv2.drawMarker(canvas.image, (x, y), color, cv2.MARKER_TILTED_CROSS, size, thick, cv2.LINE_AA)


def draw_arrow(canvas: Canvas, tip: tuple[float, float], along: tuple[float, float], color: Color) -> None:
    """A head of an arrow with its tip at a point, in the direction `along`."""
    forward = np.asarray(along) / np.hypot(*along)
    aside = np.array([-forward[1], forward[0]])
    head = np.stack([np.zeros(2), -11.0 * forward + 5.0 * aside, -11.0 * forward - 5.0 * aside]) + np.asarray(tip)
    cv2.polylines(canvas.image, [fine(head)], True, DARK, 3, cv2.LINE_AA, FINE_BITS)
    cv2.fillPoly(canvas.image, [fine(head)], color, cv2.LINE_AA, FINE_BITS)


def _line(canvas: Canvas, at: tuple[float, float], color: Color, style: Style, *, thin: bool) -> None:
    x, y = at
    points = np.array([[x - SAMPLE / 2, y], [x + SAMPLE / 2, y]])
    if thin:
        canvas.faint(points, color)
    else:
        canvas.path(points, color, dashed_from=0 if style == "dashed" else None)


def _dot(canvas: Canvas, at: tuple[float, float], color: Color) -> None:
    x, y = at
    canvas.path(np.array([[x - SAMPLE / 2, y], [x, y], [x + SAMPLE / 2, y]]), color, [1])


def _arrow(canvas: Canvas, at: tuple[float, float], color: Color) -> None:
    x, y = at
    _line(canvas, at, color, "solid", thin=False)
    draw_arrow(canvas, (x + 6, y), (1.0, 0.0), color)
