"""Likelihood of each colour for a body of a named colour, under any shading.

Shading multiplies a body's colour and leaves hue and saturation; the name says those, and brightness roughly. What
people call by a name is taken from the XKCD colour survey (2010) of 222,500 sessions, as matplotlib has it: the colour
of the name itself, and those of its shades ("dusty pink", "dark pink").
"""

from __future__ import annotations

import re
from functools import lru_cache

import numpy as np
from matplotlib.colors import CSS4_COLORS, XKCD_COLORS, to_rgb
from numpy.typing import NDArray

from atw_mcp.perception.appearance import bin_colours
from atw_mcp.perception.known.settings import SETTINGS

Floats = NDArray[np.float64]


def colour_word(text: str) -> str | None:
    """Return the longest colour's name in a description, as the survey spells it; None where there is none."""
    words = re.findall(r"[a-z]+", text.lower())
    for length in (3, 2, 1):
        for first in range(len(words) - length, -1, -1):
            name = " ".join(words[first : first + length]).replace("gray", "grey")
            if _prototypes(name) is not None:
                return name
    return None


@lru_cache(maxsize=256)
def _prototypes(name: str) -> tuple[tuple[float, float, float], ...] | None:
    """Colours r, g, b in 0..1: the name's own, then those of its shades; None for what names no colour."""
    own = XKCD_COLORS.get(f"xkcd:{name}") or CSS4_COLORS.get(name.replace(" ", ""))
    if own is None:
        return None
    shades = [code for key, code in XKCD_COLORS.items() if key.endswith((f" {name}", f":{name}"))]
    return (to_rgb(own), *(to_rgb(code) for code in shades))


@lru_cache(maxsize=64)
def word_likelihood(word: str) -> Floats:
    """Return log likelihood ratios (BIN_COUNT,) of the bins of `appearance` for a body called by a colour's name,
    relative to any colour. Raises KeyError for what names no colour.
    """
    prototypes = _prototypes(word)
    if prototypes is None:
        raise KeyError(word)
    colours = bin_colours()
    chroma, value = _chroma(colours), colours.max(axis=1)
    density = np.zeros(len(colours))
    for k, prototype in enumerate(prototypes):
        grey = max(prototype)
        dull = [grey - SETTINGS.duller * (grey - level) for level in prototype]
        own = _chroma(np.array([dull]))[0]
        off = _off(chroma, own)
        shade = (np.log(value + 0.05) - np.log(max(prototype) + 0.05) + SETTINGS.darker) / SETTINGS.value
        weight = 1.0 - SETTINGS.shades if k == 0 else SETTINGS.shades / max(len(prototypes) - 1, 1)
        density += weight * np.nan_to_num(_normalised(np.exp(-0.5 * (off**2 + shade**2))))
    likelihood: Floats = np.log((1.0 - SETTINGS.any_colour) * density * SETTINGS.typical + SETTINGS.any_colour)
    return likelihood


def _off(chroma: Floats, own: Floats) -> Floats:
    """Deviations (n,) [standard deviations] of colours from one: highlights and ambient light change its saturation
    more than its hue."""
    saturation = float(np.linalg.norm(own))
    along = own / saturation if saturation > 0.0 else np.array([1.0, 0.0])
    difference = chroma - own
    across = difference @ np.array([-along[1], along[0]])
    off: Floats = np.hypot(difference @ along / SETTINGS.saturation, across / SETTINGS.hue)
    return off


def _normalised(density: Floats) -> Floats:
    known = np.nan_to_num(density)
    scaled: Floats = known / known.sum()
    return scaled


def _chroma(rgb: Floats) -> Floats:
    """Saturation times the unit vector of the hue (n, 2) of colours (n, 3) in 0..1."""
    high, low = rgb.max(axis=1), rgb.min(axis=1)
    x = rgb[:, 0] - 0.5 * (rgb[:, 1] + rgb[:, 2])
    y = np.sqrt(0.75) * (rgb[:, 1] - rgb[:, 2])
    length = np.hypot(x, y)
    saturation = (high - low) / (high + SETTINGS.dim)
    unit = np.stack([x, y], axis=1) / np.maximum(length, 1e-9)[:, None]
    chroma: Floats = saturation[:, None] * unit
    return chroma
