"""An object's outline in one frame from a box, points or a mask.

Several ways are tried, as none works on every ground: what stands out from the background and is no shadow, colours
learned from it, GrabCut (Rother et al. 2004, ACM TOG 23, 309), regions of even colour around a point, and the ellipse
in a box where nothing stands out. The one is taken whose outline lies on edges of the image and fills the box.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Mask
from atw_mcp.perception.partition import solidity
from atw_mcp.perception.pixel_evidence import Look, PixelEvidence, View
from atw_mcp.perception.rims import half_covered
from atw_mcp.perception.segmentation import fill_holes
from atw_mcp.perception.video import Frames

Point = tuple[float, float]
Box = tuple[float, float, float, float]

LEAST = 8  # pixels of an object
TOLERANCES = (4, 6, 9, 13, 18, 25, 35)  # levels by which a region of even colour may vary
LOOSE, LOOSE_PIXELS = 0.12, 3.0  # share of a box, and pixels, by which it may be larger than the object on each side
SAME_TONE = 9.0  # levels of chroma within which two pixels have one hue
DIMMEST, BRIGHTEST = 0.35, 1.6  # times as much chroma as that of a point, in other light
UNLIKE_COST = 1.5  # against an outline of which nothing has the hue of the points given
LARGEST = 0.15  # of the image: a region around a point that is larger is background


@dataclass(frozen=True)
class Hint:
    """Hint of an object's outline in a frame, in working pixels: box (left, top, width, height), points inside and
    outside it, a first mask (h, w); any of them may be missing."""

    box: Box | None = None
    inside: tuple[Point, ...] = ()
    outside: tuple[Point, ...] = ()
    mask: Mask | None = None


@dataclass(frozen=True)
class Outlined:
    """mask (h, w) of the object; distinct: whether it stands out from its surroundings by some measure."""

    mask: Mask
    distinct: bool


def outlined(evidence: PixelEvidence, row: int, hint: Hint) -> Outlined | None:
    """Return the best outline that agrees with a hint; None where none does."""
    if hint.mask is not None and hint.box is None and not hint.inside and not hint.outside:
        return Outlined(hint.mask, True)
    view = _window(hint, evidence.models.size)
    image = evidence.models.ycc[row][view]
    local = _shifted(hint, view)
    slope = _slope(image)
    alike = _alike(image, local)
    best, most = None, -np.inf
    allowed = np.ones(image.shape[:2], dtype=bool) if local.box is None else _rectangle(local.box, image.shape)
    for candidate, worth in _candidates(evidence, row, view, image, local, allowed):
        mask = _agreeing(image, candidate, allowed, local)
        if mask is None:
            continue
        score = worth + _worth(mask, slope, local) - UNLIKE_COST * float(1.0 - alike[mask].mean())
        if score > most:
            best, most = mask, score
    distinct = best is not None
    if best is None and local.box is not None and not local.inside:
        best = _ellipse(local.box, image.shape[:2]) & ~_spots(local.outside, image.shape[:2])
    if best is None or best.sum() < LEAST:
        return None
    whole = np.zeros(evidence.models.size, dtype=bool)
    whole[view] = best
    return Outlined(whole, distinct)


def _candidates(
    evidence: PixelEvidence, row: int, view: View, image: Frames, hint: Hint, allowed: Mask
) -> Iterator[tuple[Mask, float]]:
    """Masks of the window, each with what speaks for the way it was found."""
    shape = image.shape[:2]
    apart = cv2.GaussianBlur(evidence.apart(row, view), (0, 0), 0.8) > 0
    if hint.inside and hint.box is None and hint.mask is None:
        # Bodies that touch are one region: the part of it that has the point's hue is one body.
        part = _parts(_clean(apart & allowed & _alike(image, hint)), hint)
        if part.sum() >= LEAST:
            yield part, 0.35
    first = _clean(apart & allowed)
    if hint.mask is not None:
        first &= cv2.dilate(hint.mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    chosen = _parts(first, hint)
    if chosen.sum() >= LEAST:
        yield chosen, 0.35 if not hint.outside else -1.0
        whole = np.zeros(evidence.models.size, dtype=bool)
        whole[view] = chosen
        look = Look.of(evidence.models.ycc, [row], [whole])
        again = cv2.GaussianBlur(evidence.ratio(look, row, view), (0, 0), 0.8) > 0
        yield _clean(again & allowed), 0.25 if not hint.outside else -1.0
        # Bodies that touch are one region: of a point's own colour there is only its own body.
        # Where some point is outside, what it belongs to stands out as well: only learned colours distinguish the two.
        if hint.inside or hint.mask is not None:
            yield grab_cut(image, _guess(shape, hint, chosen, ~allowed)), 0.1
    yield grab_cut(image, _guess(shape, hint, np.zeros(shape, dtype=bool), ~allowed)), 0.0
    if hint.box is not None and hint.mask is None:
        yield grab_cut(image, _guess(shape, hint, _ellipse(hint.box, shape), ~allowed)), 0.05
    for point in hint.inside[:4]:
        for tolerance in TOLERANCES:
            region = _even(image, point, tolerance)
            if region.sum() < LARGEST * evidence.models.size[0] * evidence.models.size[1]:
                yield _clean(region & allowed), -0.05


def grab_cut(image: Frames, guess: NDArray[np.uint8], iterations: int = 4) -> Mask:
    """Object pixels of an image given a first guess (cv2.GC_* labels); the guess itself where it is one-sided."""
    label = guess.copy()
    inside: Mask = (label == cv2.GC_FGD) | (label == cv2.GC_PR_FGD)
    if inside.all() or not inside.any():
        return inside
    cv2.setRNGSeed(0)  # the colour clusters start at random: fixed, so that equal inputs give equal masks
    cv2.grabCut(
        np.ascontiguousarray(image),
        label,
        (0, 0, 1, 1),  # not used with an initial mask
        np.zeros((1, 65)),
        np.zeros((1, 65)),
        iterations,
        cv2.GC_INIT_WITH_MASK,
    )
    result: Mask = (label == cv2.GC_FGD) | (label == cv2.GC_PR_FGD)
    return result


def _guess(shape: tuple[int, ...], hint: Hint, likely: Mask, forbidden: Mask) -> NDArray[np.uint8]:
    guess = np.full(shape, cv2.GC_PR_BGD, np.uint8)
    if likely.any():
        guess[likely] = cv2.GC_PR_FGD
    elif hint.mask is not None:
        guess[hint.mask] = cv2.GC_PR_FGD
    elif hint.box is not None:
        guess[~forbidden] = cv2.GC_PR_FGD
    else:
        for x, y in hint.inside:
            cv2.circle(guess, (round(x), round(y)), max(6, round(0.06 * min(shape))), cv2.GC_PR_FGD, cv2.FILLED)
    guess[forbidden] = cv2.GC_BGD
    for points, label in ((hint.inside, cv2.GC_FGD), (hint.outside, cv2.GC_BGD)):
        for x, y in points:
            cv2.circle(guess, (round(x), round(y)), 2, label, cv2.FILLED)
    return guess


def _agreeing(image: Frames, mask: Mask, allowed: Mask, hint: Hint) -> Mask | None:
    """Return the parts of a mask that a hint speaks of; None where it contradicts the hint."""
    kept = _parts(mask & ~_spots(hint.outside, mask.shape), hint)
    if kept.any():
        kept = _parts(half_covered(image, kept) & allowed, hint)
    if kept.sum() < LEAST:
        return None
    if any(kept[_at(p, mask.shape)] for p in hint.outside):
        return None
    if hint.inside and not any(kept[_at(p, mask.shape)] for p in hint.inside):
        return None
    if hint.box is None and hint.mask is None:
        y, x = np.nonzero(kept)
        if np.ptp(y) + 1 >= mask.shape[0] or np.ptp(x) + 1 >= mask.shape[1]:
            return None  # it reaches through the whole window: background
    if hint.box is not None and not hint.inside and hint.mask is None and _filling(kept, hint.box) < 0.4:
        return None
    return kept


def _worth(mask: Mask, slope: NDArray[np.float32], hint: Hint) -> float:
    """Compute how well an outline lies on edges, how compact it is, and how well it fills a box."""
    byte = mask.astype(np.uint8)
    rim = cv2.morphologyEx(byte, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    rim[[0, -1]], rim[:, [0, -1]] = False, False
    on_edges = float(np.minimum(slope[rim], 1.0).mean()) if rim.any() else 0.0
    worth = on_edges + 0.5 * solidity(mask)
    if hint.box is not None and not hint.inside:
        worth += 1.5 * _filling(mask, hint.box)
    return worth


def _filling(mask: Mask, box: Box) -> float:
    """Overlap of a mask's own box with a given one (intersection over union), which may be a little loose."""
    y, x = np.nonzero(mask)
    across, down = max(LOOSE * box[2], LOOSE_PIXELS), max(LOOSE * box[3], LOOSE_PIXELS)
    left, right = (
        min(x.min(), max(x.min() - across, box[0])),
        max(x.max() + 1, min(x.max() + 1 + across, box[0] + box[2])),
    )
    top, bottom = min(y.min(), max(y.min() - down, box[1])), max(y.max() + 1, min(y.max() + 1 + down, box[1] + box[3]))
    wide = min(right, box[0] + box[2]) - max(left, box[0])
    tall = min(bottom, box[1] + box[3]) - max(top, box[1])
    both = max(wide, 0.0) * max(tall, 0.0)
    return float(both / max((right - left) * (bottom - top) + box[2] * box[3] - both, 1e-9))


