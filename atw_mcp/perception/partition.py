"""Splitting a connected region among the objects that make it up: by colour, expected shape and place."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.appearance import Bins
from atw_mcp.perception.background import Mask

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Template:
    """An object's outline: mask (h, w) whose corner lies at pixel (left, top)."""

    mask: Mask
    left: float
    top: float

    @property
    def area(self) -> int:
        """Number of pixels."""
        return int(self.mask.sum())

    @property
    def centre(self) -> Floats:
        """Centroid (x, y) [px]."""
        y, x = np.nonzero(self.mask)
        if len(x) == 0:
            return np.array([self.left, self.top])
        return np.array([x.mean() + self.left, y.mean() + self.top])

    def moved(self, dx: float, dy: float) -> Template:
        """Return the same outline elsewhere."""
        return Template(self.mask, self.left + dx, self.top + dy)

    def drawn(self, left: int, top: int, width: int, height: int) -> Mask:
        """Return the outline in a window of the image, shape (height, width)."""
        window = np.zeros((height, width), dtype=bool)
        x, y = round(self.left) - left, round(self.top) - top
        h, w = self.mask.shape
        x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + w, width), min(y + h, height)
        if x1 > x0 and y1 > y0:
            window[y0:y1, x0:x1] = self.mask[y0 - y : y1 - y, x0 - x : x1 - x]
        return window


def template_of(mask: Mask) -> Template:
    """Return the outline of a mask of the whole image."""
    y, x = np.nonzero(mask)
    if len(x) == 0:
        return Template(np.zeros((1, 1), dtype=bool), 0.0, 0.0)
    top, left = int(y.min()), int(x.min())
    return Template(mask[top : y.max() + 1, left : x.max() + 1].copy(), left, top)


@dataclass(frozen=True)
class Member:
    """One object that may be part of a region.

    likelihood (BIN_COUNT,) log-likelihood of colours; templates: where its outline is expected, each with a
    weight; search [px]: how far from there it may be.
    """

    likelihood: Floats
    templates: tuple[tuple[Template, float], ...]
    search: int


@dataclass(frozen=True)
class Share:
    """Share of a member: mask of the window, its placed templates, and how clear the decision was (0..1)."""

    mask: Mask
    placed: tuple[Template, ...]
    clarity: float


def renewed(expected: Template, mask: Mask, clarity: float) -> Template:
    """Return the outline to go on with: the mask's own if the whole object seems to be seen, else the expected one.

    A mask that is less convex than expected has taken in a reflection or lost a part to one.
    """
    seen = template_of(mask)
    if not (0.93 < seen.area / max(expected.area, 1) < 1.12 and clarity > 0.9):
        return expected
    return seen if solidity(seen.mask) > solidity(expected.mask) - 0.01 else expected


