"""Bodies at rest that a modelled background may show: places of a body's size and colour unlike what surrounds them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.appearance import colour_bins
from atw_mcp.perception.background import Array32, Background, Mask
from atw_mcp.perception.known.bodies import Sizes
from atw_mcp.perception.known.finding import box_mean, fits, highest, odd, radii_of
from atw_mcp.perception.known.settings import SETTINGS
from atw_mcp.perception.still_colours import cluster_colours

Floats = NDArray[np.float64]


class StillBodies:
    """The colours of a background, in clusters."""

    def __init__(self, background: Background) -> None:
        image = np.clip(background.image, 0, 255).astype(np.uint8)
        self.bins = colour_bins(image)
        scale = np.array([SETTINGS.lightness, 1.0, 1.0], dtype=np.float32)
        lab = cv2.cvtColor(cv2.medianBlur(image, 3), cv2.COLOR_BGR2LAB).astype(np.float32) * scale
        self.labels = cluster_colours(lab, SETTINGS.clusters)
        self.counts = np.bincount(self.labels.ravel(), minlength=SETTINGS.clusters)

    def covered_by(self, likelihood: Floats, sizes: Sizes, fixed: Mask) -> Array32:
        """Return the most (H, W) that the log likelihood of a background is that a body may cover; infinite elsewhere.

        likelihood (BIN_COUNT,): of the body's colours, by its name; fixed (H, W): where it may lie besides the floor.
        How much the clearest place exceeds the next one says how far it is from what the background has by chance.
        """
        summed = np.bincount(self.labels.ravel(), weights=likelihood[self.bins].ravel(), minlength=SETTINGS.clusters)
        named = summed / np.maximum(self.counts, 1)
        own = [(c, (self.labels == c).astype(np.float32)) for c in range(SETTINGS.clusters) if self.counts[c]]
        height, width = self.labels.shape
        one = np.ones((height, width), dtype=np.float32)
        best, radius = np.full(one.shape, -np.inf, dtype=np.float32), np.zeros_like(one)
        for r in radii_of(sizes):
            place = fits(r, sizes) & (sizes.floor | fixed)
            if not place.any():
                continue
            core, gap, ring = (
                odd(SETTINGS.square * SETTINGS.inner * r),
                odd(SETTINGS.square * SETTINGS.gap * r, 3),
                odd(SETTINGS.square * SETTINGS.outer * r, 5),
            )
            inside = np.maximum(box_mean(one, core), 0.3)
            around = np.maximum(box_mean(one, ring) * ring**2 - box_mean(one, gap) * gap**2, 1.0)
            total = np.zeros_like(one)
            for c, where in own:
                beside = (box_mean(where, ring) * ring**2 - box_mean(where, gap) * gap**2) / around
                share = box_mean(where, core) / inside
                total += share * (named[c] - np.log(np.maximum(beside, 0.0) + SETTINGS.rare))
            better = place & (total > best)
            best[better], radius[better] = total[better], r
        covered = np.full(one.shape, np.inf, dtype=np.float32)
        y, x = np.mgrid[0:height, 0:width]
        peaks = highest(best, radius, SETTINGS.places, 0.0)
        for k, found in enumerate(p for p in peaks if p.score > SETTINGS.clear):
            excess = found.score - (peaks[1].score if len(peaks) > 1 else 0.0) if k == 0 else 0.0
            away = np.hypot(x - found.x, y - found.y) / found.radius
            inner = self._shares(away < SETTINGS.inner)
            ring_share = self._shares((away > SETTINGS.reach) & (away < SETTINGS.outer))
            unlike = np.log(inner + SETTINGS.rare) - np.log(ring_share + SETTINGS.rare) > SETTINGS.unlike
            covered[(away < SETTINGS.reach) & unlike[self.labels] & (covered == np.inf)] = -SETTINGS.still - excess
        return covered

    def _shares(self, where: Mask) -> Floats:
        shares: Floats = np.bincount(self.labels[where], minlength=SETTINGS.clusters) / max(int(where.sum()), 1)
        return shares