def _slope(image: Frames) -> NDArray[np.float32]:
    """Strength of edges relative to that of a typical edge of the window (h, w)."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.8)
    strength = np.hypot(
        cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125)
    )
    strongest = strength.max(axis=2)
    return np.asarray(strongest / max(float(np.percentile(strongest, 95)), 2.0), dtype=np.float32)


def _alike(image: Frames, hint: Hint) -> Mask:
    """Return where an image has the hue of the points inside, in any light; everywhere if a hint has more."""
    if not hint.inside or hint.box is not None or hint.mask is not None:
        return np.ones(image.shape[:2], dtype=bool)
    tone = cv2.blur(image[..., 1:].astype(np.float32) - 128.0, (3, 3))
    alike = np.zeros(image.shape[:2], dtype=bool)
    for point in hint.inside:
        y, x = _at(point, image.shape)
        own = np.median(tone[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3].reshape(-1, 2), axis=0)
        strength = float(np.hypot(*own))
        scale = np.clip(tone @ own / max(strength**2, 1e-6), DIMMEST, BRIGHTEST)
        off = np.linalg.norm(tone - scale[..., None] * own, axis=2)
        alike |= off < SAME_TONE + 0.15 * strength
    return alike


def _even(image: Frames, point: Point, tolerance: int) -> Mask:
    """Return the connected region around a point whose colour differs from the point's by at most a tolerance."""
    y, x = _at(point, image.shape[:2])
    filled = np.zeros((image.shape[0] + 2, image.shape[1] + 2), np.uint8)
    smooth = cv2.medianBlur(np.ascontiguousarray(image), 3)
    flags = 4 | cv2.FLOODFILL_MASK_ONLY | cv2.FLOODFILL_FIXED_RANGE | (1 << 8)
    three = (tolerance, 0.7 * tolerance, 0.7 * tolerance)
    cv2.floodFill(smooth, filled, (x, y), (0, 0, 0), three, three, flags)
    return filled[1:-1, 1:-1] > 0


