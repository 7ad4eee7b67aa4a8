"""How likely the pixels of a frame are where no known body is: the background, a shadow on it, or what nobody named.

Log likelihoods are relative to a typical body's colours, as those of `appearance`.
"""

from __future__ import annotations

import cv2
import numpy as np

from atw_mcp.perception.background import LUMINANCE, Array32, Background
from atw_mcp.perception.video import Frames

SHADOW, OTHER = 0.05, 0.02  # shares of pixels in shadows, and of things that are neither background nor known
TYPICAL = 300.0  # colour bins of a typical body
OWN_BINS, SHADOW_BINS = 8.0, 60.0  # bins over which noise, and shadows of any depth, spread a background's colour
UNDESCRIBED = float(np.log(OTHER))
PLAIN = float(np.log((1.0 - SHADOW - OTHER) * TYPICAL / OWN_BINS))
SHADOWED = float(np.log(SHADOW * TYPICAL / SHADOW_BINS))
LEAST_NOISE = 3.0  # levels: rounding, and what compression does to flat colours
DARKEST, BRIGHTEST, SOFT = 0.3, 1.15, 0.05  # brightness ratios of shadows and highlights, and their margin
FARTHEST = 80.0  # squared deviations beyond which all are alike


def nothing_there(frame: Frames, background: Background) -> Array32:
    """Return the log likelihood (H, W) of a frame's colours (H, W, 3) where no known body is.

    Levels between the darkest and the brightest of a pixel's neighbours in the background cost nothing: edges move by
    fractions of a pixel.
    """
    image = frame.astype(np.float32)
    lit = background.relit(frame)
    noise = max(float(background.noise.max()), LEAST_NOISE)
    kernel = np.ones((3, 3), np.uint8)
    off = np.maximum(np.maximum(cv2.erode(lit, kernel) - image, image - cv2.dilate(lit, kernel)), 0.0) / noise
    plain = PLAIN - 0.5 * np.minimum(np.einsum("ijk,ijk->ij", off, off), FARTHEST)
    shade = (image @ LUMINANCE + 4.0) / (lit @ LUMINANCE + 4.0)
    tint = np.abs(image - lit * shade[..., None]).max(axis=2) / (noise + 2.0)
    outside = np.maximum(np.maximum(DARKEST - shade, shade - BRIGHTEST), 0.0) / SOFT
    shadowed = SHADOWED - 0.5 * np.minimum(tint**2 + outside**2, FARTHEST)
    both: Array32 = np.logaddexp(np.logaddexp(plain, shadowed), UNDESCRIBED).astype(np.float32)
    return both
