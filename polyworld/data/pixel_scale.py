"""Pixels of a fixed camera with a known scale, converted to positions in the plane of motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PixelScale:
    """The scale of a view without perspective.

    per_metre [px/m]. origin: pixel u, v of the world's origin. image_axes: v counts downwards, as image files have it.
    view: "side" maps u to x and v to z; "top" maps u to x and v to y. Raises ValueError for a scale that is not
    positive.
    """

    per_metre: float
    origin: tuple[float, float] = (0.0, 0.0)
    image_axes: bool = False
    view: Literal["side", "top"] = "side"

    def __post_init__(self) -> None:
        if not (np.isfinite(self.per_metre) and self.per_metre > 0.0):
            raise ValueError(f"the scale must be a positive number of pixels per metre, got {self.per_metre}")

    def positions(self, pixels: Array) -> Array:
        """Return positions (..., 3) [m] of pixels (..., 2); the component along the line of sight is NaN."""
        offset = (pixels - np.asarray(self.origin)) / self.per_metre
        found: Array = np.full((*pixels.shape[:-1], 3), np.nan)
        found[..., 0] = offset[..., 0]
        found[..., 2 if self.view == "side" else 1] = -offset[..., 1] if self.image_axes else offset[..., 1]
        return found
