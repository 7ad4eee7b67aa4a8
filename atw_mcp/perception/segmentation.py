"""Which pixels of a frame belong to objects: differences from the background that are not light or shadow.

A shadow multiplies the background by a factor between about 0.7 and 1 and keeps its hue; a reflection of an
object on the floor tints it slightly. Objects differ more, or differ as much but with sharp edges. The rim
of each object is then put where a pixel is half object and half background, as seen beside it, so that masks
are unbiased to a fraction of a pixel and stop at the edge of their own contact shadow.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Array32, Background, Mask
from atw_mcp.perception.shadows import Ratios, shadow_factor, shadow_mask
from atw_mcp.perception.video import Frames

STRONG_TINT = 14.0  # levels of colour that shading of the background does not explain
WEAK_TINT = 8.0
SHADOW_DARKEST = 0.76  # of the background's luminance; deeper than this is an object
SHADOW_DEEPEST = 0.45  # where several shadows overlap, beside an object
LIGHT_BRIGHTEST = 1.18
FAINT_SHADE = 0.93
SHADOW_TINT = 6.0  # levels of colour within a cast shadow, whose light has nearly the hue of the lamp's
SHADOW_FRAMES = 12  # in which the factor of shadows is read


@dataclass(frozen=True)
class Foreground:
    """Objects' pixels of one frame.

    labels (H, W): connected components from 1; areas (k,) [px] of component i + 1; hueless (H, W): pixels with the
    background's hue that are darker than it; shade (H, W): brightness relative to the background.
    """

    labels: NDArray[np.uint8]
    areas: NDArray[np.int32]
    hueless: Mask
    shade: NDArray[np.float16]

    @property
    def mask(self) -> Mask:
        """All objects' pixels (H, W)."""
        inside: Mask = self.labels > 0
        return inside

    @cached_property
    def dim(self) -> Mask:
        """Pixels (H, W) that could as well be in a dark shadow."""
        lit: Mask = self.shade > SHADOW_DEEPEST
        return self.hueless & lit


