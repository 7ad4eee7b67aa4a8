"""Rims: an outline grown to the edges around it, where a region shows only a part of a body."""

from __future__ import annotations

import cv2
import numpy as np

from atw_mcp.perception.eye.colours import STRETCH
from atw_mcp.perception.eye.pixels import Array, Bytes, Floats, Mask, features, filled
from atw_mcp.perception.eye.settings import EyeSettings


def grown(frame: Bytes, outline: Floats, settings: EyeSettings) -> Floats:
    """Outline (V, 2) [px] of the body of which an outline holds a part; the same where it holds most of it.

    The lit side of a body of the ground's own colour passes smoothly into one that does not differ from the ground: no
    edge of the frame lies there. The body ends at the highest ridge of the gradient between the middle of the outline
    and all that is far from it (watershed; Meyer 1994).
    """
    radius = float(np.sqrt(abs(cv2.contourArea(outline.astype(np.float32))) / np.pi))
    margin = int(settings.grown_reach * radius) + 3
    last = np.array(frame.shape[1::-1])
    low = np.clip(np.floor(outline.min(axis=0)).astype(int) - margin, 0, last)
    high = np.clip(np.ceil(outline.max(axis=0)).astype(int) + margin + 1, 0, last)
    corner, size = (int(low[0]), int(low[1])), (int(high[0] - low[0]), int(high[1] - low[1]))
    if min(size) < 5:
        return outline
    inside = filled(outline, corner, size)
    middle = cv2.erode(inside.astype(np.uint8), _disc(0.25 * radius)) > 0
    far = cv2.dilate(inside.astype(np.uint8), _disc(margin - 2)) == 0
    if not middle.any() or not far.any():
        return outline
    marks = np.where(middle, 1, np.where(far, 2, 0)).astype(np.int32)
    window = frame[corner[1] : corner[1] + size[1], corner[0] : corner[0] + size[0]]
    look = features(cv2.GaussianBlur(window, (0, 0), 0.7).astype(np.float32), settings)
    if np.abs(np.median(look[inside], axis=0) - np.median(look[far], axis=0))[1:].max() > settings.own_hue:
        return outline  # its colour shows all of it
    steep = _steepness(look)
    found = cv2.watershed(np.repeat(np.clip(steep, 0, 255).astype(np.uint8)[..., None], 3, axis=2), marks) == 1
    opened = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_OPEN, _disc(0.25 * radius))
    whole = np.asarray(opened, dtype=np.uint8)
    contours, _ = cv2.findContours(whole, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours or whole.sum() < settings.grown * inside.sum():
        return outline
    before, after = (float(steep[_rim(mask)].mean()) for mask in (inside.astype(np.uint8), whole))
    if after < settings.as_steep * before:
        return outline
    polygon = max(contours, key=cv2.contourArea)[:, 0].astype(float)
    middle_of = polygon.mean(axis=0)
    return np.asarray(middle_of + (polygon - middle_of) * (1 + 0.5 / radius) + low)  # pixels' centres to their edges


def _steepness(look: Array) -> Array:
    """Size (H, W) of the gradient in each pixel, 255 at the steepest but for a few."""
    slopes = [np.hypot(cv2.Sobel(f, -1, 1, 0), cv2.Sobel(f, -1, 0, 1)) for f in cv2.split(look * STRETCH)]
    total = np.sum(slopes, axis=0)
    return np.asarray(255 * total / max(float(np.percentile(total, 99.5)), 1e-6), dtype=np.float32)


def _rim(mask: Bytes) -> Mask:
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0)


def _disc(radius: float) -> Bytes:
    size = 2 * max(1, int(radius)) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)
