"""Places where a body was said to rest that look the same while it is elsewhere: what is seen there is no body."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.known.finding import Candidate
from atw_mcp.perception.known.outlines import around
from atw_mcp.perception.known.settings import SETTINGS
from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]


def unchanged(path: Sequence[Candidate | None], frames: Frames) -> list[Candidate]:
    """Return the places of a path's rests that a frame shows alike, with the body there and with it elsewhere.

    frames (T, H, W, 3). Compared are medians over some frames of either kind, smoothed, beside the light around them.
    """
    found = []
    for place, rows in _rests(path):
        others = [t for t, c in enumerate(path) if c is not None and not c.near(place, SETTINGS.elsewhere)]
        if len(others) < SETTINGS.least_free_rows:
            continue
        if _change(place, frames, rows, others) < SETTINGS.changed:
            found.append(place)
    return found


def _rests(path: Sequence[Candidate | None]) -> Iterator[tuple[Candidate, list[int]]]:
    """Yield each place at which a body stays for some frames, and these frames."""
    rows: list[int] = []
    first: Candidate | None = None
    for t, candidate in enumerate([*path, None]):
        if candidate is not None and first is not None and candidate.near(first, SETTINGS.stays):
            rows.append(t)
            continue
        if first is not None and len(rows) >= SETTINGS.least_free_rows:
            yield first, rows
        first, rows = candidate, [t]


def _change(place: Candidate, frames: Frames, rows: Sequence[int], others: Sequence[int]) -> float:
    """Mean change [levels] of the pixels of a place between frames, in the light of their surroundings."""
    window, away = around(place, SETTINGS.outer, (frames.shape[1], frames.shape[2]))
    images = []
    for kind in (rows, others):
        chosen = [kind[i] for i in np.unique(np.linspace(0, len(kind) - 1, SETTINGS.compared).round().astype(int))]
        middle = np.median(frames[chosen][(slice(None), *window)].astype(np.float32), axis=0)
        images.append(cv2.GaussianBlur(middle, (0, 0), max(SETTINGS.smooth * place.radius, 0.5)))
    there, without = (np.asarray(image, dtype=float).reshape(*away.shape, -1) for image in images)
    ring = (away > SETTINGS.reach) & (away < SETTINGS.outer)
    if ring.any():  # light that changes, changes both
        there = there * (np.median(without[ring], axis=0) / np.maximum(np.median(there[ring], axis=0), 1.0))
    return float(np.abs(there - without)[away < SETTINGS.inner].mean())
