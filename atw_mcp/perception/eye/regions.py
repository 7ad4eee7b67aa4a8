"""Regions: what differs from the background in each frame and is no shadow on it, at reduced size."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from atw_mcp.perception.eye.pixels import Array, Bytes, Floats, Mask, features
from atw_mcp.perception.eye.settings import EyeSettings


@dataclass(frozen=True)
class Region:
    """A connected region of a frame, in reduced pixels: its mask (h, w) and first pixel, centroid (2,), area, features.

    dark: it differs from the background by darkening alone, as a shadow does. border: it touches the picture's.
    solid: share of its convex hull. alone: distance to the nearest other region, in radii.
    """

    frame: int
    corner: tuple[int, int]
    mask: Mask
    centre: Floats
    area: int
    look: Array
    dark: bool
    border: bool
    solid: float
    alone: float

    @property
    def radius(self) -> float:
        """Radius of the circle of its area."""
        return float(np.sqrt(self.area / np.pi))


@dataclass
class Still:
    """The still scene at reduced size: features (H, W, 3) and their standard deviations (H, W, 3).

    tint (2,): chroma that a shadow changes per unit of log brightness, since the light that is left has another colour.
    """

    feature: Array
    spread: Array
    tint: Array


def reduced(frames: Bytes, settings: EyeSettings) -> tuple[Bytes, float]:
    """Frames of at most `discovery_pixels`, and the factor by which they are smaller."""
    height, width = frames.shape[1:3]
    factor = min(1.0, float(np.sqrt(settings.discovery_pixels / (height * width))))
    if factor > 0.85:  # nothing is gained
        return frames, 1.0
    size = (round(width * factor), round(height * factor))
    return np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames]), size[0] / width


def find_regions(frames: Bytes, settings: EyeSettings) -> list[list[Region]]:
    """Regions of each of the frames (T, H, W, 3), against a background that is learned from them.

    A body that stands for most of the clip is the median there. What is seen after it has gone then differs from the
    median, but its outline is an edge of the median and not of the frame: the frame is taken for the background.
    """
    count = min(len(frames), settings.background_frames)
    chosen = np.unique(np.linspace(0, len(frames) - 1, count).astype(int))
    still = _still(frames[chosen], settings)
    found: list[list[Region]] = []
    for _ in range(3):
        found = [regions_of(frame, k, still, settings) for k, frame in enumerate(frames)]
        if not _uncover(frames, found, still, settings):
            break
    return found


def _still(sample: Bytes, settings: EyeSettings) -> Still:
    middle = np.median(sample, axis=0).astype(np.float32)
    feature = features(middle, settings)
    apart = np.stack([_lit(features(f.astype(np.float32), settings) - feature) for f in sample])
    noise = 1.48 * np.median(np.abs(apart), axis=0)
    common = np.maximum(1.48 * np.median(np.abs(apart), axis=(0, 1, 2)), settings.noise_floor)
    noise = np.minimum(cv2.GaussianBlur(noise, (0, 0), 1.5), 10 * common)
    edges = np.stack(
        [
            np.hypot(cv2.Sobel(f, -1, 1, 0, scale=0.125), cv2.Sobel(f, -1, 0, 1, scale=0.125))
            for f in cv2.split(feature)
        ],
        axis=-1,
    )
    spread = np.sqrt(np.maximum(noise, common) ** 2 + (settings.sharp * edges) ** 2)
    strong = apart[(np.abs(apart[..., 0]) > 6 * spread[..., 0]) & (apart[..., 0] < -0.15)]
    return Still(feature, spread.astype(np.float32), _tint(strong))


def _tint(darkened: Array) -> Array:
    """Commonest ratio (2,) of chroma to log brightness among differences (M, 3) of darkened pixels; zero of few."""
    if len(darkened) < 200:
        return np.zeros(2, np.float32)
    lines = np.linspace(-0.3, 0.3, 31)
    ratios = darkened[:, 1:] / darkened[:, :1]
    counts = np.histogram2d(ratios[:, 0], ratios[:, 1], bins=(lines, lines))[0]
    middle = 0.5 * (lines[1:] + lines[:-1])
    prior = np.exp(-(middle[:, None] ** 2 + middle[None] ** 2) / (2 * 0.1**2))  # light left in a shadow is nearly white
    best = np.unravel_index(int(np.argmax(cv2.GaussianBlur(counts, (0, 0), 1.0) * prior)), counts.shape)
    return np.array([middle[best[0]], middle[best[1]]], np.float32)


def _lit(apart: Array) -> Array:
    """Differences without those of the whole frame: the light changes."""
    return np.asarray(apart - np.median(apart[::4, ::4], axis=(0, 1)), dtype=np.float32)


def _classes(frame: Bytes, still: Still, settings: EyeSettings) -> tuple[Mask, Mask, Array, Array, Mask, Array]:
    """Pixels (H, W) that are neither background nor shaded background; those that may be shaded; features; by how many
    standard deviations each differs; those of another hue; amounts by which they differ."""
    look = features(frame.astype(np.float32), settings)
    apart = _lit(look - still.feature)
    dark = apart[..., 0]
    chroma = apart[..., 1:] - still.tint * np.minimum(dark, 0)[..., None]
    wide = still.spread[..., 1:] + np.float32(settings.shade_chroma) * np.abs(dark)[..., None]
    coloured = cv2.GaussianBlur(((chroma / wide) ** 2).sum(axis=-1), (0, 0), 0.8)
    bright = cv2.GaussianBlur(dark / still.spread[..., 0], (0, 0), 0.8)
    sigma = np.float32(settings.differs)
    black = (dark < -0.5 * settings.deepest_shade) & (bright < -sigma)
    lit = (bright > sigma) & (dark > 0.5 * settings.brightest_light)
    foreign = (coloured > sigma**2) | black | lit
    differs = np.maximum(np.sqrt(coloured), np.abs(bright))
    amount = np.sqrt(dark**2 + 9 * (chroma**2).sum(axis=-1))  # chroma varies less than brightness: equal weight
    shaded = ~foreign & (bright < -sigma) & (dark < -0.08)
    return foreign, shaded, look, differs, coloured > sigma**2, amount


def regions_of(frame: Bytes, number: int, still: Still, settings: EyeSettings) -> list[Region]:
    """Regions of a frame."""
    foreign, shaded, look, differs, hued, amount = _classes(frame, still, settings)
    kernel = np.ones((3, 3), np.uint8)
    body = np.asarray(cv2.morphologyEx(foreign.astype(np.uint8), cv2.MORPH_CLOSE, kernel), dtype=np.uint8)
    body = np.asarray(cv2.morphologyEx(_closed(body), cv2.MORPH_OPEN, kernel), dtype=np.uint8)
    wide = np.ones((5, 5), np.uint8)
    dark = np.asarray(cv2.morphologyEx(shaded.astype(np.uint8), cv2.MORPH_OPEN, wide), dtype=np.uint8)
    body = _with_dark_sides(body, dark, hued)
    dark[body > 0] = 0
    parts: list[tuple[Mask, tuple[int, int], int, bool]] = []
    for mask, is_dark in ((body, False), (dark, True)):
        _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
        for part in range(1, len(stats)):
            x, y, w, h, area = (int(a) for a in stats[part])
            if area < settings.least_region:
                continue
            own = labels[y : y + h, x : x + w] == part
            if np.percentile(differs[y : y + h, x : x + w][own], 80) < 2 * settings.differs:
                continue
            if not is_dark:
                own = _at_half(own, amount[y : y + h, x : x + w])
                area = int(own.sum())
            if area >= settings.least_region:
                parts.append((own, (x, y), area, is_dark))
    found, height, width = [], *frame.shape[:2]
    for own, corner, area, is_dark in parts:
        v, u = np.nonzero(own)
        box = (corner[0], corner[1], corner[0] + own.shape[1], corner[1] + own.shape[0])
        hull = cv2.convexHull(np.stack([u, v], axis=1).astype(np.int32))
        radius = np.sqrt(area / np.pi)
        gaps = [
            max(box[0] - c[0] - m.shape[1], c[0] - box[2], box[1] - c[1] - m.shape[0], c[1] - box[3])
            for m, c, _, other in parts
            if (m is not own) and not other
        ]
        found.append(
            Region(
                number,
                corner,
                own,
                np.array([u.mean() + corner[0], v.mean() + corner[1]]),
                area,
                np.median(look[v + corner[1], u + corner[0]], axis=0),
                is_dark,
                box[0] <= 1 or box[1] <= 1 or box[2] >= width - 1 or box[3] >= height - 1,
                area / max(cv2.contourArea(hull) + 0.5 * cv2.arcLength(hull, True) + 1, area),
                max(min(gaps, default=width), 0) / radius,
            )
        )
    return found


def _at_half(own: Mask, amount: Array) -> Mask:
    """The largest part of a region within the outline at which its difference has fallen to half: lens and coding blur
    edges, and what is left is a shadow or a glow."""
    kept = _closed((own & (amount > 0.5 * np.percentile(amount[own], 75))).astype(np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(kept, connectivity=4)
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, 4]))) if len(stats) > 1 else own


def _with_dark_sides(body: Bytes, dark: Bytes, hued: Mask) -> Bytes:
    """Bodies of the background's own hue with the darkened pixels that they touch: their dark sides look like shade."""
    count, labels = cv2.connectedComponents(body, connectivity=4)
    share = np.bincount(labels.ravel(), hued.ravel(), count) / np.maximum(np.bincount(labels.ravel(), None, count), 1)
    grey = (share < 0.3)[labels] & (body > 0)
    _, joined = cv2.connectedComponents((grey | (dark > 0)).astype(np.uint8), connectivity=8)
    keep = np.zeros(int(joined.max()) + 1, bool)
    keep[np.unique(joined[grey])] = True
    keep[0] = False
    return _closed((keep[joined] | (body > 0)).astype(np.uint8))


