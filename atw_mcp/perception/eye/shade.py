"""Shade: how a body darkens or lights the background around it, smooth in its own frame and alike over the clip."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from atw_mcp.perception.eye.pixels import Array, Floats, Mask, diffused, sampled
from atw_mcp.perception.eye.settings import EyeSettings


@dataclass(frozen=True)
class Shade:
    """Log factor of the background's brightness and its standard deviation, by place around a body (C, C, 2).

    The grid spans `reach` radii to each side of the body's centre, along the image's axes. Inside the silhouette it is
    continued from outside: what is dark on both sides of a contour decides nothing.
    """

    grid: Array
    reach: float

    def at(self, offsets: Floats) -> Array:
        """Log factor and standard deviation (M, 2) at offsets (M, 2) [radii] from the body's centre."""
        cells = len(self.grid)
        places = (offsets + self.reach) / (2 * self.reach) * cells - 0.5
        values = sampled(self.grid, places)
        outside = (np.abs(offsets) > self.reach).any(axis=1)
        values[outside] = 0.0
        return values


def learn_shade(seen: list[tuple[Array, Mask]], settings: EyeSettings) -> Shade | None:
    """Median over frames of the log brightness over the background's, on the grid around a body.

    seen: for each frame the log factor (C, C) and where it is the background's. None without any.
    """
    if not seen:
        return None
    values = np.array([np.where(valid, value, np.nan) for value, valid in seen], dtype=np.float32)
    count = np.isfinite(values).sum(axis=0)
    known = count > 0
    ordered = np.sort(values, axis=0)  # NaN last
    middle = np.take_along_axis(ordered, np.maximum((count - 1) // 2, 0)[None], axis=0)[0]
    apart = np.sort(np.abs(values - middle), axis=0)
    spread = 1.48 * np.take_along_axis(apart, np.maximum((count - 1) // 2, 0)[None], axis=0)[0]
    middle = diffused(np.nan_to_num(middle), known)
    spread = diffused(np.nan_to_num(spread), known & (count > 2))
    blur = settings.shade_blur
    grid = np.stack([cv2.GaussianBlur(middle, (0, 0), blur), cv2.GaussianBlur(spread, (0, 0), blur)], axis=-1)
    return Shade(grid.astype(np.float32), settings.shade_reach)


def shade_places(settings: EyeSettings) -> Floats:
    """Offsets (C * C, 2) [radii] of the grid's cells."""
    cells, reach = settings.shade_cells, settings.shade_reach
    line = (np.arange(cells) + 0.5) / cells * 2 * reach - reach
    across, down = np.meshgrid(line, line)
    return np.stack([across.ravel(), down.ravel()], axis=1)
