"""Colours of objects: their own where known, else of a palette that colour-blind people can read; no two alike."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from polyworld.world.colors import rgb

PALETTE = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#f0e442", "#999999")
"""Okabe & Ito (2008), black left out."""
ALIKE = 40.0  # distance of two colours in RGB, 0..255 each, below which small areas of them look the same
SHADES = (1.0, 0.7, 1.35, 0.5, 1.6)  # brightness tried in turn


def hex_color(color: tuple[int, int, int] | np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    """Return #rrggbb of red, green, blue in 0..255."""
    return "#" + "".join(f"{int(np.clip(round(float(value)), 0, 255)):02x}" for value in color)


def distinct_colors(wanted: Mapping[str, str | None]) -> dict[str, str]:
    """Return a colour #rrggbb for each name, near the wanted one (a name or #rrggbb; None: any) and unlike the others.

    Objects of equal colour get shades of it, in the order of the names; those without one get the palette's.
    """
    given: dict[str, str] = {}
    taken: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
    known = {name: rgb(text) for name, text in wanted.items()}
    for name in sorted(wanted, key=lambda n: known[n] is None):  # stable: those with a colour of their own first
        own = known[name]
        bases = [own] if own is not None else [rgb(text) for text in PALETTE]
        choices = [np.asarray(base, dtype=float) * shade for shade in SHADES for base in bases]
        choices = [np.clip(choice, 0.0, 255.0) for choice in choices]
        gaps = [min((float(np.linalg.norm(choice - other)) for other in taken), default=np.inf) for choice in choices]
        first = next((k for k, gap in enumerate(gaps) if gap >= ALIKE), int(np.argmax(gaps)))
        taken.append(choices[first])
        given[name] = hex_color(choices[first])
    return {name: given[name] for name in wanted}
