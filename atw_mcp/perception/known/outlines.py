"""Masks of known bodies in a frame from where they are, and which of several look-alikes is which."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import permutations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Array32, Mask
from atw_mcp.perception.known.bodies import Sizes
from atw_mcp.perception.known.finding import Candidate
from atw_mcp.perception.known.settings import SETTINGS

Floats = NDArray[np.float64]
Window = tuple[slice, slice]  # rows and columns of an image


def outlines(
    ratio: Callable[[int, Window], Array32], places: Sequence[Candidate | None], shape: tuple[int, int]
) -> list[Mask]:
    """Return each body's mask (H, W) in a frame: pixels more likely its than another body's or none's.

    ratio: returns log likelihood ratios of a body in a part of the frame; places: where each is, None where unseen.
    """
    best, owner = np.zeros(shape, dtype=np.float32), np.full(shape, -1)
    for k, place in enumerate(places):
        if place is None:
            continue
        window, away = around(place, SETTINGS.farthest_edge, shape)
        smooth = cv2.blur(ratio(k, window), (3, 3))
        score = smooth - SETTINGS.fall * np.maximum(away - 1.0, 0.0) ** 2 + SETTINGS.core_gain * (away < SETTINGS.core)
        take = (score > best[window]) & (away < SETTINGS.farthest_edge)
        best[window][take], owner[window][take] = score[take], k
    return [_whole(owner == k) for k in range(len(places))]


def around(place: Candidate, reach: float, shape: tuple[int, int]) -> tuple[Window, Floats]:
    """Return the part of images of `shape` within `reach` radii of a place, and its pixels' distances in radii."""
    height, width = shape
    length = reach * place.radius
    rows = slice(max(int(place.y - length), 0), min(int(place.y + length) + 2, height))
    columns = slice(max(int(place.x - length), 0), min(int(place.x + length) + 2, width))
    y, x = np.mgrid[rows, columns]
    away: Floats = np.hypot(x - place.x, y - place.y) / place.radius
    return (rows, columns), away


def _whole(mask: Mask) -> Mask:
    """Return a mask without specks and holes; pieces much smaller than the largest are left out."""
    byte = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3)))
    byte = cv2.morphologyEx(byte, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5)))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(byte, connectivity=4)
    if count < 2:
        return np.zeros(mask.shape, dtype=bool)
    area = stats[:, cv2.CC_STAT_AREA].astype(float)
    area[0] = 0.0
    kept = (area >= SETTINGS.piece * area.max())[labels]
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

    Sizes are compared in the frames in which a body is seen least enlarged: in the air it is nearer than it would be
    on the floor, and looks larger. areas (T,) [px] and places (T,) by found body.
    """
    if not 2 <= len(alike) <= SETTINGS.most_alike:
        return {k: k for k in alike}
    off = {}
    for found in alike:
        for body in alike:
            ratios = [
                float(np.log(np.sqrt(area / np.pi) / _expected(sizes[body], place)))
                for area, place in zip(areas[found], places[found], strict=True)
                if place is not None and area > SETTINGS.least_area
            ]
            nearly_down = float(np.quantile(ratios, SETTINGS.nearly_down)) if ratios else SETTINGS.unknown_size
            off[found, body] = abs(nearly_down)
    orders = permutations(alike)
    best = min(orders, key=lambda order: sum(off[f, b] for f, b in zip(alike, order, strict=True)))
    return dict(zip(alike, best, strict=True))


def _expected(sizes: Sizes, place: Candidate) -> float:
    height, width = sizes.on_floor.shape
    row, column = min(max(round(place.y), 0), height - 1), min(max(round(place.x), 0), width - 1)
    return float(sizes.on_floor[row, column])
