"""Where in each frame a known body may be, and the path through the frames that agrees best with how bodies move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Array32
from atw_mcp.perception.known.bodies import Sizes

Floats = NDArray[np.float64]

STEP = 1.25  # ratio of neighbouring radii that are tried
SMALLER, NEARER = 0.8, 2.2  # of the radius on the floor: what may be seen of a body, and how much nearer one may fly
SQUARE = 1.77  # side of the square with the area of a disc, in radii
RING = 1.6  # outer radius of the surroundings, in which the body must not go on
GOES_ON = 0.8  # weight of what looks like the body there
LEAST_INSIDE = 0.2  # of a square's pixels that are in the image
CANDIDATES = 14  # places in a frame
FAINTEST = 0.3  # log likelihood ratio per pixel of a candidate
APART = 0.7  # radii between two candidates
UNSEEN = 1.0  # log likelihood ratio per pixel from which a body is seen
CLEAREST = 6.0  # beyond which a candidate is no better
TURN = 0.15  # cost of a change of velocity by one radius per frame
JUMP = 0.05  # of a step of one radius where the velocity is not known
STRUCK = 3.0  # most that a change of velocity costs: bodies collide
APPEARS = 0.5  # of a body's appearing or vanishing
SAID = 30.0  # what a place that was pointed at counts


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
    last = 1.1 * min(NEARER * float(sizes.on_floor.max()), sizes.largest)
    found = [radius]
    while found[-1] < last:
        found.append(found[-1] * STEP)
    return found


def fits(radius: float, sizes: Sizes) -> NDArray[np.bool_]:
    """Return where (H, W) a body may have a radius [px]."""
    highest = 1.1 * np.minimum(NEARER * sizes.on_floor, sizes.largest)
    inside: NDArray[np.bool_] = (radius >= SMALLER * sizes.on_floor) & (radius <= highest)
    return inside


def odd(length: float, least: int = 1) -> int:
    """Return the odd number of pixels nearest below a length, at least `least`."""
    return max(round(length), least) | 1


def box_mean(image: Array32, side: int) -> Array32:
    """Return the mean over squares; what is outside the image counts as 0."""
    mean = cv2.boxFilter(image, -1, (side, side), normalize=True, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(mean, dtype=np.float32)


def candidates(ratio: Array32, sizes: Sizes) -> list[Candidate]:
    """Return the places in a frame where log likelihood ratios (H, W) gather in a body's size, best first."""
    positive = np.maximum(ratio, 0.0)
    inside = np.ones_like(ratio)
    best = np.full(ratio.shape, -np.inf, dtype=np.float32)
    radius = np.zeros(ratio.shape, dtype=np.float32)
    for r in radii_of(sizes):
        inner, outer = odd(SQUARE * r), odd(SQUARE * RING * r, 3)
        mean = box_mean(ratio, inner) / np.maximum(box_mean(inside, inner), LEAST_INSIDE)
        around = box_mean(positive, outer) * outer**2 - box_mean(positive, inner) * inner**2
        score = mean - GOES_ON * around / (outer**2 - inner**2)
        better = fits(r, sizes) & (score > best)
        best[better], radius[better] = score[better], r
    return highest(best, radius, CANDIDATES, FAINTEST)


def highest(score: Array32, radius: Array32, most: int, least: float) -> list[Candidate]:
    """Return the local maxima of a score (H, W) above `least` that lie apart, best first, at most `most`."""
    possible = np.isfinite(score)
    if not possible.any():
        return []
    reach = 2 * (max(int(radius[possible].min()), 2) // 2) + 1
    top = cv2.dilate(score, np.ones((reach, reach), np.uint8))
    rows, columns = np.nonzero((score >= top) & (score > least))
    found: list[Candidate] = []
    for i in np.argsort(-score[rows, columns], kind="stable"):
        y, x = int(rows[i]), int(columns[i])
        one = Candidate(float(x), float(y), float(radius[y, x]), float(score[y, x]))
        if all(np.hypot(one.x - o.x, one.y - o.y) > APART * max(one.radius, o.radius) for o in found):
            found.append(one)
            if len(found) == most:
                break
    return found


def best_path(
    frames: Sequence[Sequence[Candidate]], said: Mapping[int, tuple[float, float]]
) -> tuple[float, list[Candidate | None]]:
    """Return the score of the best path through candidates of T >= 2 frames, and its places; None where unseen.

    Candidates count by their score, and changes of velocity cost (Viterbi's algorithm over pairs of frames). said:
    places x, y that were pointed at, by row.
    """
    count, most = len(frames), max((len(f) for f in frames), default=0)
    if most == 0 or count < 2:
        return 0.0, [None] * count
    places = np.full((count, most + 1, 2), np.nan)
    score, radius = np.full((count, most + 1), -1e6), np.ones((count, most + 1))
    for t, frame in enumerate(frames):
        for i, c in enumerate(frame):
            places[t, i], radius[t, i] = (c.x, c.y), c.radius
            score[t, i] = min(c.score, CLEAREST) - UNSEEN
        score[t, most] = 0.0
        if t in said:
            off = np.hypot(*(places[t, : len(frame)] - said[t]).T)
            score[t, : len(frame)] += np.where(off < 1.1 * radius[t, : len(frame)], SAID, -SAID)
            score[t, most] -= SAID / 3.0
    seen = np.arange(most + 1) < most
    total = score[0][:, None] + score[1] - _jump(places[0], places[1], radius[1])
    back = []
    for t in range(2, count):
        now = radius[t] ** 2
        turn = places[t] - 2.0 * places[t - 1][:, None] + places[t - 2][:, None, None]
        cost = np.nan_to_num(np.minimum(TURN * (turn**2).sum(axis=-1) / now, STRUCK))
        fresh = np.broadcast_to(_jump(places[t - 1], places[t], radius[t]), cost.shape)
        over = np.broadcast_to(_jump(places[t - 2], places[t], 2.0 * radius[t])[:, None, :], cost.shape)
        first, second, third = seen[:, None, None], seen[None, :, None], seen[None, None, :]
        cost = np.where(~first & second & third, fresh, cost)
        cost = np.where(first & ~second & third, over, cost)
        cost = np.where(~first & ~second & third, APPEARS, cost) + APPEARS * (second ^ third)
        arrive = total[:, :, None] - cost
        back.append(arrive.argmax(axis=0))
        total = arrive.max(axis=0) + score[t]
    j, k = np.unravel_index(int(total.argmax()), total.shape)
    path = [int(k), int(j)]
    for choice in reversed(back):
        path.append(int(choice[path[-1], path[-2]]))
    path.reverse()
    return float(total.max()), [None if p == most else frames[t][p] for t, p in enumerate(path)]


def _jump(before: Floats, after: Floats, radius: Floats) -> Floats:
    """Cost (i, j) of steps from places before to places after; 0 from or to where nothing is seen."""
    squared = ((after[None] - before[:, None]) ** 2).sum(axis=-1)
    cost: Floats = np.nan_to_num(np.minimum(JUMP * squared / radius**2, STRUCK))
    return cost