def shadows_of(frames: Frames, background: Background) -> float | None:
    """Return the factor by which cast shadows darken the background in frames (T, H, W, 3).

    None where none shows, or where they are so light that no object's seed is as dark."""
    picks = np.unique(np.linspace(0, len(frames) - 1, min(SHADOW_FRAMES, len(frames))).round().astype(int))
    noise = float(background.noise.max())
    found = []
    for t in picks:
        tint, shade, contrast = _evidence(frames[t].astype(np.float32), background.relit(frames[t]))
        visible = contrast > max(10.0, 4 * noise)
        strong_tint = max(STRONG_TINT, 5 * noise)
        apart = visible & ((tint > strong_tint) | (shade < FAINT_SHADE) | (shade > LIGHT_BRIGHTEST))
        apart = cv2.morphologyEx(apart.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        found.append(Ratios(tint, shade, apart))
    factor = shadow_factor(found, max(SHADOW_TINT, 4 * noise))
    return factor if factor is not None and factor < SHADOW_DARKEST else None


def segment(frame: Frames, background: Background, *, min_area: int, shadow: float | None = None) -> Foreground:
    """Foreground of one frame (H, W, 3); components below `min_area` pixels are dropped.

    shadow: factor by which cast shadows darken the background, where it is known.
    """
    image = frame.astype(np.float32)
    lit = background.relit(frame)
    tint, shade, contrast = _evidence(image, lit)
    noise = float(background.noise.max())
    strong_tint, weak_tint = max(STRONG_TINT, 5 * noise), max(WEAK_TINT, 4 * noise)
    visible = contrast > max(10.0, 4 * noise)
    strong = (tint > strong_tint) | (((shade < SHADOW_DARKEST) | (shade > LIGHT_BRIGHTEST)) & visible)
    weak = (tint > weak_tint) | (((shade < FAINT_SHADE) | (shade > 2 - FAINT_SHADE)) & visible)
    if shadow is not None:
        cast = shadow_mask(tint, shade, shadow, max(SHADOW_TINT, 4 * noise))
        strong, weak = strong & ~cast, weak & ~cast
    strong = _clean(strong, min_area)
    strong |= _faint_objects(weak & ~strong, strong, image - lit, min_area)
    mask = _half_covered(image, strong, weak)
    labels, areas = components(mask, min_area)
    return Foreground(labels, areas, (tint < 0.75 * strong_tint) & (shade < 1.0), shade.astype(np.float16))


def components(mask: Mask, min_area: int) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Connected components (4-neighbours) of at least `min_area` pixels: labels (H, W) and areas (k,)."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    keep = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= min_area]
    keep = sorted(keep, key=lambda k: -int(stats[k, cv2.CC_STAT_AREA]))[:255]
    lookup = np.zeros(count, dtype=np.uint8)
    lookup[keep] = np.arange(1, len(keep) + 1)
    return lookup[labels], stats[keep, cv2.CC_STAT_AREA].astype(np.int32)


def _evidence(image: Array32, lit: Array32) -> tuple[Array32, Array32, Array32]:
    """Colour that shading leaves unexplained [levels], brightness ratio, and brightness contrast [levels]."""
    luminance, expected = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.cvtColor(lit, cv2.COLOR_BGR2GRAY)
    shade = (luminance + 4.0) / (expected + 4.0)
    tint = np.abs(image[..., 0] - lit[..., 0] * shade)
    for channel in (1, 2):
        np.maximum(tint, np.abs(image[..., channel] - lit[..., channel] * shade), out=tint)
    # Chroma is stored at half resolution and is noisy: judge it over a small neighbourhood.
    contrast = np.abs(np.subtract(luminance, expected, dtype=np.float32))
    return _blurred(tint), _blurred(shade), contrast


def _blurred(image: Array32) -> Array32:
    return np.asarray(cv2.blur(image, (3, 3)), dtype=np.float32)


def _clean(strong: Mask, min_area: int) -> Mask:
    """Closed over thin gaps, filled, without specks."""
    ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    mask = cv2.morphologyEx(strong.astype(np.uint8), cv2.MORPH_CLOSE, ellipse)
    mask = fill_holes(mask > 0, 0.5).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, ellipse)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    keep = stats[:, cv2.CC_STAT_AREA] >= max(min_area // 2, 4)
    keep[0] = False
    cleaned: Mask = keep[labels]
    return cleaned


def without_shadow(mask: Mask, foreground: Foreground, *, has_hue: bool) -> Mask:
    """Return an object's mask without the dark shadow beside it.

    Of an object that has a hue the hueless dim parts at its rim go; of a hueless one the protrusions that are
    lighter than it is.
    """
    if not mask.any():
        return mask
    rows, columns = np.nonzero(mask.any(axis=1))[0], np.nonzero(mask.any(axis=0))[0]
    view = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    region, dim = mask[view], foreground.dim[view]
    doubtful = region & dim
    if not doubtful.any():
        return mask
    if has_hue:
        kept = region & ~doubtful
    else:
        radius = max(int(0.45 * np.sqrt(region.sum() / np.pi)), 1)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        padded = cv2.copyMakeBorder(region.astype(np.uint8), radius, radius, radius, radius, cv2.BORDER_REPLICATE)
        opened = cv2.morphologyEx(padded, cv2.MORPH_OPEN, disc)
        body = opened[radius : radius + region.shape[0], radius : radius + region.shape[1]] > 0
        if not (body & region).any():
            return mask
        level = float(np.median(foreground.shade[view][body & region]))
        kept = region & ~(doubtful & ~body & (foreground.shade[view] > level + 0.03))
    small = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    kept = cv2.morphologyEx(kept.astype(np.uint8), cv2.MORPH_OPEN, small) > 0
    cleaned = np.zeros_like(mask)
    cleaned[view] = fill_holes(kept, 0.5) & region
    return cleaned if cleaned.sum() > 0.4 * mask.sum() else mask


def fill_holes(mask: Mask, largest: float) -> Mask:
    """`mask` with the holes filled that are smaller than `largest` times the component around them."""
    contours, hierarchy = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if hierarchy is None:
        return mask
    filled = mask.astype(np.uint8)
    for contour, (_, _, _, parent) in zip(contours, hierarchy[0], strict=True):
        if parent >= 0 and cv2.contourArea(contour) < largest * cv2.contourArea(contours[parent]):
            cv2.drawContours(filled, [contour], -1, 1, thickness=cv2.FILLED)
    return filled > 0


def _faint_objects(weak: Mask, strong: Mask, difference: Array32, min_area: int) -> Mask:
    """Faint regions, away from any strong one, whose edges are as sharp as an object's."""
    found = np.zeros_like(weak)
    opened = cv2.morphologyEx(weak.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    if count == 1:
        return found
    near = cv2.dilate(strong.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    touching = np.unique(labels[near])
    faint = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= min_area and k not in touching]
    if not faint:
        return found
    level = cv2.GaussianBlur(cv2.cvtColor(difference, cv2.COLOR_BGR2GRAY), (0, 0), 0.7)
    slope = np.hypot(cv2.Sobel(level, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(level, cv2.CV_32F, 0, 1, scale=0.125))
    for k in faint:
        left, top, wide, tall = (int(v) for v in stats[k, :4])
        window = (slice(max(top - 1, 0), top + tall + 1), slice(max(left - 1, 0), left + wide + 1))
        region = labels[window] == k
        rim = cv2.morphologyEx(region.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
        height = float(np.percentile(np.abs(level[window][region]), 60))
        # A step blurred by the lens rises by more than a fifth of its height per pixel; penumbras by less.
        if height > 8.0 and np.median(slope[window][rim]) > 0.2 * height:
            found[window] |= region
    return fill_holes(found, 0.5)


def _half_covered(image: Array32, seeds: Mask, weak: Mask) -> Mask:
    """Return the seeds with their rim moved to where pixels are half object, half the background beside it."""
    mask = seeds.copy()
    count, _, stats, _ = cv2.connectedComponentsWithStats(
        cv2.dilate(seeds.astype(np.uint8), np.ones((17, 17), np.uint8)), connectivity=4
    )
    for k in range(1, count):
        left, top, wide, tall = (int(v) for v in stats[k, :4])
        view = (slice(top, top + tall), slice(left, left + wide))
        mask[view] = _half_covered_window(image[view], seeds[view], weak[view])
    return fill_holes(mask, 0.3)


def _half_covered_window(image: Array32, seeds: Mask, weak: Mask) -> Mask:
    byte = seeds.astype(np.uint8)
    inner = cv2.erode(byte, np.ones((3, 3), np.uint8), borderValue=1)
    inner = cv2.erode(inner, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)), borderValue=1)
    thin = seeds & (cv2.dilate(inner, np.ones((7, 7), np.uint8)) == 0)
    inner = inner | thin.astype(np.uint8)  # small objects have no interior: they are their own
    outer = cv2.dilate(byte, np.ones((5, 5), np.uint8))
    object_colour, object_known = nearby_mean(image, inner, 7)
    ground_colour, ground_known = nearby_mean(image, 1 - outer, 9)
    contrast = object_colour - ground_colour
    strength = np.einsum("ijk,ijk->ij", contrast, contrast)
    share = np.einsum("ijk,ijk->ij", image - ground_colour, contrast) / (strength + 1.0)
    band = (outer > 0) & (inner == 0) & object_known & ground_known & (strength > 12.0**2)
    mask = np.where(band, share > 0.5, seeds) & (seeds | weak)
    return (
        cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))) > 0
    )


def nearby_mean(image: Array32, where: NDArray[Any], width: int) -> tuple[Array32, Mask]:
    """Mean of image over the chosen pixels in a window around each pixel, and where there are any."""
    weight = where.astype(np.float32)
    total = cv2.boxFilter(weight, -1, (width, width), normalize=False, borderType=cv2.BORDER_CONSTANT)
    summed = cv2.boxFilter(
        image * weight[..., None], -1, (width, width), normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    mean: Array32 = (summed / np.maximum(total, 1.0)[..., None]).astype(np.float32)
    return mean, total > 0.5