def solidity(mask: Mask) -> float:
    """Area of a mask's largest part over that of its convex hull."""
    contours, _ = cv2.findContours(np.pad(mask, 1).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    hull = cv2.contourArea(cv2.convexHull(largest))
    return float(cv2.contourArea(largest) / hull) if hull > 0 else 1.0


def partition(
    region: Mask, bins: Bins, left: int, top: int, members: list[Member], image_size: tuple[int, int]
) -> list[Share]:
    """Divide `region` (H, W), a window of the image whose corner is (left, top), among its members.

    bins (H, W) are the window's colour bins; image_size is (width, height) [px]. Every pixel of the region goes
    to one member.
    """
    height, width = region.shape
    colour = np.stack([np.clip(m.likelihood[bins], -3.9, 3.0) for m in members])
    smooth = np.stack([cv2.GaussianBlur(np.where(region, c, 0.0), (0, 0), 0.8) for c in colour])
    placed: list[tuple[Template, ...]] = []
    prior = np.zeros_like(smooth)
    for k, member in enumerate(members):
        others = np.max(np.delete(colour, k, axis=0), axis=0) if len(members) > 1 else np.full(region.shape, -3.9)
        # Where another object is seen this one may be behind it; where the background is seen it cannot be.
        evidence = np.where(region, np.clip(colour[k] - others, -0.4, 2.5) + 0.2, -2.5)
        where = tuple(_place(t, evidence, left, top, member.search, image_size) for t, _ in member.templates)
        placed.append(where)
        weights = np.array([w for _, w in member.templates])
        depth = sum(
            w * _signed_distance(t.drawn(left, top, width, height))
            for t, w in zip(where, weights / weights.sum(), strict=True)
        )
        # Near the outline colour decides; well outside it even a fitting colour is more likely a reflection.
        inside = np.asarray(depth)
        prior[k] = np.clip(inside / 1.2, -3.5, 1.5) + np.clip((inside + 4.2) / 2.0, -4.0, 0.0)
    score = smooth + prior
    choice = np.argmax(score, axis=0)
    choice = _without_specks(choice, region, len(members))
    margin = np.sort(score, axis=0)
    gap = margin[-1] - margin[-2] if len(members) > 1 else np.full(region.shape, 5.0)
    certainty = 1.0 / (1.0 + np.exp(-gap))
    shares = []
    for k in range(len(members)):
        mask = region & (choice == k)
        shares.append(Share(mask, placed[k], float(certainty[mask].mean()) if mask.any() else 0.0))
    return shares


def _place(
    template: Template, evidence: Floats, left: int, top: int, search: int, image_size: tuple[int, int]
) -> Template:
    """Return the template shifted, by whole pixels, to where the evidence under it is greatest."""
    if search <= 0 or not template.mask.any():
        return template
    h, w = template.mask.shape
    x, y = round(template.left) - left - search, round(template.top) - top - search
    window = np.full((h + 2 * search, w + 2 * search), -2.5, dtype=np.float32)
    # What lies outside the image is unknown: neither for nor against.
    columns = np.arange(window.shape[1]) + x + left
    rows = np.arange(window.shape[0]) + y + top
    window[(rows < 0) | (rows >= image_size[1])] = 0.0
    window[:, (columns < 0) | (columns >= image_size[0])] = 0.0
    height, width = evidence.shape
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + window.shape[1], width), min(y + window.shape[0], height)
    if x1 <= x0 or y1 <= y0:
        return template
    window[y0 - y : y1 - y, x0 - x : x1 - x] = evidence[y0:y1, x0:x1]
    scores = cv2.matchTemplate(window, template.mask.astype(np.float32), cv2.TM_CCORR)
    dy, dx = np.mgrid[-search : search + 1, -search : search + 1]
    # A gentle pull to the expected place: with colours alike, evidence inside the region is flat.
    scores = scores - 0.02 * template.area * np.hypot(dx, dy) / max(search, 4)
    best = np.unravel_index(int(np.argmax(scores)), scores.shape)
    return template.moved(float(dx[best]), float(dy[best]))


def _signed_distance(mask: Mask) -> Floats:
    """Distance to the outline [px], positive inside."""
    byte = mask.astype(np.uint8)
    if not byte.any():
        return np.full(mask.shape, -50.0)
    inside = cv2.distanceTransform(byte, cv2.DIST_L2, 3)
    outside = cv2.distanceTransform(1 - byte, cv2.DIST_L2, 3)
    return (inside - outside).astype(np.float64)


def _without_specks(choice: NDArray[np.int64], region: Mask, count: int) -> NDArray[np.int64]:
    """Return the choice with isolated fragments given to the member that surrounds them."""
    cleaned = cv2.medianBlur(np.where(region, choice + 1, 0).astype(np.uint8), 3).astype(np.int64)
    cleaned = np.where(region & (cleaned > 0), cleaned - 1, choice)
    for k in range(count):
        mine = region & (cleaned == k)
        total = int(mine.sum())
        number, labels, stats, _ = cv2.connectedComponentsWithStats(mine.astype(np.uint8), connectivity=4)
        for label in range(1, number):
            if stats[label, cv2.CC_STAT_AREA] >= max(10, 0.06 * total):
                continue
            speck = labels == label
            around = (cv2.dilate(speck.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & region & ~speck
            if around.any():
                cleaned[speck] = np.bincount(cleaned[around], minlength=count).argmax()
    return cleaned
