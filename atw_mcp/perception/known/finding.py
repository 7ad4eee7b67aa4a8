"""Candidate places of a known body in a frame: places where pixels that are likely its gather in its size."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Array32, Mask
from atw_mcp.perception.known.bodies import Sizes
from atw_mcp.perception.known.settings import SETTINGS


@dataclass(frozen=True)
class Candidate:
    """A place x, y and a radius [px] with the log likelihood ratio per pixel of a body being there."""

    x: float
    y: float
    radius: float
    score: float

    def near(self, other: Candidate, reach: float) -> bool:
        """Return whether the other is within `reach` of the smaller radius."""
        return bool(np.hypot(self.x - other.x, self.y - other.y) < reach * min(self.radius, other.radius))


def radii_of(sizes: Sizes) -> list[float]:
    """Return the radii [px] at which a body is looked for."""
    radius = 0.85 * float(sizes.on_floor.min())
    last = 1.1 * min(SETTINGS.nearer * float(sizes.on_floor.max()), sizes.largest)
    found = [radius]
    while found[-1] < last:
        found.append(found[-1] * SETTINGS.step)
    return found


def fits(radius: float, sizes: Sizes) -> Mask:
    """Return where (H, W) a body may have a radius [px]."""
    highest = 1.1 * np.minimum(SETTINGS.nearer * sizes.on_floor, sizes.largest)
    inside: Mask = (radius >= SETTINGS.smaller * sizes.on_floor) & (radius <= highest)
    return inside


def hiding(radius: float, sizes: Sizes, fixtures: Array32) -> tuple[Mask, Mask]:
    """Return the pixels (H, W) where a fixture is in front of a body of a radius [px] that is on the floor, and that is
    above it. fixtures (H, W): distances [m].

    A body is in front unless it is farther by more than its own radius: at its place on the floor where it has about
    the size that it has there, else at the distance that its size says, less what the steps of size leave open.
    """
    resting = sizes.floor & (radius < SETTINGS.resting * sizes.on_floor)
    before = fixtures + sizes.radius
    on_floor = resting & (before < sizes.focal * sizes.radius / sizes.on_floor)
    by_size = min(sizes.focal * sizes.radius / radius / SETTINGS.depth_doubt, sizes.farthest)
    return on_floor, ~resting & (before < by_size)


def aloft(radius: float, sizes: Sizes, fixtures: Array32) -> Array32:
    """Return what a radius [px] costs (H, W) that is not that of a body on the floor, where nothing hides that."""
    off = np.log(radius / sizes.on_floor) / SETTINGS.size_spread
    cost = np.where(sizes.floor & np.isinf(fixtures), SETTINGS.aloft * np.minimum(0.5 * off**2, 1.0), 0.0)
    return np.asarray(cost, dtype=np.float32)


def odd(length: float, least: int = 1) -> int:
    """Return the odd number of pixels nearest below a length, at least `least`."""
    return max(round(length), least) | 1


def box_mean(image: Array32, side: int) -> Array32:
    """Return the mean over squares; what is outside the image counts as 0."""
    mean = cv2.boxFilter(image, -1, (side, side), normalize=True, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(mean, dtype=np.float32)


@dataclass(frozen=True)
class _Scale:
    """A radius [px] that is tried: where (H, W) a body may have it, what that costs, the part of its square that is in
    the image, and the pixels where something is in front of it on the floor, and above it."""

    radius: float
    fits: Mask
    aloft: Array32
    inside: Array32
    hidden: Mask
    hidden_aloft: Mask


class Places:
    """The places in frames where one body may be, found at several radii."""

    def __init__(self, sizes: Sizes, fixtures: Array32) -> None:
        self.scales: list[_Scale] = []
        one = np.ones(sizes.on_floor.shape, dtype=np.float32)
        for radius in radii_of(sizes):
            where = fits(radius, sizes)
            if not where.any():
                continue
            inside = box_mean(one, odd(SETTINGS.square * radius))
            cost = aloft(radius, sizes, fixtures)
            self.scales.append(_Scale(radius, where, cost, inside, *hiding(radius, sizes, fixtures)))

    def candidates(self, ratio: Array32) -> list[Candidate]:
        """Return the places in a frame where log likelihood ratios (H, W) gather in the body's size, best first.

        Pixels behind which the body may be count where they are like it, and say nothing where they are not. Where it
        would be on the floor they are left out, as those outside the image are; above the floor, where any size may
        be, they are not, so that no part of a larger body does as well as the whole.
        """
        positive = np.maximum(ratio, 0.0)
        best = np.full(ratio.shape, -np.inf, dtype=np.float32)
        radius = np.zeros(ratio.shape, dtype=np.float32)
        for scale in self.scales:
            inner = odd(SETTINGS.square * scale.radius)
            outer = odd(SETTINGS.square * SETTINGS.ring * scale.radius, 3)
            counted, inside = ratio, scale.inside
            if scale.hidden_aloft.any():
                counted = np.where(scale.hidden_aloft, positive, ratio)
            if scale.hidden.any():
                silent = scale.hidden & (ratio < 0.0)
                counted = np.where(silent, np.float32(0.0), counted)
                inside = box_mean((~silent).astype(np.float32), inner)
            mean = box_mean(counted, inner) / np.maximum(inside, SETTINGS.least_inside)
            around = box_mean(positive, outer) * outer**2 - box_mean(positive, inner) * inner**2
            score = mean - SETTINGS.goes_on * around / (outer**2 - inner**2) - scale.aloft
            better = scale.fits & (score > best)
            best[better], radius[better] = score[better], scale.radius
        return highest(best, radius, SETTINGS.candidates, SETTINGS.faintest)


def highest(score: Array32, radius: Array32, most: int, least: float) -> list[Candidate]:
    """Return the local maxima of a score (H, W) above `least` that lie apart, best first, at most `most`."""
    possible: NDArray[np.bool_] = np.isfinite(score)
    if not possible.any():
        return []
    reach = 2 * (max(int(radius[possible].min()), 2) // 2) + 1
    top = cv2.dilate(score, np.ones((reach, reach), np.uint8))
    rows, columns = np.nonzero((score >= top) & (score > least))
    found: list[Candidate] = []
    for i in np.argsort(-score[rows, columns], kind="stable"):
        y, x = int(rows[i]), int(columns[i])
        one = Candidate(float(x), float(y), float(radius[y, x]), float(score[y, x]))
        if all(np.hypot(one.x - o.x, one.y - o.y) > SETTINGS.apart * max(one.radius, o.radius) for o in found):
            found.append(one)
            if len(found) == most:
                break
    return found
