"""Darkness of shadows: one light and one surrounding make all shadows of a scene darken the floor by one factor.

An object's shading varies over it and from object to object; the factor of a cast shadow does not. So the factor is
read from all moving regions together: the brightness ratio at which uniform, hueless pixels gather, in regions that
also hold something else, the body that casts the shadow (intensity-ratio shadow detection: Rosin & Ellis 1995, BMVC).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

DARKEST, LIGHTEST = 0.3, 0.92  # ratios between which a shadow's factor is sought
BIN = 0.02
WIDTH = 0.06  # half-width of the factor: noise, and light from bodies near by
UNIFORM = 0.05  # spread of the ratio in a small neighbourhood within a shadow
PENUMBRA = 7  # pixels around a shadow in which the ratio may rise to one
LEAST, MOST = 0.04, 0.75  # share of a region that is shadow where the rest is the body that casts it
REGIONS = 3  # such regions that show a shadow's factor
EVERYWHERE = 3  # power of the share of regions that show a factor, by which its pixels count
EDGE = 0.05  # change of the ratio a pixel at which a shadow or a body ends; the shading of a body changes it less
DARKER = 0.2  # share of a region that no shadow has below its factor
GATHERED = 2.5  # times as many pixels at the factor as beside it


@dataclass(frozen=True)
class Ratios:
    """Of one frame: tint (H, W) that shading leaves [levels], shade (H, W) brightness ratio, and what stands out
    (H, W)."""

    tint: Array32
    shade: Array32
    apart: Mask


def uniform(shade: Array32) -> Mask:
    """Return where the ratio (H, W) hardly varies in a small neighbourhood."""
    mean = cv2.blur(shade, (3, 3))
    spread = np.sqrt(np.maximum(cv2.blur(shade * shade, (3, 3)) - mean * mean, 0.0))
    calm: Mask = spread < UNIFORM
    return calm


def shadow_factor(frames: Sequence[Ratios], hueless: float) -> float | None:
    """Return the factor by which shadows darken the background, None where no moving region shows one.

    hueless: tint [levels] below which a pixel's colour is that of the background under other light.
    """
    bins = np.arange(DARKEST, LIGHTEST + BIN, BIN)
    votes = np.zeros(len(bins) - 1)
    seen = np.zeros(len(bins) - 1)
    held = np.zeros(len(bins) - 1)
    regions = 0
    for f in frames:
        doubtful = f.apart & (f.tint < hueless) & uniform(f.shade)
        count, labels = cv2.connectedComponents(f.apart.astype(np.uint8), connectivity=8)
        for k in range(1, count):
            region = labels == k
            total = int(region.sum())
            if total < 30:
                continue
            own = np.histogram(f.shade[region & doubtful], bins)[0].astype(float)
            smooth = np.convolve(own, np.ones(5), "same")
            if _is_one_patch(region, doubtful, f.shade, bins[int(smooth.argmax())] + BIN / 2):
                continue
            share = smooth / total
            regions += 1
            votes += own
            seen += (share > LEAST) & (share < MOST)
            held += own > 0
    smooth = np.convolve(votes, np.ones(5), "same")
    # A grey body is as uniform as a shadow, but only its own region shows it: a shadow's factor is in nearly all.
    candidates = np.where(seen >= REGIONS, smooth * (seen / max(regions, 1)) ** EVERYWHERE, 0.0)
    if not candidates.any():
        return None
    best = int(np.argmax(candidates))
    beside = np.concatenate([smooth[max(best - 9, 0) : max(best - 4, 0)], smooth[best + 5 : best + 10]])
    if len(beside) and smooth[best] < GATHERED * float(np.median(beside)):
        return None
    low, high = max(best - 2, 0), min(best + 3, len(votes))
    middle = 0.5 * (bins[low:high] + bins[low + 1 : high + 1])
    weight = votes[low:high] * (held[low:high] / regions) ** EVERYWHERE
    return float((weight * middle).sum() / weight.sum())


def _is_one_patch(region: Mask, doubtful: Mask, shade: Array32, ratio: float) -> bool:
    """Whether nearly all of a region has one ratio, or is the rim of what has: a body alone, or a shadow alone."""
    core = region & doubtful & (np.abs(shade - ratio) < WIDTH)
    return int((region & ~_rimmed(core)).sum()) < LEAST * int(region.sum())


def _rimmed(core: Mask) -> Mask:
    ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (PENUMBRA, PENUMBRA))
    found: Mask = cv2.dilate(core.astype(np.uint8), ellipse) > 0
    return found


def shadow_mask(tint: Array32, shade: Array32, factor: float, hueless: float) -> Mask:
    """Return the pixels (H, W) of shadows of a known factor, with their penumbras."""
    core = (np.abs(shade - factor) < WIDTH) & (tint < hueless) & uniform(shade)
    core = cv2.morphologyEx(core.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    body = _shaded_bodies(tint, shade, factor, hueless)
    core &= ~body
    rim = _rimmed(core) & (shade > factor - WIDTH) & (shade < 1.0) & (tint < hueless) & ~body
    found: Mask = core | rim
    return found


def _shaded_bodies(tint: Array32, shade: Array32, factor: float, hueless: float) -> Mask:
    """Return the regions (H, W) whose brightness passes, without an edge, to what is darker than a shadow.

    A grey body's lit side may be as dark as a shadow. It grows darker bit by bit towards its other side; a shadow ends
    in an edge, at the body or on the floor.
    """
    slope = np.hypot(cv2.Sobel(shade, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(shade, cv2.CV_32F, 0, 1, scale=0.125))
    smooth = (shade < factor + WIDTH) & (tint < hueless) & (slope < EDGE)
    count, labels = cv2.connectedComponents(smooth.astype(np.uint8), connectivity=4)
    size = np.bincount(labels.ravel(), minlength=count)
    darker = np.bincount(labels[shade < factor - WIDTH], minlength=count)
    body = darker > DARKER * size
    body[0] = False
    found: Mask = body[labels]
    return found
