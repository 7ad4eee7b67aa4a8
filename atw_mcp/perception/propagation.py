"""Following one object from the frames in which it is given through all others, forwards and backwards in time.

In every frame the object's last outline is placed where the evidence of colours (against background, shadows and other
bodies) and the likeness to its last appearance are greatest; the search reaches as far as its speed, and its
uncertainty, ask. The outline is then drawn again from the evidence of the pixels, the more freely the better they
separate the object from its surroundings; of an object that hardly stands out it keeps its shape. The confidence falls
with the likeness and with the area that is seen; where it stays low the object is lost, and what was known before is
kept.
Between two given frames it is followed from both, and each frame takes the side that is surer and nearer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Array32, Mask
from atw_mcp.perception.partition import Template, template_of
from atw_mcp.perception.pixel_evidence import STRONGEST, Look, PixelEvidence, View, bins_of
from atw_mcp.perception.rims import half_covered
from atw_mcp.perception.segmentation import fill_holes

Floats = NDArray[np.float64]

LEAST = 8  # pixels of a mask
SURE = 0.55  # confidence from which an outline renews shape and appearance
UNLIKE = 0.25  # confidence below which the object is not taken to be there
AGAIN = 0.5  # confidence from which an object that was missing is taken up again
MISSING = 15  # frames for which an object that is nowhere seen is searched
SLOWING = 0.93  # of the velocity from row to row while nothing is seen
SURER = 0.15  # by which a find farther away has to be surer
COVERED = 60  # the same where something else may cover it
LEFT = 0.1  # share of the outline inside the image below which it has left
DIFFERENCE = 25.0  # levels by which an object's own appearance may differ from frame to frame
REACH = 60.0  # pixels: farthest a first step is searched for
FARTHEST = 90  # pixels: the farthest search
FINE_SIDE = 40  # pixels: longer outlines are placed on reduced images first
AGREED, AGREED_FRAMES = 0.75, 3  # overlap with what was known before, and for how long, from which that is kept
MOST_AREA = 1.15  # times the area expected that an outline may have at most
AREA_PACE = 0.015  # share by which the area expected may change from frame to frame
OWN_COLOUR = -6.0  # logarithm of the least probability (per bin) of a colour that is the object's own
OVERLAP_BONUS = 3.0  # frames of confidence that a smooth change from one side to the other is worth


@dataclass(frozen=True)
class Given:
    """Constants while one object is followed, in working pixels.

    anchors: its masks by row; known (T,): masks found before, None where there is none; covered(row): what belongs to
    other bodies, so that it says nothing of this one; barred(row): where it cannot be; span: first and last row in
    which it may be.
    """

    anchors: Mapping[int, Mask]
    known: Mapping[int, Mask]
    covered: Callable[[int], Mask | None]
    barred: Callable[[int], Mask | None]
    span: tuple[int, int]


@dataclass
class Followed:
    """masks and confidence (0..1) by row; ended: why it was followed no further, by the first row without it."""

    masks: dict[int, Mask] = field(default_factory=dict)
    confidence: dict[int, float] = field(default_factory=dict)
    ended: dict[int, str] = field(default_factory=dict)


@dataclass
class _State:
    """The object as it was last seen, going one way in time."""

    template: Template
    row: int
    area: float
    velocity: Floats
    steps: int = 0  # of motion seen


class Follower:
    """Follows one object whose look is known from its anchors."""

    def __init__(self, evidence: PixelEvidence, given: Given, stop: Callable[[], None]) -> None:
        self.evidence, self.given, self.stop = evidence, given, stop
        self.models = evidence.models
        rows = sorted(given.anchors)
        masks = [given.anchors[r] for r in rows]
        self.look = Look.of(self.models.ycc, rows, masks)
        self.inside, self.beside = self._separation(rows, masks)
        self.trust = float(np.clip((self.inside - self.beside) / 3.0, 0.15, 1.0))

    def run(self) -> Followed:
        """Follow the object from its anchors; rows beyond the point where it is lost are not in the result."""
        result = Followed()
        rows = sorted(self.given.anchors)
        for row in rows:
            result.masks[row], result.confidence[row] = self.given.anchors[row], 1.0
        first, last = self.given.span
        self._take(result, self._way(rows[0], first - 1))
        self._take(result, self._way(rows[-1], last + 1))
        for a, b in pairwise(rows):
            if b > a + 1:
                self._take(result, self._between(a, b))
        return result

    def _take(self, result: Followed, part: Followed) -> None:
        result.masks |= part.masks
        result.confidence |= part.confidence
        result.ended |= part.ended

    def _between(self, a: int, b: int) -> Followed:
        """Return the rows between two anchors: forwards from one up to some row, backwards from the other beyond it."""
        ahead, back = self._way(a, b), self._way(b, a)
        rows = range(a + 1, b)
        empty = np.zeros(self.models.size, dtype=bool)
        one = np.array([ahead.confidence.get(r, 0.0) * (1.0 - 0.3 * (r - a) / (b - a)) for r in rows])
        other = np.array([back.confidence.get(r, 0.0) * (1.0 - 0.3 * (b - r) / (b - a)) for r in rows])
        worth = np.concatenate([[0.0], np.cumsum(one)]) + np.concatenate([np.cumsum(other[::-1])[::-1], [0.0]])
        for k in range(len(rows) + 1):  # the first k rows are ahead's
            left = self.given.anchors[a] if k == 0 else ahead.masks.get(rows[k - 1], empty)
            right = self.given.anchors[b] if k == len(rows) else back.masks.get(rows[k], empty)
            worth[k] += OVERLAP_BONUS * overlap(left, right)
        k = int(np.argmax(worth))
        chosen = Followed()
        for row in rows:
            side = ahead if row < a + 1 + k else back
            rest = back if side is ahead else ahead
            for way in (side, rest):
                if row in way.masks:
                    chosen.masks[row], chosen.confidence[row] = way.masks[row], way.confidence[row]
                    break
        return chosen

    def _way(self, start: int, end: int) -> Followed:
        """Rows from an anchor up to, and without, `end`."""
        step = 1 if end > start else -1
        result = Followed()
        mask = self.given.anchors[start]
        template = template_of(mask)
        state = _State(template, start, float(template.area), np.zeros(2))
        agreed = 0
        for row in range(start + step, end, step):
            self.stop()
            missing = abs(row - state.row) - 1
            outside = self._outside(state, row)
            if outside:
                result.ended[row] = "left the image"
                break
            hidden = self._hidden(state, row)
            if missing >= (COVERED if hidden else MISSING):
                result.ended[state.row + step] = "nothing there looks like the object as it was last seen"
                break
            found, sure = self._find(state, row)
            if found is None:
                continue
            result.masks[row], result.confidence[row] = found, sure
            self._renew(state, row, found, sure)
            known = self.given.known.get(row)
            agreed = agreed + 1 if known is not None and overlap(found, known) > AGREED else 0
            if agreed >= AGREED_FRAMES:
                for k in range(AGREED_FRAMES):
                    result.masks.pop(row - k * step, None)
                    result.confidence.pop(row - k * step, None)
                break
        return result

    # --- one frame ---

    def _find(self, state: _State, row: int) -> tuple[Mask | None, float]:
        """Return the object's mask in a row, and how sure it is; None where it is not seen."""
        steps = abs(row - state.row)
        reach = self._reach(state, steps)
        found, sure = self._search(state, row, reach)
        if sure < SURE and reach < REACH:  # it may have been struck: a start from rest is not predicted
            other, surer = self._search(state, row, int(min(4 * reach, REACH)))
            if surer > sure + SURER:
                found, sure = other, surer
        return (None, sure) if sure < (UNLIKE if steps == 1 else AGAIN) else (found, sure)

    def _search(self, state: _State, row: int, reach: int) -> tuple[Mask | None, float]:
        """Return the mask drawn where the object fits best within reach of the place expected, and how sure it is."""
        expected = _expected(state, abs(row - state.row))
        view = self._view(expected, reach)
        if view is None:
            return None, 0.0
        placing, ratio = self._ratio(row, view)
        placed, likeness = self._place(state, row, view, placing, expected, reach)
        drawn = placed.drawn(view[1].start, view[0].start, ratio.shape[1], ratio.shape[0])
        mask = self._drawn_again(row, view, ratio, drawn, state.area, touching=_touches(view, drawn, self.models.size))
        if mask.sum() < LEAST:
            return None, 0.0
        sure = self._sureness(state, ratio, mask, drawn, likeness, view)
        whole = np.zeros(self.models.size, dtype=bool)
        whole[view] = mask
        return whole, sure

    def _reach(self, state: _State, steps: int) -> int:
        """Compute how far [px] from the place expected the object may be: bounces turn its velocity round."""
        size = float(max(state.template.mask.shape))
        if state.steps == 0:
            reach = min(6.0 + (0.5 + 1.5 * self.trust) * size, REACH)
        else:
            reach = 3.0 + 0.2 * size + (0.6 + 1.6 * self.trust) * float(np.hypot(*state.velocity))
        return int(min(reach * (1.0 + 0.5 * (steps - 1)), FARTHEST))

    def _ratio(self, row: int, view: View) -> tuple[Array32, Array32]:
        """Evidence for the object in a window, for placing it and for drawing it: what other bodies cover says nothing
        of where it is, and is its own only where it has the object's colours."""
        ratio = self.evidence.ratio(self.look, row, view)
        placing = ratio.copy()
        covered, barred = self.given.covered(row), self.given.barred(row)
        if covered is not None:
            foreign = covered[view] & (self.look.log_share[bins_of(self.models.ycc[row][view])] < OWN_COLOUR)
            placing[covered[view]] = 0.0
            ratio[covered[view]] = 0.0
            ratio[foreign] = -STRONGEST
        if barred is not None:
            ratio[barred[view]] = placing[barred[view]] = -STRONGEST
        return placing, ratio

    def _place(
        self, state: _State, row: int, view: View, ratio: Array32, expected: Template, reach: int
    ) -> tuple[Template, float]:
        """Return the outline of greatest evidence and likeness near the place expected, and the likeness there."""
        shape = state.template.mask
        before = self._patch(state)
        now = self.models.ycc[row][view][..., 0].astype(np.float32)
        left, top = round(expected.left) - view[1].start, round(expected.top) - view[0].start
        coarse = max(1, round(max(shape.shape) / FINE_SIDE))
        dx, dy = 0, 0
        for scale, radius in ((coarse, reach), (1, coarse + 1)) if coarse > 1 else ((1, reach),):
            dx, dy, difference = _best_shift(
                ratio, now, shape, before, (left + dx, top + dy), radius, scale, self.trust, reach, (dx, dy)
            )
        placed = expected.moved(round(expected.left) - expected.left + dx, round(expected.top) - expected.top + dy)
        return placed, float(np.exp(-difference / (2 * DIFFERENCE**2)))

    def _patch(self, state: _State) -> Array32:
        """Luminance under the outline where it was last seen."""
        h, w = state.template.mask.shape
        patch = np.zeros((h, w), dtype=np.float32)
        top, left = round(state.template.top), round(state.template.left)
        height, width = self.models.size
        y0, y1, x0, x1 = max(top, 0), min(top + h, height), max(left, 0), min(left + w, width)
        if y1 > y0 and x1 > x0:
            patch[y0 - top : y1 - top, x0 - left : x1 - left] = self.models.ycc[state.row][y0:y1, x0:x1, 0]
        return patch

    def _drawn_again(self, row: int, view: View, ratio: Array32, drawn: Mask, area: float, *, touching: bool) -> Mask:
        """Return the mask (h, w) of a window that pixels and the placed outline together ask for."""
        size = float(np.sqrt(max(int(drawn.sum()), 1)))
        soft = max(1.2, 0.07 * size) * (2.0 if touching else 1.0)
        depth = signed_distance(drawn)
        prior = np.clip(depth / soft, -3.5, 1.5) + np.clip((depth + 2.5 * soft) / 2.0, -4.0, 0.0)
        score = self.trust * cv2.GaussianBlur(ratio, (0, 0), 0.8) + prior
        if not touching:
            score -= _excess(score, MOST_AREA * area)
        mask: Mask = score > 0
        barred = self.given.barred(row)
        if barred is not None:
            mask &= ~barred[view]
        mask = _main_parts(fill_holes(mask, 0.3), drawn)
        if self.trust > 0.5 and mask.any():
            near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            covered = self.given.covered(row)
            outside = None if covered is None else ~covered[view]
            mask = _main_parts(half_covered(self.models.ycc[row][view], mask, outside) & near, drawn)
            if barred is not None:
                mask &= ~barred[view]
        return mask

    def _sureness(self, state: _State, ratio: Array32, mask: Mask, drawn: Mask, likeness: float, view: View) -> float:
        """Compute how sure a mask is: 1 where colours, appearance and area are as they were."""
        gap = self.inside - self.beside
        inside = float(ratio[mask].mean())
        colours = float(np.clip((inside - self.beside) / gap, 0.0, 1.0)) if gap > 0.7 else 0.6
        expected = (
            min(state.area, max(float(drawn.sum()), 1.0)) if _touches(view, drawn, self.models.size) else state.area
        )
        area = float(mask.sum())
        share = min(area / expected, expected / area)
        return float(np.sqrt(share) * (0.55 * colours + 0.45 * likeness))

    def _renew(self, state: _State, row: int, mask: Mask, sure: float) -> None:
        seen = template_of(mask)
        steps = abs(row - state.row)
        border = _at_border(mask)
        whole = 0.75 < seen.area / max(state.area, 1) < MOST_AREA or border
        shift = seen.centre - state.template.centre
        pace = shift / steps
        state.velocity = pace if state.steps == 0 or steps > 1 else 0.4 * state.velocity + 0.6 * pace
        state.steps += 1
        state.row = row
        if whole and sure > SURE:
            state.template = seen
            change = float(np.clip(seen.area / state.area, 1.0 - AREA_PACE, 1.0 + AREA_PACE))
            state.area = max(state.area, seen.area) if border else state.area * change
        else:
            state.template = state.template.moved(float(shift[0]), float(shift[1]))

    # --- what is seen at all ---

    def _separation(self, rows: list[int], masks: list[Mask]) -> tuple[float, float]:
        """Mean evidence within the anchors and beside them."""
        within, around = [], []
        for row, mask in zip(rows, masks, strict=True):
            view = self._view(template_of(mask), 8)
            if view is None:
                continue
            ratio = self.evidence.ratio(self.look, row, view)
            own = mask[view]
            ring = (cv2.dilate(own.astype(np.uint8), np.ones((11, 11), np.uint8)) > 0) & (
                cv2.dilate(own.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
            )
            within.append(float(ratio[own].mean()))
            around.append(float(ratio[ring].mean()) if ring.any() else -1.0)
        return (float(np.mean(within)), float(np.mean(around))) if within else (1.0, 0.0)

    def _view(self, template: Template, reach: int) -> View | None:
        """Return the window in which an outline may be placed; None outside the image."""
        height, width = self.models.size
        h, w = template.mask.shape
        margin = reach + 6
        top, bottom = max(round(template.top) - margin, 0), min(round(template.top) + h + margin, height)
        left, right = max(round(template.left) - margin, 0), min(round(template.left) + w + margin, width)
        return (slice(top, bottom), slice(left, right)) if bottom - top > 2 and right - left > 2 else None

    def _outside(self, state: _State, row: int) -> bool:
        height, width = self.models.size
        there = _expected(state, abs(row - state.row)).drawn(0, 0, width, height)
        return bool(there.sum() < max(LEFT * state.template.area, 2))

    def _hidden(self, state: _State, row: int) -> bool:
        """Check whether something else may cover the place where the object is expected."""
        covered = self.given.covered(row)
        if covered is None:
            return False
        height, width = self.models.size
        there = _expected(state, abs(row - state.row)).drawn(0, 0, width, height)
        return bool((covered & there).sum() > 0.3 * max(int(there.sum()), 1))


def _expected(state: _State, steps: int) -> Template:
    """Return the outline some rows on: what is not seen is expected to slow down, so that it is not lost far away."""
    way = state.velocity * (1.0 - SLOWING**steps) / (1.0 - SLOWING)
    return state.template.moved(float(way[0]), float(way[1]))


def _best_shift(
    ratio: Array32,
    now: Array32,
    shape: Mask,
    before: Array32,
    at: tuple[int, int],
    radius: int,
    scale: int,
    trust: float,
    reach: int,
    already: tuple[int, int],
) -> tuple[int, int, float]:
    """Shift (pixels) of an outline from a place (left, top) in a window, and its mean squared difference [levels^2].

    Evidence within the outline counts for a shift, evidence in a ring around it against; so does the difference to the
    appearance `before`, and a little the way from the place expected.
    """
    margin = 3 * scale
    h, w = shape.shape
    pad = radius + margin
    width, height = w + 2 * pad, h + 2 * pad
    field_, image, there = (
        _cut(a, at[0] - pad, at[1] - pad, width, height, fill)
        for a, fill in ((ratio, 0.0), (now, 0.0), (np.ones_like(ratio), 0.0))
    )
    kernel = np.pad(shape.astype(np.float32), margin)
    patch = np.pad(before, margin)
    if scale > 1:
        field_, image, there, kernel, patch = (_smaller(a, scale) for a in (field_, image, there, kernel, patch))
    body = (kernel > 0.5).astype(np.float32)
    if not body.any():
        body = kernel
    ring = cv2.dilate(body, np.ones((5, 5), np.uint8)) - body
    area, around = max(float(body.sum()), 1e-6), max(float(ring.sum()), 1e-6)
    weight = body / area - 0.5 * ring / around
    evidence = cv2.matchTemplate(field_, weight, cv2.TM_CCORR)
    seen = np.maximum(cv2.matchTemplate(there, body, cv2.TM_CCORR), 1e-3)
    square = cv2.matchTemplate(image * image * there, body, cv2.TM_CCORR)
    cross = cv2.matchTemplate(image * there, body * patch, cv2.TM_CCORR)
    own = cv2.matchTemplate(there, body * patch * patch, cv2.TM_CCORR)
    difference = np.maximum((square - 2 * cross + own) / seen, 0.0)
    rows, columns = evidence.shape
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    y, x = (y - (rows - 1) / 2) * scale, (x - (columns - 1) / 2) * scale
    away = np.hypot(x + already[0], y + already[1]) / max(reach, 1)
    likeness = np.minimum(difference / DIFFERENCE**2, 4.0)
    score = (0.3 + 0.7 * trust) * evidence - (1.3 - 0.6 * trust) * likeness - 0.5 * away**2
    score = np.where(np.hypot(x, y) <= radius + 0.5 * scale, score, -np.inf)
    best = np.unravel_index(int(np.argmax(score)), score.shape)
    return already[0] + round(float(x[best])), already[1] + round(float(y[best])), float(difference[best])


def _excess(score: Array32, most: float) -> float:
    """Compute how far a score (h, w) must fall so that at most so many pixels stay above zero."""
    positive = score[score > 0]
    over = len(positive) - int(most)
    return float(np.partition(positive, over - 1)[over - 1]) if over > 0 else 0.0


def _cut(image: Array32, left: int, top: int, width: int, height: int, fill: float) -> Array32:
    """Return a window of an image, filled where it reaches beyond it."""
    cut = np.full((height, width), fill, dtype=np.float32)
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + width, image.shape[1]), min(top + height, image.shape[0])
    if x1 > x0 and y1 > y0:
        cut[y0 - top : y1 - top, x0 - left : x1 - left] = image[y0:y1, x0:x1]
    return cut


