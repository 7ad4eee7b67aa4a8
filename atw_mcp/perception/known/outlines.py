"""Masks of known bodies in a frame from where they are, and which of several look-alikes is which."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Array32, Mask
from atw_mcp.perception.known.bodies import Sizes
from atw_mcp.perception.known.finding import Candidate

Floats = NDArray[np.float64]

CORE, CORE_GAIN = 0.7, 1.0  # radii within which a pixel is rather the body's, and by how much (log likelihood)
FALL = 12.0  # cost of one radius outside the expected outline, squared
FARTHEST = 1.9  # radii from the centre that a body may reach
PIECE = 0.3  # of the largest piece, from which another is the same body behind something
MOST_ALIKE = 5  # look-alikes that sizes are to distinguish
UNKNOWN_SIZE = 0.5  # ln of a size ratio that counts where none was seen


def outlines(ratios: Sequence[Array32], places: Sequence[Candidate | None]) -> list[Mask]:
    """Return each body's mask (H, W) in a frame: pixels more likely its than another body's or none's.

    ratios: log likelihood ratios (H, W) of each body; places: where each is, None where it is not seen.
    """
    height, width = ratios[0].shape
    best, owner = np.zeros((height, width), dtype=np.float32), np.full((height, width), -1)
    for k, (ratio, place) in enumerate(zip(ratios, places, strict=True)):
        if place is None:
            continue
        reach = FARTHEST * place.radius
        rows = slice(max(int(place.y - reach), 0), min(int(place.y + reach) + 2, height))
        columns = slice(max(int(place.x - reach), 0), min(int(place.x + reach) + 2, width))
        y, x = np.mgrid[rows, columns]
        away = np.hypot(x - place.x, y - place.y) / place.radius
        smooth = cv2.blur(ratio, (3, 3))[rows, columns]
        score = smooth - FALL * np.maximum(away - 1.0, 0.0) ** 2 + CORE_GAIN * (away < CORE)
        take = (score > best[rows, columns]) & (away < FARTHEST)
        best[rows, columns][take], owner[rows, columns][take] = score[take], k
    return [_whole(owner == k) for k in range(len(places))]


def _whole(mask: Mask) -> Mask:
    """A mask without specks and holes; pieces much smaller than the largest are left out."""
    byte = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3)))
    byte = cv2.morphologyEx(byte, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5)))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(byte, connectivity=4)
    if count < 2:
        return np.zeros(mask.shape, dtype=bool)
    area = stats[:, cv2.CC_STAT_AREA].astype(float)
    area[0] = 0.0
    kept = (area >= PIECE * area.max())[labels]
    edges, _ = cv2.findContours(kept.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros(mask.shape, dtype=np.uint8)
    cv2.drawContours(filled, edges, -1, 1, cv2.FILLED)
    whole: Mask = filled > 0
    return whole


def assign_by_size(
    alike: Sequence[int], areas: Mapping[int, Floats], places: Mapping[int, Sequence[Candidate | None]],
    sizes: Mapping[int, Sizes],
) -> dict[int, int]:  # fmt: skip
    """Return which body (value) each found one (key) of several look-alikes is: the sizes they show agree best.

    areas (T,) [px] and places (T,) by found body.
    """
    if not 2 <= len(alike) <= MOST_ALIKE:
        return {k: k for k in alike}
    off = {}
    for found in alike:
        for body in alike:
            ratios = [
                float(np.log(np.sqrt(area / np.pi) / _expected(sizes[body], place)))
                for area, place in zip(areas[found], places[found], strict=True)
                if place is not None and area > 12
            ]
            off[found, body] = abs(float(np.median(ratios))) if ratios else UNKNOWN_SIZE
    orders = permutations(alike)
    best = min(orders, key=lambda order: sum(off[f, b] for f, b in zip(alike, order, strict=True)))
    return dict(zip(alike, best, strict=True))


def _expected(sizes: Sizes, place: Candidate) -> float:
    height, width = sizes.on_floor.shape
    row, column = min(max(round(place.y), 0), height - 1), min(max(round(place.x), 0), width - 1)
    return float(sizes.on_floor[row, column])
