"""Bodies at rest that a modelled background may show: places of a body's size and colour unlike what surrounds them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.appearance import colour_bins
from atw_mcp.perception.background import Array32, Background, Mask
from atw_mcp.perception.known.bodies import Sizes
from atw_mcp.perception.known.finding import box_mean, fits, hiding, highest, odd, radii_of
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

    def covered_by(self, likelihood: Floats, sizes: Sizes, fixtures: Array32) -> Array32:
        """Return the most (H, W) that the log likelihood of a background is that a body may cover; infinite elsewhere.

        likelihood (BIN_COUNT,): of the body's colours, by its name; fixtures (H, W): distances [m] of what it may lie
        on, besides the floor, or behind, where pixels do not count. How much the clearest place exceeds the next one
        says how far it is from what the background has by chance.
        """
        summed = np.bincount(self.labels.ravel(), weights=likelihood[self.bins].ravel(), minlength=SETTINGS.clusters)
        named = summed / np.maximum(self.counts, 1)
        own = [(c, (self.labels == c).astype(np.float32)) for c in range(SETTINGS.clusters) if self.counts[c]]
        height, width = self.labels.shape
        best, radius = np.full((height, width), -np.inf, np.float32), np.zeros((height, width), np.float32)
        for r in radii_of(sizes):
            place = fits(r, sizes) & (sizes.floor | np.isfinite(fixtures))
            if not place.any():
                continue
            core, gap, ring = (
                odd(SETTINGS.square * SETTINGS.inner * r),
                odd(SETTINGS.square * SETTINGS.gap * r, 3),
                odd(SETTINGS.square * SETTINGS.outer * r, 5),
            )
            place &= box_mean(np.ones_like(fixtures, dtype=np.float32), core) >= SETTINGS.within
            seen = (~hiding(r, sizes, fixtures)[0]).astype(np.float32)
            inside = np.maximum(box_mean(seen, core), SETTINGS.least_inside)
            around = np.maximum(box_mean(seen, ring) * ring**2 - box_mean(seen, gap) * gap**2, 1.0)
            total = np.zeros_like(seen)
            for c, everywhere in own:
                where = everywhere * seen
                beside = (box_mean(where, ring) * ring**2 - box_mean(where, gap) * gap**2) / around
                share = box_mean(where, core) / inside
                total += share * (named[c] - np.log(np.maximum(beside, 0.0) + SETTINGS.rare))
            better = place & (total > best)
            best[better], radius[better] = total[better], r
        covered = np.full((height, width), np.inf, dtype=np.float32)
        y, x = np.mgrid[0:height, 0:width]
        peaks = highest(best, radius, SETTINGS.places, 0.0)
        for k, found in enumerate(p for p in peaks if p.score > SETTINGS.clear):
            excess = found.score - (peaks[1].score if len(peaks) > 1 else 0.0) if k == 0 else 0.0
            away = np.hypot(x - found.x, y - found.y) / found.radius
            free = ~hiding(found.radius, sizes, fixtures)[0]
            inner = self._shares(free & (away < SETTINGS.inner))
            ring_share = self._shares(free & (away > SETTINGS.reach) & (away < SETTINGS.outer))
            unlike = np.log(inner + SETTINGS.rare) - np.log(ring_share + SETTINGS.rare) > SETTINGS.unlike
            own_pixels = free & (away < SETTINGS.reach) & unlike[self.labels] & np.isinf(covered)
            covered[own_pixels] = -excess
        return covered

    def _shares(self, where: Mask) -> Floats:
        shares: Floats = np.bincount(self.labels[where], minlength=SETTINGS.clusters) / max(int(where.sum()), 1)
        return shares
