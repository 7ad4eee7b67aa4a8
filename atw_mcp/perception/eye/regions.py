"""Regions: what differs from the background in each frame and is no shadow on it, at reduced size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from atw_mcp.perception.eye.pixels import Array, Bytes, Floats, Mask, displaced_edges, features
from atw_mcp.perception.eye.settings import EyeSettings


@dataclass(frozen=True)
class Region:
    """A connected region of a frame, in reduced pixels.

    corner, mask (h, w): its first pixel and pixels; picture: height and width; centre (2,): centroid; look: features.

    dark: it differs from the background by darkening alone, as a shadow does. border: it touches the picture's.
    solid: share of its convex hull. alone: distance to the nearest other region, in radii.
    """

    frame: int
    corner: tuple[int, int]
    picture: tuple[int, int]
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

    def enlarged(self, height: int, width: int) -> Mask:
        """Mask (height, width) in the whole frame's pixels."""
        whole = np.zeros(self.picture, np.float32)
        rows, columns = self.mask.shape
        whole[self.corner[1] : self.corner[1] + rows, self.corner[0] : self.corner[0] + columns] = self.mask
        return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_LINEAR) > 0.5)


@dataclass
class Still:
    """The still scene at reduced size: features (H, W, 3) and their standard deviations (H, W, 3).

    tint (2,): chroma that a shadow changes per unit of log brightness, since the light that is left has another colour.
    """

    feature: Array
    spread: Array
    tint: Array


def reduced(frames: Bytes, most: float) -> tuple[Bytes, float]:
    """Frames of at most so many pixels, and the factor by which they are smaller."""
    height, width = frames.shape[1:3]
    factor = min(1.0, float(np.sqrt(most / (height * width))))
    if factor > 0.85:  # nothing is gained
        return frames, 1.0
    size = (round(width * factor), round(height * factor))
    return np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames]), size[0] / width


def find_regions(
    frames: Bytes, settings: EyeSettings, tick: Callable[[], None] = lambda: None
) -> tuple[list[list[Region]], Still]:
    """Regions of each of the frames (T, H, W, 3), and the background that is learned from them.

    A body that stands for most of the clip is the median there. What is seen after it has gone then differs from the
    median, but its outline is an edge of the median and not of the frame: the frame is taken for the background.
    """
    count = min(len(frames), settings.background_frames)
    chosen = np.unique(np.linspace(0, len(frames) - 1, count).astype(int))
    still = _still(frames[chosen], settings)
    found: list[list[Region]] = []
    for _ in range(3):
        found = []
        for k, frame in enumerate(frames):
            tick()
            found.append(regions_of(frame, k, still, settings))
        if not _uncover(frames, found, still, settings):
            break
    return found, still


def _still(sample: Bytes, settings: EyeSettings) -> Still:
    middle = np.median(sample, axis=0).astype(np.float32)
    feature = features(middle, settings)
    apart = np.stack([_lit(features(f.astype(np.float32), settings) - feature) for f in sample])
    steps = np.abs(np.diff(apart, axis=0)) / np.sqrt(2)  # a body that comes to rest changes a pixel once
    noise = 1.48 * np.median(steps, axis=0)
    common = np.maximum(1.48 * np.median(steps, axis=(0, 1, 2)), settings.noise_floor)
    noise = np.minimum(cv2.GaussianBlur(noise, (0, 0), 1.5), 10 * common)
    spread = np.sqrt(np.maximum(noise, common) ** 2 + displaced_edges(feature, settings) ** 2)
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
            for half in _at_half(own, amount[y : y + h, x : x + w]):
                area = int(half.sum())
                if area >= settings.least_region:
                    only_dark = is_dark or float(foreign[y : y + h, x : x + w][half].mean()) < 0.1
                    parts.append((half, (x, y), area, only_dark))
    found, height, width = [], *frame.shape[:2]
    boxes = np.array([(*c, c[0] + m.shape[1], c[1] + m.shape[0]) for m, c, _, other in parts if not other]).reshape(
        -1, 4
    )
    for own, corner, area, is_dark in parts:
        v, u = np.nonzero(own)
        box = (corner[0] + u.min(), corner[1] + v.min(), corner[0] + u.max() + 1, corner[1] + v.max() + 1)
        whole = (*corner, corner[0] + own.shape[1], corner[1] + own.shape[0])
        others = boxes[(boxes != whole).any(axis=1)]
        gaps = np.maximum(box[:2] - others[:, 2:], others[:, :2] - box[2:]).max(axis=1)
        found.append(
            Region(
                number,
                corner,
                (height, width),
                own,
                np.array([u.mean() + corner[0], v.mean() + corner[1]]),
                area,
                np.median(look[v + corner[1], u + corner[0]], axis=0),
                is_dark,
                box[0] <= 1 or box[1] <= 1 or box[2] >= width - 1 or box[3] >= height - 1,
                _solidity(own),
                max(int(gaps.min(initial=width)), 0) / np.sqrt(area / np.pi),
            )
        )
    return found


