"""Colour names and #rrggbb text to numbers."""

from __future__ import annotations

import re

NAMED: dict[str, tuple[int, int, int]] = {
    "black": (30, 30, 30),
    "blue": (42, 75, 215),
    "brown": (129, 74, 25),
    "cyan": (41, 208, 208),
    "gold": (218, 165, 32),
    "gray": (110, 110, 110),
    "green": (29, 135, 40),
    "lime": (120, 210, 40),
    "magenta": (205, 40, 190),
    "navy": (20, 30, 110),
    "olive": (120, 120, 30),
    "orange": (240, 130, 20),
    "pink": (240, 140, 170),
    "purple": (129, 38, 192),
    "red": (190, 35, 35),
    "silver": (190, 190, 195),
    "teal": (20, 128, 128),
    "turquoise": (60, 210, 195),
    "violet": (150, 90, 220),
    "white": (245, 245, 245),
    "yellow": (250, 225, 40),
}
"""Display colours of the names perception and people use; `grey` reads as `gray`."""

PALETTE: tuple[str, ...] = ("blue", "orange", "green", "purple", "red", "cyan", "yellow", "brown", "magenta", "teal")
"""Colours given in turn to objects whose colour nobody stated."""


def rgb(color: str | None) -> tuple[int, int, int] | None:
    """Red, green, blue in 0..255 of a name or #rrggbb; None when the text names no known colour."""
    if color is None:
        return None
    text = color.strip().lower().replace("grey", "gray")
    if re.fullmatch(r"#[0-9a-f]{6}", text):
        return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)
    # "dark red metal" is still a red: the last word that is a colour decides
    known = [word for word in re.split(r"[\s_-]+", text) if word in NAMED]
    return NAMED[known[-1]] if known else None


def display_color(color: str | None, index: int) -> tuple[int, int, int]:
    """The colour to draw object number `index` in: its own when known, else one of the palette."""
    return rgb(color) or NAMED[PALETTE[index % len(PALETTE)]]
