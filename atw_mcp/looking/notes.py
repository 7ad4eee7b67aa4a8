"""Lists of words beside pictures, in lines as wide as there is room, saying how many items had none."""

from __future__ import annotations

from collections.abc import Sequence

import cv2

from atw_mcp.looking.overlay import FONT, FONT_SCALE, Canvas, Color

PITCH = 19  # [px] between lines
INDENT = "   "


def write_list(
    canvas: Canvas, title: str, items: Sequence[str], color: Color, at: tuple[float, float], room: tuple[int, int]
) -> None:
    """Write a title and a list of items below it, the upper left corner at a point; room: width, height [px]."""
    most = room[1] // PITCH
    lines, shown = wrapped(title, room[0]), 0
    for number, item in enumerate(items, start=1):
        more = wrapped(INDENT + item, room[0])
        if len(lines) + len(more) + (number < len(items)) > most:
            break
        lines, shown = [*lines, *more], number
    if shown < len(items):
        lines.append(f"{INDENT}and {len(items) - shown} more")
    for k, text in enumerate(lines[:most]):
        canvas.write(text, (at[0], at[1] + PITCH * (k + 0.75)), color)


def wrapped(text: str, width: int) -> list[str]:
    """Text in lines no wider than `width` [px], broken at spaces; further lines are indented."""
    lines, indent = [""], len(text) - len(text.lstrip())
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines[-1].strip() else " " * indent + word
        if lines[-1].strip() and cv2.getTextSize(longer, FONT, FONT_SCALE, 1)[0][0] > width:
            lines.append(" " * indent + INDENT + word)
        else:
            lines[-1] = longer
    return lines
