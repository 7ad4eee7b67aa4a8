"""Likelihood of the pixels of a frame where no known body is: the background, a shadow on it, or what nobody named.

Log likelihoods are relative to a typical body's colours, as those of `appearance`.
"""

from __future__ import annotations

import cv2
import numpy as np

from atw_mcp.perception.background import LUMINANCE, Array32, Background
from atw_mcp.perception.known.settings import SETTINGS
from atw_mcp.perception.video import Frames

UNDESCRIBED = float(np.log(SETTINGS.other))
PLAIN = float(np.log((1.0 - SETTINGS.shadow - SETTINGS.other) * SETTINGS.typical / SETTINGS.own_bins))
SHADOWED = float(np.log(SETTINGS.shadow * SETTINGS.typical / SETTINGS.shadow_bins))


def nothing_there(frame: Frames, background: Background) -> Array32:
    """Return the log likelihood (H, W) of a frame's colours (H, W, 3) where no known body is.

    Levels between the darkest and the brightest of a pixel's neighbours in the background cost nothing: edges move by
    fractions of a pixel.
    """
    image = frame.astype(np.float32)
    lit = background.relit(frame)
    noise = max(float(background.noise.max()), SETTINGS.least_noise)
    kernel = np.ones((3, 3), np.uint8)
    off = np.maximum(np.maximum(cv2.erode(lit, kernel) - image, image - cv2.dilate(lit, kernel)), 0.0) / noise
    plain = PLAIN - 0.5 * np.minimum(np.einsum("ijk,ijk->ij", off, off), SETTINGS.farthest)
    shade = (image @ LUMINANCE + 4.0) / (lit @ LUMINANCE + 4.0)
    tint = np.abs(image - lit * shade[..., None]).max(axis=2) / (noise + 2.0)
    outside = np.maximum(np.maximum(SETTINGS.darkest - shade, shade - SETTINGS.brightest), 0.0) / SETTINGS.soft
    shadowed = SHADOWED - 0.5 * np.minimum(tint**2 + outside**2, SETTINGS.farthest)
    both: Array32 = np.logaddexp(np.logaddexp(plain, shadowed), UNDESCRIBED).astype(np.float32)
    return both