def _clean(mask: Mask) -> Mask:
    """Closed over thin gaps, filled, without specks."""
    ellipse = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    byte = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, ellipse)
    byte = fill_holes(byte > 0, 0.5).astype(np.uint8)
    opened = cv2.morphologyEx(byte, cv2.MORPH_OPEN, ellipse)
    return (opened if opened.sum() > 0.5 * byte.sum() else byte) > 0


def _parts(mask: Mask, hint: Hint) -> Mask:
    """Return the connected parts that hold a point inside, or overlap a first mask, else the largest with its like."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count <= 2 and not hint.inside:
        return mask
    wanted = {int(labels[_at(p, mask.shape)]) for p in hint.inside} - {0}
    if not wanted and count > 1:
        if hint.mask is not None and (labels[hint.mask] > 0).any():
            wanted = {int(np.bincount(labels[hint.mask & (labels > 0)]).argmax())}
        else:
            largest = int(stats[1:, cv2.CC_STAT_AREA].max())
            least = max(0.25 * largest, LEAST) if hint.box is not None else largest
            wanted = {k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= least}
    kept: Mask = np.isin(labels, sorted(wanted)) & mask
    return kept


def _window(hint: Hint, size: tuple[int, int]) -> View:
    """Return the surroundings of a hint: enough to learn the background's colours from."""
    height, width = size
    if hint.box is not None:
        left, top, right, bottom = hint.box[0], hint.box[1], hint.box[0] + hint.box[2], hint.box[1] + hint.box[3]
        margin = max(0.6 * max(right - left, bottom - top), 10.0)
    elif hint.mask is not None and hint.mask.any():
        y, x = np.nonzero(hint.mask)
        left, top, right, bottom = x.min(), y.min(), x.max() + 1, y.max() + 1
        margin = max(0.8 * max(right - left, bottom - top), 12.0)
    else:
        x, y = np.array(hint.inside).T
        left, top, right, bottom = x.min(), y.min(), x.max() + 1, y.max() + 1
        margin = max(0.3 * min(height, width), 40.0)
    return (
        slice(max(int(top - margin), 0), min(int(bottom + margin) + 1, height)),
        slice(max(int(left - margin), 0), min(int(right + margin) + 1, width)),
    )