def _smaller(image: Array32, scale: int) -> Array32:
    size = (max(image.shape[1] // scale, 3), max(image.shape[0] // scale, 3))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _main_parts(mask: Mask, drawn: Mask) -> Mask:
    """Return the connected parts that lie in the placed outline, without specks."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count <= 2:
        return mask
    inside = np.bincount(labels[drawn], minlength=count)
    inside[0] = 0
    largest = int(inside.max())
    keep = [k for k in range(1, count) if inside[k] > 0.15 * largest and inside[k] > 0.3 * stats[k, cv2.CC_STAT_AREA]]
    kept: Mask = np.isin(labels, keep or [int(inside.argmax())])
    return kept


def signed_distance(mask: Mask) -> Array32:
    """Distance to the outline [px], positive inside."""
    byte = mask.astype(np.uint8)
    if not byte.any():
        return np.full(mask.shape, -50.0, dtype=np.float32)
    inside = cv2.distanceTransform(byte, cv2.DIST_L2, 3)
    return np.asarray(inside - cv2.distanceTransform(1 - byte, cv2.DIST_L2, 3), dtype=np.float32)


def overlap(a: Mask, b: Mask) -> float:
    """Intersection over union of two masks."""
    return float((a & b).sum() / max(int((a | b).sum()), 1))


def _touches(view: View, mask: Mask, size: tuple[int, int]) -> bool:
    """Check whether a mask of a window touches the border of the image."""
    rows, columns = view
    return bool(
        (rows.start == 0 and mask[0].any())
        or (columns.start == 0 and mask[:, 0].any())
        or (rows.stop == size[0] and mask[-1].any())
        or (columns.stop == size[1] and mask[:, -1].any())
    )


def _at_border(mask: Mask) -> bool:
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
