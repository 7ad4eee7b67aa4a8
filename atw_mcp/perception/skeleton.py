"""The centreline of a thin shape: its mask is thinned to a line, and the longest way along that line is taken.

Thinning after Zhang & Suen (1984); the longest shortest path between two pixels of the line by two searches from the
farthest pixel, which is exact where the line has no loops.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from atw_mcp.perception.masks import Mask

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SMOOTHING = 3  # pixels of the line on either side that a point is averaged over
LEAST_PIXELS = 12
BRIDGED = 7  # [px] gaps no wider are closed
WHOLE = 0.85  # share of the line that its longest way must hold for it to be one line without loops or branches
_AROUND = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))  # clockwise from above


@dataclass(frozen=True)
class CentrelineInImage:
    """points (k, 2) x, y [px] from one end to the other, about a pixel apart; width: mean width of the shape [px].

    covered: share of the thinned shape that lies on the line (less where it crosses itself or branches). truncated:
    whether an end lies at the image's border, so that more of it may be outside. parts: pieces the mask fell into.
    """

    points: Floats
    width: float
    covered: float
    truncated: bool
    parts: int

    @property
    def length(self) -> float:
        """Length of the line [px]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @property
    def whole(self) -> bool:
        """Whether it is taken for the whole object, end to end."""
        return not self.truncated and self.covered >= WHOLE and self.parts == 1

    def evenly(self, count: int) -> Floats:
        """`count` points (count, 2), evenly spaced along the line."""
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])
        at = np.linspace(0.0, along[-1], count)
        return np.stack([np.interp(at, along, self.points[:, i]) for i in (0, 1)], axis=1)


def centreline(mask: Mask) -> CentrelineInImage | None:
    """Return the centreline of the largest part of a mask (height, width); None where there is too little of it.

    Small holes and gaps are closed first. Each end reaches to half a width from the shape's tip, where the centre of a
    round end is.
    """
    if int(mask.sum()) < LEAST_PIXELS:
        return None
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, left = int(rows[0]) - 4, int(columns[0]) - 4
    inside = np.zeros((rows[-1] - top + 5, columns[-1] - left + 5), dtype=bool)
    inside[4:-4, 4:-4] = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    filled = _without_holes(inside)
    labels, parts = label(filled, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())[1:]
    largest = labels == 1 + int(np.argmax(sizes))
    line = thinned(largest)
    distance = cv2.distanceTransform(np.asarray(largest, dtype=np.uint8), cv2.DIST_L2, 5).astype(float)
    path, covered = _longest_way(line)
    if len(path) < 3:
        return None
    radius = distance[path[:, 0], path[:, 1]]
    points = _to_tips(_smoothed(path[:, ::-1].astype(float)), largest, float(np.median(radius)))
    height, width = mask.shape
    points = points + np.array([left, top])
    margin = float(np.median(radius)) + 2.0
    outside = np.any((points < margin) | (points > np.array([width, height]) - 1.0 - margin), axis=1)
    truncated = bool(outside[0] or outside[-1])
    if truncated and not outside.all():  # a cut end runs into a corner of the cut: what is near it is left out
        inner = np.flatnonzero(~outside)
        points = points[inner[0] : inner[-1] + 1]
    return CentrelineInImage(
        points=points,
        # The distance of a middle pixel from outside is half a pixel more than half the width.
        width=max(2.0 * float(radius.mean()) - 1.0, 1.0),
        covered=covered,
        truncated=truncated,
        parts=int((sizes > 0.05 * sizes.sum()).sum()) if parts else 0,
    )


def thinned(mask: Bools) -> Bools:
    """Return the mask thinned to lines one pixel wide (Zhang & Suen 1984); its border must be empty."""
    line = mask.copy()
    while True:
        removed = 0
        for first in (True, False):
            n = [np.roll(line, (-dy, -dx), axis=(0, 1)) for dy, dx in _AROUND]
            count = np.sum(n, axis=0, dtype=int)
            turns = np.sum([~n[i] & n[(i + 1) % 8] for i in range(8)], axis=0, dtype=int)
            up, right, down, side = n[0], n[2], n[4], n[6]
            open_sides = (
                ~(up & right & down) & ~(right & down & side) if first else ~(up & right & side) & ~(up & down & side)
            )
            gone = line & (count >= 2) & (count <= 6) & (turns == 1) & open_sides
            line = line & ~gone
            removed += int(gone.sum())
        if removed == 0:
            return line