def _shifted(hint: Hint, view: View) -> Hint:
    top, left = view[0].start, view[1].start
    box = None if hint.box is None else (hint.box[0] - left, hint.box[1] - top, hint.box[2], hint.box[3])
    inside = tuple((x - left, y - top) for x, y in hint.inside)
    outside = tuple((x - left, y - top) for x, y in hint.outside)
    return Hint(box, inside, outside, None if hint.mask is None else hint.mask[view])


def _rectangle(box: Box, shape: tuple[int, ...]) -> Mask:
    inside = np.zeros(shape[:2], dtype=bool)
    left, top = max(round(box[0]), 0), max(round(box[1]), 0)
    inside[top : max(round(box[1] + box[3]), 0), left : max(round(box[0] + box[2]), 0)] = True
    return inside


def _ellipse(box: Box, shape: tuple[int, ...]) -> Mask:
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    across, down = (x + 0.5 - box[0] - box[2] / 2) / (box[2] / 2), (y + 0.5 - box[1] - box[3] / 2) / (box[3] / 2)
    inside: Mask = across**2 + down**2 < 0.92
    return inside


def _spots(points: tuple[Point, ...], shape: tuple[int, ...]) -> Mask:
    image = np.zeros(shape[:2], np.uint8)
    for x, y in points:
        cv2.circle(image, (round(x), round(y)), 2, 1, cv2.FILLED)
    return image > 0


def _at(point: Point, shape: tuple[int, ...]) -> tuple[int, int]:
    """Row and column of a point, inside the image."""
    return min(max(round(point[1]), 0), shape[0] - 1), min(max(round(point[0]), 0), shape[1] - 1)
