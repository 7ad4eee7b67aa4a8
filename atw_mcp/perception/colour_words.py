"""The colour that a description says, as one of the words that the eye searches for."""

from __future__ import annotations

import colorsys
import re

from matplotlib.colors import CSS4_COLORS, XKCD_COLORS, to_rgb

HUES = {  # OpenCV's hue, 0..180
    "red": (-9, 8),
    "brown": (8, 20),
    "orange": (6, 20),
    "yellow": (20, 37),
    "green": (37, 84),
    "cyan": (84, 102),
    "blue": (102, 131),
    "purple": (131, 169),
    "pink": (150, 172),
}
GREYS = ("grey", "white", "black")
GREY = 0.2  # saturation below which a colour is grey, black or white
DARK, BRIGHT = 0.25, 0.85  # brightness below which a grey is black, above which it is white
BROWN = 0.65  # brightness below which an orange is brown
RED = 172  # OpenCV's hue from which on colours are red again


def colour_word(text: str) -> str | None:
    """Return the eye's word for the longest colour's name in a description; None where there is none.

    Names are those of the XKCD colour survey (2010) and of CSS, as matplotlib has them.
    """
    words = re.findall(r"[a-z]+", text.lower())
    for length in (3, 2, 1):
        for first in range(len(words) - length, -1, -1):
            found = _word(words[first : first + length])
            if found is not None:
                return found
    return None


def colour_name(text: str) -> str | None:
    """Return the eye's word for a colour in a description; of a grey with the "light" or "dark" that is said of it."""
    word = colour_word(text)
    shade = next((s for s in ("light", "dark") if s in text.lower()), None)
    return f"{shade} {word}" if word == "grey" and shade is not None else word


def _word(words: list[str]) -> str | None:
    words = ["grey" if word == "gray" else word for word in words]
    name = " ".join(words)
    if len(words) == 1 and (name in HUES or name in GREYS):
        return name
    code = XKCD_COLORS.get(f"xkcd:{name}") or CSS4_COLORS.get(name.replace(" ", ""))
    if code is None:
        return None
    if words[-1] in HUES or words[-1] in GREYS:
        return words[-1]
    hue, saturation, value = colorsys.rgb_to_hsv(*to_rgb(code))
    if saturation < GREY:
        return "black" if value < DARK else "white" if value > BRIGHT else "grey"
    turned = hue * 180 - (180 if hue * 180 > RED else 0)
    fits = [word for word, (low, high) in HUES.items() if low <= turned <= high]
    if "brown" in fits and "orange" in fits:
        return "brown" if value < BROWN else "orange"
    return fits[0] if fits else "pink"
