"""Bodies at rest that a modelled background may show: places of a body's size and colour unlike what surrounds them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.appearance import colour_bins
from atw_mcp.perception.background import Background, Mask
from atw_mcp.perception.known.bodies import Sizes
from atw_mcp.perception.known.finding import SQUARE, box_mean, fits, highest, odd, radii_of
from atw_mcp.perception.still_colours import cluster_colours

Floats = NDArray[np.float64]

CLUSTERS = 32  # colours that a background is reduced to
LIGHTNESS = 0.4  # weight of lightness beside chroma: shading and texture vary it most
INNER, GAP, OUTER = 0.85, 1.35, 2.6  # radii of the body's core and of the ring that surrounds it
RARE = 0.02  # share of a ring below which a colour does not occur in it
PLACES = 5
CLEAR = 2.2  # log likelihood ratio per pixel from which a body may be there
UNLIKE = 0.3  # log ratio of a colour's shares in core and ring from which it is the body's
REACH = 1.4  # radii around its centre that a body may cover


class StillBodies:
    """The colours of a background, in clusters."""

    def __init__(self, background: Background) -> None:
        image = np.clip(background.image, 0, 255).astype(np.uint8)
        self.bins = colour_bins(image)
        scale = np.array([LIGHTNESS, 1.0, 1.0], dtype=np.float32)
        lab = cv2.cvtColor(cv2.medianBlur(image, 3), cv2.COLOR_BGR2LAB).astype(np.float32) * scale
        self.labels = cluster_colours(lab, CLUSTERS)
        self.counts = np.bincount(self.labels.ravel(), minlength=CLUSTERS)

    def covered_by(self, likelihood: Floats, sizes: Sizes) -> Mask:
        """Return the pixels (H, W) that a body may cover. likelihood (BIN_COUNT,): of its colours, by its name."""
        summed = np.bincount(self.labels.ravel(), weights=likelihood[self.bins].ravel(), minlength=CLUSTERS)
        named = summed / np.maximum(self.counts, 1)
        own = [(c, (self.labels == c).astype(np.float32)) for c in range(CLUSTERS) if self.counts[c]]
        height, width = self.labels.shape
        one = np.ones((height, width), dtype=np.float32)
        best, radius = np.full(one.shape, -np.inf, dtype=np.float32), np.zeros_like(one)
        for r in radii_of(sizes):
            place = fits(r, sizes)
            if not place.any():
                continue
            core, gap, ring = odd(SQUARE * INNER * r), odd(SQUARE * GAP * r, 3), odd(SQUARE * OUTER * r, 5)
            inside = np.maximum(box_mean(one, core), 0.3)
            around = np.maximum(box_mean(one, ring) * ring**2 - box_mean(one, gap) * gap**2, 1.0)
            total = np.zeros_like(one)
            for c, where in own:
                beside = (box_mean(where, ring) * ring**2 - box_mean(where, gap) * gap**2) / around
                share = box_mean(where, core) / inside
                total += share * (named[c] - np.log(np.maximum(beside, 0.0) + RARE))
            better = place & (total > best)
            best[better], radius[better] = total[better], r
        covered = np.zeros(one.shape, dtype=bool)
        y, x = np.mgrid[0:height, 0:width]
        for found in highest(best, radius, PLACES, CLEAR):
            away = np.hypot(x - found.x, y - found.y) / found.radius
            inner = self._shares(away < INNER)
            ring_share = self._shares((away > REACH) & (away < OUTER))
            unlike = np.log(inner + RARE) - np.log(ring_share + RARE) > UNLIKE
            covered |= (away < REACH) & unlike[self.labels]
        return covered

    def _shares(self, where: Mask) -> Floats:
        shares: Floats = np.bincount(self.labels[where], minlength=CLUSTERS) / max(int(where.sum()), 1)
        return shares
