"""The rim of a mask, put where pixels are half object and half what is beside it."""

from __future__ import annotations

import cv2
import numpy as np

from atw_mcp.perception.background import Mask
from atw_mcp.perception.segmentation import fill_holes, nearby_mean
from atw_mcp.perception.video import Frames

INNER, OUTER = 7, 9  # pixels: width of the windows in which the colours of object and surroundings are taken
LEAST_STEP = 10.0  # levels between them from which the rim is moved
CHROMA = 0.5  # weight of chroma, which is filmed at half the resolution, against luminance


def half_covered(ycc: Frames, mask: Mask, outside: Mask | None = None) -> Mask:
    """Return a mask (h, w) with its rim moved by up to two pixels to half coverage, as an image (h, w, 3) shows it.

    outside: what may count as surroundings; default: everything that is not the mask.
    """
    if not mask.any():
        return mask
    image = ycc.astype(np.float32) * np.array([1.0, CHROMA, CHROMA], np.float32)
    byte = mask.astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    inner = cv2.erode(cv2.erode(byte, np.ones((3, 3), np.uint8), borderValue=1), cross, borderValue=1)
    if inner.sum() < 0.08 * byte.sum():  # small objects have hardly an interior
        inner = cv2.erode(byte, cross, borderValue=1)
    thin = mask & (cv2.dilate(inner, np.ones((7, 7), np.uint8)) == 0)
    inner = inner | thin.astype(np.uint8)
    outer = cv2.dilate(byte, np.ones((5, 5), np.uint8))
    ground = outer == 0 if outside is None else (outer == 0) & outside
    own, own_known = nearby_mean(image, inner > 0, INNER)
    beside, beside_known = nearby_mean(image, ground, OUTER)
    step = own - beside
    strength = np.einsum("ijk,ijk->ij", step, step)
    share = np.einsum("ijk,ijk->ij", image - beside, step) / (strength + 1.0)
    band = (outer > 0) & (inner == 0) & own_known & beside_known & (strength > LEAST_STEP**2)
    moved = fill_holes(np.where(band, share > 0.5, mask), 0.3).astype(np.uint8)
    opened = cv2.morphologyEx(moved, cv2.MORPH_OPEN, cross)
    return (opened if opened.sum() > 0.6 * moved.sum() else moved) > 0