def _at_half(own: Mask, amount: Array) -> list[Mask]:
    """Parts of a region within the outline at which its difference has fallen to half of that near there: lens and
    coding blur edges, and what is left is a shadow, a glow, or a bridge between bodies that touch."""
    inside = np.where(own, cv2.GaussianBlur(amount, (0, 0), 1.0), np.float32(0))
    reach = max(3, round(0.5 * float(np.sqrt(own.sum() / np.pi))))
    most = cv2.dilate(inside, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1)))
    kept = _closed((own & (amount > 0.5 * most)).astype(np.uint8))
    count, labels = cv2.connectedComponents(kept, connectivity=4)
    return [np.asarray(labels == part) for part in range(1, count)]


def _solidity(mask: Mask) -> float:
    """Share of its convex hull that a mask fills."""
    points = cv2.findNonZero(mask.astype(np.uint8))
    hull = cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), cv2.convexHull(points), 1)
    return float(mask.sum() / hull.sum())


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
        window, inside = _window(region, still.feature.shape[:2])
        own = features(frames[region.frame][window].astype(np.float32), settings)
        ratio = _step(still.feature[window], inside) / max(_step(own, inside), 1e-3)
        if ratio > 1.5:
            uncovered.append((ratio, len(uncovered), window, cv2.dilate(inside, np.ones((5, 5))) > 0, own))
    done = np.zeros(still.feature.shape[:2], bool)
    for _, _, window, whole, own in sorted(uncovered, key=lambda u: -u[0]):
        if done[window][whole].mean() < 0.5:
            still.feature[window][whole] = own[whole]
            done[window] |= whole
    return bool(uncovered)


def weakest_step(look: Array, region: Region) -> float:
    """Difference of features (H, W, 3) that a tenth of a region's outline does not reach."""
    window, inside = _window(region, look.shape[:2])
    return float(np.percentile(_steps(look[window], inside), 10))


def _window(region: Region, shape: tuple[int, ...]) -> tuple[tuple[slice, slice], Bytes]:
    """Part of the picture with 3 pixels around a region, and the region (h, w) in it."""
    grown = cv2.copyMakeBorder(region.mask.astype(np.uint8), 3, 3, 3, 3, cv2.BORDER_CONSTANT, value=0)
    x, y = region.corner[0] - 3, region.corner[1] - 3
    top, left = max(y, 0), max(x, 0)
    inside = grown[top - y : shape[0] - y, left - x : shape[1] - x]
    return np.s_[top : top + inside.shape[0], left : left + inside.shape[1]], np.asarray(inside, dtype=np.uint8)


def _step(look: Array, inside: Bytes) -> float:
    """Mean difference across the outline of a region (h, w)."""
    return float(_steps(look, inside).mean())


def _steps(look: Array, inside: Bytes) -> Array:
    """Difference (M,) of each inner pixel along the outline of a region (h, w) from the mean outside near it."""
    outer = (cv2.dilate(inside, np.ones((7, 7), np.uint8)) > 0) & (cv2.dilate(inside, np.ones((3, 3))) == 0)
    inner = (inside > 0) & (cv2.erode(inside, np.ones((5, 5), np.uint8), borderValue=1) == 0)
    if not outer.any() or not inner.any():
        return np.zeros(1, np.float32)
    weight = cv2.GaussianBlur(outer.astype(np.float32), (0, 0), 3.0)
    around = cv2.GaussianBlur(np.where(outer[..., None], look, np.float32(0)), (0, 0), 3.0)
    apart = look[inner] - around[inner] / np.maximum(weight[inner], 1e-4)[:, None]
    return np.asarray(np.abs(apart).sum(axis=-1), dtype=np.float32)
