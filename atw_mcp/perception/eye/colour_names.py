"""Colour names: the probability that people call a pixel's colour by a word, from a survey of names, and the word that
a description says."""

from __future__ import annotations

import re
from functools import lru_cache

import cv2
import numpy as np
from matplotlib.colors import CSS4_COLORS, XKCD_COLORS, to_rgb
from scipy.ndimage import gaussian_filter, map_coordinates

from atw_mcp.perception.eye.pixels import Array, Bytes

WORDS = ("red", "brown", "orange", "yellow", "green", "cyan", "blue", "purple", "pink", "grey", "white", "black")
BINS = 32  # of each channel
CELL = 3.0  # [CIELAB] of the grid of densities
SPREAD = 9.0  # [CIELAB] of the colours that a name stands for: about the distance to the next name of its word
SHADES = (1.0, 1.4, 2.0)  # a body's paint is brighter than its pixels by these: sides turned from the light
LOW, SIZE = np.array([-10.0, -100.0, -120.0]), (40, 70, 80)  # of the grid, in L, a, b
LIGHTNESS = 30.0  # [CIELAB] of a grey body about its name: light and shade
UNKNOWN = 1e-8  # density of what no name describes


@lru_cache(maxsize=2)
def _tables(shades: tuple[float, ...]) -> dict[str, Array]:
    """Log probability (BINS^3,) of each word over BGR levels, all words being equally common (XKCD survey, 2010).

    shades: factors by which the paint may be brighter. Of names such as "dark sea green" the last word counts; others,
    such as "salmon", are left to what these say.
    """
    counts: dict[str, Array] = {}
    for name, code in XKCD_COLORS.items():
        word = name.removeprefix("xkcd:").split()[-1]
        if word in WORDS:
            lab = cv2.cvtColor(np.array([[to_rgb(code)]], np.float32), cv2.COLOR_RGB2LAB)[0, 0]
            grid = counts.setdefault(word, np.zeros(SIZE, np.float32))
            grid[tuple(np.round((lab - LOW) / CELL).astype(int))] += 1
    level = (np.arange(BINS, dtype=np.float32) + 0.5) / BINS
    bgr = np.stack(np.meshgrid(level, level, level, indexing="ij"), axis=-1).reshape(1, -1, 3)
    most = 1 / bgr.max(axis=-1, keepdims=True)  # no paint reflects more light than there is
    places = [
        (cv2.cvtColor(bgr * np.minimum(np.float32(s), most), cv2.COLOR_BGR2LAB)[0] - LOW).T / CELL for s in shades
    ]
    density = {}
    for word, grid in counts.items():
        smooth = gaussian_filter(grid / grid.sum(), SPREAD / CELL)
        density[word] = sum(map_coordinates(smooth, p, order=1) for p in places) + UNKNOWN
    everything = np.sum(list(density.values()), axis=0)
    return {word: np.log(own / everything).astype(np.float32) for word, own in density.items()}


def log_name(levels: Bytes, word: str, shades: tuple[float, ...] = SHADES) -> Array:
    """Log probability (...,) that pixels (..., 3) of BGR bytes are called by a word. Raises KeyError for no colour."""
    index = levels.astype(np.int32) * BINS // 256
    return np.asarray(_tables(shades)[word][(index[..., 0] * BINS + index[..., 1]) * BINS + index[..., 2]])


def chances(levels: Bytes, shades: tuple[float, ...] = SHADES) -> dict[str, float]:
    """Mean probability over pixels (M, 3) of BGR bytes that they are called by each word."""
    return {word: float(np.exp(log_name(levels, word, shades)).mean()) for word in WORDS}


def colour_word(text: str) -> str | None:
    """Return the word for the longest colour's name in a description; None where there is none.

    Names are those of the XKCD colour survey (2010) and of CSS, as matplotlib has them.
    """
    words = ["grey" if word == "gray" else word for word in re.findall(r"[a-z]+", text.lower())]
    for length in (3, 2, 1):
        for first in range(len(words) - length, -1, -1):
            found = _word(words[first : first + length])
            if found is not None:
                return found
    return None


def colour_name(text: str) -> str | None:
    """Return the word for a colour in a description; of a grey with the "light" or "dark" that is said of it."""
    word = colour_word(text)
    shade = next((s for s in ("light", "dark") if s in text.lower()), None)
    return f"{shade} {word}" if word == "grey" and shade is not None else word


def _word(words: list[str]) -> str | None:
    code = XKCD_COLORS.get(f"xkcd:{' '.join(words)}") or CSS4_COLORS.get("".join(words))
    if words[-1] in WORDS:
        return words[-1] if code is not None or len(words) == 1 else None
    if code is None:
        return None
    likely = chances(np.round(255 * np.array([to_rgb(code)[::-1]])).astype(np.uint8), (1.0,))
    return max(likely, key=lambda word: likely[word])


def log_look(levels: Bytes, name: str) -> float:
    """Log probability that a body of pixels (M, 3) of BGR bytes is called by a name: of the mean over its pixels, which
    are partly in shade; greys, as light or dark grey, by their lightness too."""
    if not len(levels):
        return -np.inf
    word = name.split()[-1]
    grey = word == "grey"  # metal has all shades of it
    look = float(
        np.log(sum(np.exp(log_name(levels, w)).mean() for w in ((word, "black", "white") if grey else (word,))))
    )
    if grey:
        own, seen = (
            cv2.cvtColor(np.asarray(c, np.float32).reshape(1, 1, 3), cv2.COLOR_BGR2LAB)[0, 0, 0]
            for c in (to_rgb(XKCD_COLORS[f"xkcd:{name}"])[::-1], np.median(levels, axis=0) / 255)
        )
        look -= 0.5 * float((own - seen) / LIGHTNESS) ** 2
    return look
