"""Objects at rest on a textured background: compact regions of colours that occur nowhere else in the image.

The colours of a floor, however patterned, are spread over it; those of an object lie together. Pixels are clustered by
colour, and clusters kept whose pixels form a few compact regions (colour spatial distribution: Perazzi et al. 2012,
"Saliency filters", CVPR).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

CLUSTERS = 24
LIGHTNESS = 0.5  # weight of lightness beside chroma: texture and shading vary it most
MOST = 0.08  # of the image that all pixels of an object's colour cover: a floor's cover more
REGIONS = 6  # compact regions that a colour may have: tiles of a pattern are more
GATHERED = 0.6  # share of a colour's pixels that lie in them
SOLID = 0.7  # of its convex hull that a compact region fills
DISTINCT = 10.0  # Lab units by which a region differs from what surrounds it


def rare_colour_regions(image: Array32, min_area: int) -> Mask:
    """Return the pixels (H, W) of an image (H, W, 3) [BGR levels] that belong to objects by their colour.

    Regions smaller than `min_area` [px] are left out, and so are those that differ little from their surroundings.
    """
    height, width = image.shape[:2]
    levels = cv2.medianBlur(np.clip(image, 0, 255).astype(np.uint8), 3)
    lab = cv2.cvtColor(levels, cv2.COLOR_BGR2LAB).astype(np.float32)
    features = lab * np.array([LIGHTNESS * 100.0 / 255.0, 1.0, 1.0], dtype=np.float32)
    labels = cluster_colours(features, CLUSTERS)
    found = np.zeros((height, width), dtype=bool)
    for k in range(CLUSTERS):
        own = labels == k
        if not own.any() or own.mean() > MOST:
            continue
        found |= _compact_regions(own, min_area)
    closed = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    return _distinct(closed > 0, features, min_area)


def cluster_colours(features: Array32, count: int) -> NDArray[np.int32]:
    """Cluster colours (H, W, 3) around `count` centres, found in a sample by k-means++; return labels (H, W)."""
    height, width = features.shape[:2]
    step = max(1, int(np.sqrt(height * width / 12_000)))
    sample = np.ascontiguousarray(features[::step, ::step].reshape(-1, 3))
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.5)
    _, _, centres = cv2.kmeans(sample, count, np.empty(0, dtype=np.int32), criteria, 2, cv2.KMEANS_PP_CENTERS)
    flat = features.reshape(-1, 3)
    distance = (flat**2).sum(axis=1)[:, None] - 2.0 * flat @ centres.T + (centres**2).sum(axis=1)
    nearest: NDArray[np.int32] = np.argmin(distance, axis=1).astype(np.int32).reshape(height, width)
    return nearest


def _compact_regions(own: Mask, min_area: int) -> Mask:
    """Return the compact regions of one colour, none where its pixels are scattered or the regions are many."""
    least = max(min_area // 4, 8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(own.astype(np.uint8), connectivity=8)
    large = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= least]
    gathered = sum(int(stats[k, cv2.CC_STAT_AREA]) for k in large)
    none = np.zeros_like(own)
    if not large or len(large) > REGIONS or gathered < GATHERED * own.sum():
        return none
    return np.isin(labels, large)


def _distinct(found: Mask, features: Array32, min_area: int) -> Mask:
    """Regions that are compact, not too large, off the border for the most part, and unlike what surrounds them."""
    height, width = found.shape
    count, labels, stats, _ = cv2.connectedComponentsWithStats(found.astype(np.uint8), connectivity=8)
    kept = np.zeros_like(found)
    for k in range(1, count):
        left, top, wide, tall, area = (int(v) for v in stats[k])
        if area < min_area or area > MOST * height * width:
            continue
        along = (left == 0) * tall + (top == 0) * wide + (left + wide == width) * tall + (top + tall == height) * wide
        if along > 0.3 * (height + width) / 2:
            continue
        region = labels == k
        contours, _ = cv2.findContours(region.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        outline = max(contours, key=cv2.contourArea)
        hull = float(cv2.contourArea(cv2.convexHull(outline)))
        if cv2.contourArea(outline) < SOLID * hull:
            continue
        ring = (cv2.dilate(region.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0) & ~found
        if not ring.any():
            continue
        inside, outside = np.median(features[region], axis=0), np.median(features[ring], axis=0)
        if float(np.linalg.norm(inside - outside)) > DISTINCT:
            filled = np.zeros(found.shape, dtype=np.uint8)
            cv2.drawContours(filled, [outline], -1, 1, thickness=cv2.FILLED)
            kept |= filled > 0
    return kept
