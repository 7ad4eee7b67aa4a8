"""Tracks that are no objects: shadows, pieces of other objects, places where the background was modelled wrongly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import cv2
import numpy as np

from atw_mcp.perception.background import Background, Mask
from atw_mcp.perception.segmentation import Foreground

Reason = Literal["shadow", "fixed", "fragment"]

SHADOWED = 0.7  # share of a track's pixels that are hueless and as dark as shadows, in a frame that shows a shadow
MOST_FRAMES = 0.6  # share of its frames that do
LIKE = 0.1  # difference of brightness ratios within which two are of one light
FLAT = 0.06  # spread of the ratio within a shadow
FIXED = 1.5  # pixels by which the centroid of what never moves may wander
PIECE = 0.06  # share of its neighbour's pixels that a piece of it has: a slip of its rim, shadow or reflection
BESIDE = 0.5  # share of its frames in which a piece has such a neighbour
BRIEF = 0.5  # share of the clip's frames in which a piece is seen; a small body would be seen in more
GAP = 2  # pixels between neighbours
COVERED = 0.3  # share of a track's pixels on an object at rest from which it is that object


def artefacts(
    masks: Mapping[int, Sequence[Mask]],
    foregrounds: Sequence[Foreground],
    background: Background,
    shadow: float | None,
) -> dict[int, Reason]:
    """Return the tracks (number: T masks) that are no objects, each with its reason.

    shadow: factor by which cast shadows darken the background, where it is known; else several tracks that are alike
    in being flat, hueless and equally dark are taken for shadows.
    """
    found: dict[int, Reason] = {}
    flat: dict[int, float] = {}
    for number, own in masks.items():
        rows = [t for t, m in enumerate(own) if m.any()]
        if not rows:
            continue
        ratios = [(float(np.median(foregrounds[t].shade[own[t]].astype(np.float32))), t) for t in rows]
        dark = [r for r, t in ratios if _is_dark(own[t], foregrounds[t], r)]
        if len(dark) >= MOST_FRAMES * len(rows):
            flat[number] = float(np.median(dark))
        if _is_fixed([own[t] for t in rows]) and _share(own[rows[0]], background.still) < COVERED:
            found[number] = "fixed"
        elif len(rows) < BRIEF * len(own) and _is_fragment(number, rows, masks):
            found[number] = "fragment"
    for number, ratio in flat.items():
        others = [shadow] if shadow is not None else [r for n, r in flat.items() if n != number]
        if any(abs(ratio - other) < LIKE for other in others):
            found[number] = "shadow"
    return found


def _is_dark(mask: Mask, foreground: Foreground, ratio: float) -> bool:
    """Check whether most of a mask (H, W) is hueless, darker than the background, and flat."""
    shade = foreground.shade[mask].astype(np.float32)
    near = foreground.dim[mask] & (np.abs(shade - ratio) < FLAT)
    return bool(near.mean() > SHADOWED)


def _is_fragment(number: int, rows: Sequence[int], masks: Mapping[int, Sequence[Mask]]) -> bool:
    """Check whether a track is, in most frames (rows) in which it is seen, a small piece beside a large object."""
    near = np.ones((2 * GAP + 1, 2 * GAP + 1), np.uint8)
    pieces = 0
    for t in rows:
        own = masks[number][t]
        size = int(own.sum())
        larger = [m[t] for n, m in masks.items() if n != number and size < PIECE * int(m[t].sum())]
        if larger:
            around = cv2.dilate(own.astype(np.uint8), near) > 0
            pieces += any(bool((m & around).any()) for m in larger)
    return pieces >= BESIDE * len(rows)


def _is_fixed(masks: Sequence[Mask]) -> bool:
    """Check whether a track never moves."""
    centroids = np.array([[float(v.mean()) for v in np.nonzero(m)] for m in masks])
    low, high = np.quantile(centroids, [0.1, 0.9], axis=0)
    return bool(np.linalg.norm(high - low) < FIXED)


def _share(mask: Mask, other: Mask) -> float:
    return float((mask & other).sum() / max(mask.sum(), 1))