def _closed(mask: Bytes) -> Bytes:
    """A mask with its holes filled."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(mask.copy(), contours, -1, 1, cv2.FILLED), dtype=np.uint8)


def _uncover(frames: Bytes, found: list[list[Region]], still: Still, settings: EyeSettings) -> bool:
    """Put into the background what regions show whose outline is an edge of it rather than of the frame, the clearest
    first: one that a body still touches has both edges."""
    uncovered: list[tuple[float, int, tuple[slice, slice], Mask, Array]] = []
    for region in (r for regions in found[:: max(1, len(found) // settings.background_frames)] for r in regions):
        grown = cv2.copyMakeBorder(region.mask.astype(np.uint8), 3, 3, 3, 3, cv2.BORDER_CONSTANT, value=0)
        x, y = region.corner[0] - 3, region.corner[1] - 3
        height, width = still.feature.shape[:2]
        top, left = max(y, 0), max(x, 0)
        inside = grown[top - y : height - y, left - x : width - x]
        window = np.s_[top : top + inside.shape[0], left : left + inside.shape[1]]
        outer = (cv2.dilate(inside, np.ones((7, 7), np.uint8)) > 0) & (cv2.dilate(inside, np.ones((3, 3))) == 0)
        inner = (inside > 0) & (cv2.erode(inside, np.ones((5, 5), np.uint8), borderValue=1) == 0)
        if outer.any() and inner.any():
            own = features(frames[region.frame][window].astype(np.float32), settings)
            ratio = _step(still.feature[window], inner, outer) / max(_step(own, inner, outer), 1e-3)
            if ratio > 1.5:
                uncovered.append((ratio, len(uncovered), window, cv2.dilate(inside, np.ones((5, 5))) > 0, own))
    done = np.zeros(still.feature.shape[:2], bool)
    for _, _, window, whole, own in sorted(uncovered, key=lambda u: -u[0]):
        if done[window][whole].mean() < 0.5:
            still.feature[window][whole] = own[whole]
            done[window] |= whole
    return bool(uncovered)


def _step(look: Array, inner: Mask, outer: Mask) -> float:
    """Mean difference of features across a region's outline: each inner pixel against the mean outside near it."""
    weight = cv2.GaussianBlur(outer.astype(np.float32), (0, 0), 3.0)
    around = cv2.GaussianBlur(np.where(outer[..., None], look, np.float32(0)), (0, 0), 3.0)
    apart = look[inner] - around[inner] / np.maximum(weight[inner], 1e-4)[:, None]
    return float(np.abs(apart).sum(axis=-1).mean())