def _without_holes(mask: Bools) -> Bools:
    size = min(BRIDGED, 1 + 2 * max(1, int(0.1 * min(mask.shape) / 2)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    closed = np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, disc)) > 0
    background, _ = label(~closed)
    sizes = np.bincount(background.ravel())
    # A hole smaller than the shape is thick is a fault of the mask; a larger one is a loop.
    small = (sizes < BRIDGED**2) & (np.arange(len(sizes)) > 0) & (np.arange(len(sizes)) != background[0, 0])
    filled: Bools = closed | small[background]
    return filled


def _longest_way(line: Bools) -> tuple[NDArray[np.int64], float]:
    """Pixels (k, 2) row, column of the longest shortest path along a thinned line, and its share of the line."""
    pixels = np.argwhere(line)
    if len(pixels) < 3:
        return pixels, 1.0
    number = np.full(line.shape, -1)
    number[tuple(pixels.T)] = np.arange(len(pixels))
    begin, end, length = [], [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = number[pixels[:, 0] + dy, pixels[:, 1] + dx]
        known = other >= 0
        begin.append(np.flatnonzero(known))
        end.append(other[known])
        length.append(np.full(int(known.sum()), np.hypot(dy, dx)))
    size = (len(pixels), len(pixels))
    graph = coo_matrix((np.concatenate(length), (np.concatenate(begin), np.concatenate(end))), shape=size).tocsr()
    at, way, previous = 0, np.zeros(len(pixels)), np.zeros(len(pixels), dtype=np.int64)
    for _ in range(2):  # from anywhere to one end, from there to the other
        way, previous = dijkstra(graph, directed=False, indices=at, return_predecessors=True)
        start, at = at, int(np.argmax(np.where(np.isfinite(way), way, -1.0)))
    path = [at]
    while path[-1] != start:
        path.append(int(previous[path[-1]]))
    # Steps to the side inflate the number of pixels of a staircase: both counts are of pixels.
    near = np.zeros(line.shape, dtype=bool)
    near[tuple(pixels[path].T)] = True
    near = np.asarray(cv2.dilate(near.astype(np.uint8), np.ones((5, 5), np.uint8))) > 0
    return pixels[path], float((line & near).sum() / line.sum())


def _smoothed(points: Floats) -> Floats:
    """Means over neighbours along the line, fewer towards its ends, which stay."""
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(points, axis=0)])
    index = np.arange(len(points))
    reach = np.minimum(np.minimum(index, len(points) - 1 - index), SMOOTHING)
    means: Floats = (total[index + reach + 1] - total[index - reach]) / (2 * reach + 1)[:, None]
    return means


def _to_tips(points: Floats, mask: Bools, radius: float) -> Floats:
    """Return the line with its ends moved along it to `radius` from where the shape ends."""
    for end in (0, 1):
        line = points if end == 0 else points[::-1]
        back = min(len(line) - 1, max(3, int(2 * radius)))
        outward = line[0] - line[back]
        outward /= max(float(np.linalg.norm(outward)), 1e-9)
        tip = line[0]
        for _ in range(int(4 * radius) + 6):
            ahead = tip + 0.5 * outward
            row, column = np.round(ahead[::-1]).astype(int)
            if not (0 <= row < mask.shape[0] and 0 <= column < mask.shape[1] and mask[row, column]):
                break
            tip = ahead
        inner = tip - (radius - 0.5) * outward
        if (inner - line[0]) @ outward > 0.0:
            line = np.concatenate([inner[None], line])
        else:  # the line ran into the round end: take back what is beyond its centre
            beyond = (line - inner) @ outward > 0.0
            keep = max(int(np.argmin(beyond)), 0)
            line = np.concatenate([inner[None], line[keep:]]) if keep < len(line) - 2 else line
        points = line if end == 0 else line[::-1]
    return points
