"""Identity over time: which part of each frame's foreground is which object.

One sweep goes through the frames in order. Regions and objects are matched by place, colour and size; a region
that several objects claim is divided among them; what no object claims is a new object, or a lost one found
again. The sweep back (see `resweep`) repeats this in reverse with what the first sweep learned, so that an
object that first appears touching another, or behind it, is separated from the start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.appearance import Bins, Histogram, colour_bins, histogram, log_likelihood, similarity
from atw_mcp.perception.background import Mask
from atw_mcp.perception.partition import Member, Share, Template, partition, renewed, template_of
from atw_mcp.perception.segmentation import Foreground
from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]

MATCH_COST = 2.6  # above this a region and an object are not the same thing
UNEXPLAINED = -1.2  # log-likelihood below which a colour is not an object's
MEMORY = 0.97  # of the colour model, per frame


@dataclass
class Track:
    """State of one object while sweeping."""

    number: int
    template: Template
    colours: Histogram
    velocity: Floats = field(default_factory=lambda: np.zeros(2))
    last_seen: int = 0
    hidden: bool = False
    gone: bool = False
    at_border: bool = False
    whole_frames: int = 0  # frames in which it was alone and clear of the border

    def expected(self, frame: int) -> Template:
        """Return the outline where it should be at a frame; a hidden object is expected to slow down."""
        steps = frame - self.last_seen
        reach = steps if abs(steps) <= 1 else np.sign(steps) * (1 - 0.93 ** abs(steps)) / 0.07
        return self.template.moved(float(self.velocity[0] * reach), float(self.velocity[1] * reach))


@dataclass
class Sweep:
    """The result of a sweep over T frames.

    labels (T, H, W): object number, from 1, or 0; alone (T, n+1): the object had a region to itself;
    placed: expected outlines of objects in shared regions by (frame, number); clarity by (frame, number).
    """

    labels: NDArray[np.uint8]
    alone: list[set[int]]
    placed: dict[tuple[int, int], Template]
    clarity: dict[tuple[int, int], float]
    tracks: dict[int, Track]
    born: dict[int, int]
    split_from: dict[int, tuple[int, int]]


class Sweeper:
    """One sweep forward in time."""

    def __init__(self, frames: Frames, foregrounds: list[Foreground], min_area: int, max_objects: int) -> None:
        self.frames = frames
        self.foregrounds = foregrounds
        self.min_area = min_area
        self.max_objects = max_objects
        count, height, width = frames.shape[:3]
        self.size = (width, height)
        self.result = Sweep(
            labels=np.zeros((count, height, width), dtype=np.uint8),
            alone=[set() for _ in range(count)],
            placed={},
            clarity={},
            tracks={},
            born={},
            split_from={},
        )
        self.dropped = 0

    def run(self, tick: Callable[[int], None]) -> Sweep:
        """Sweep all frames; `tick(frame)` is called before each."""
        for t in range(len(self.frames)):
            tick(t)
            self._step(t)
        return self.result

    # --- one frame ---------------------------------------------------------------------------------

    def _step(self, t: int) -> None:
        foreground = self.foregrounds[t]
        bins = colour_bins(self.frames[t])
        regions = [foreground.labels == k + 1 for k in range(len(foreground.areas))]
        tracks = [k for k in self.result.tracks.values() if not k.gone]
        expected = {k.number: k.expected(t) for k in tracks}
        claims = self._claims(t, tracks, expected, regions, bins)
        seen: set[int] = set()
        for region_index, region in enumerate(regions):
            numbers = claims[region_index]
            if not numbers:
                number = self._newcomer(t, region, bins)
                if number is not None:
                    self._give(t, number, region, bins, alone=True)
                    seen.add(number)
            elif len(numbers) == 1 and not self._foreign_part(numbers[0], region, bins, expected):
                self._give(t, numbers[0], region, bins, alone=True)
                seen.add(numbers[0])
            else:
                seen |= self._divide(t, numbers, region, bins, expected)
        for track in tracks:
            if track.number not in seen:
                self._lose(t, track, expected[track.number])

    def _claims(
        self,
        t: int,
        tracks: list[Track],
        expected: dict[int, Template],
        regions: list[Mask],
        bins: Bins,
    ) -> list[list[int]]:
        """For each region the objects in it."""
        claims: list[list[int]] = [[] for _ in regions]
        if not tracks or not regions:
            return claims
        width, height = self.size
        overlap = np.zeros((len(tracks), len(regions)))
        cost = np.full((len(tracks), len(regions)), 1e3)
        centres = [template_of(r).centre for r in regions]
        areas = [int(r.sum()) for r in regions]
        for i, track in enumerate(tracks):
            outline = expected[track.number].drawn(0, 0, width, height)
            drawn = max(int(outline.sum()), 1)
            centre = expected[track.number].centre
            reach = 0.6 * np.sqrt(track.template.area) + 4 + 0.5 * float(np.hypot(*track.velocity))
            reach *= 1 + 0.06 * min(t - track.last_seen - 1, 20)
            for j, region in enumerate(regions):
                overlap[i, j] = (outline & region).sum() / drawn
                distance = float(np.hypot(*(centres[j] - centre))) / reach
                if distance > 4.0 and overlap[i, j] == 0:
                    continue
                unlike = 1 - similarity(histogram(bins[region]), track.colours)
                growth = abs(float(np.log(areas[j] / max(track.template.area, 1))))
                if track.at_border and touches_border(region):
                    growth, unlike = 0.2 * growth, 0.5 * unlike  # an object coming in grows and shows new faces
                cost[i, j] = 0.7 * distance + 2.2 * unlike + 0.7 * growth + (0.6 if track.hidden else 0.0)
        owned: set[int] = set()
        for i, j in zip(*linear_sum_assignment(cost), strict=True):
            if cost[i, j] < MATCH_COST:
                claims[j].append(tracks[i].number)
                owned.add(tracks[i].number)
        for i, track in enumerate(tracks):
            inside = np.nonzero(overlap[i] > (0.12 if track.number not in owned else 0.35))[0]
            if track.number in owned:
                # Pieces of an object that something in front of it, or a gap in the mask, cuts off.
                inside = np.array([j for j in inside if not claims[j]], dtype=int)
            for index in inside:
                if track.number not in claims[int(index)]:
                    claims[int(index)].append(track.number)
        return claims

    def _foreign_part(self, number: int, region: Mask, bins: Bins, expected: dict[int, Template]) -> bool:
        """Check whether a region that one object claims holds a part that is not the object's."""
        track = self.result.tracks[number]
        if track.whole_frames < 4 or (track.at_border and touches_border(region)):
            return False  # not seen well enough to say what is not part of it
        return self._foreign(region, bins, [track], [expected[number]]) is not None

    def _foreign(self, region: Mask, bins: Bins, tracks: list[Track], outlines: list[Template]) -> Mask | None:
        """Return the largest compact part of a region outside all outlines whose colour none of the objects has."""
        left, top, right, bottom = window_of(region, 2)
        view = (slice(top, bottom), slice(left, right))
        covered = np.zeros((bottom - top, right - left), dtype=np.uint8)
        for outline in outlines:
            covered |= outline.drawn(left, top, right - left, bottom - top).astype(np.uint8)
        strange = region[view] & (cv2.dilate(covered, np.ones((7, 7), np.uint8)) == 0)
        if strange.sum() < max(self.min_area, 40):
            return None
        for track in tracks:
            strange &= log_likelihood(track.colours)[bins[view]] < UNEXPLAINED
        opened = cv2.morphologyEx(strange.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
        if count < 2:
            return None
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        if stats[largest, cv2.CC_STAT_AREA] < max(self.min_area, 40):
            return None
        return whole(labels == largest, left, top, self.size)

    def _divide(self, t: int, numbers: list[int], region: Mask, bins: Bins, expected: dict[int, Template]) -> set[int]:
        """Divide a shared region; returns the objects seen in it."""
        tracks = [self.result.tracks[n] for n in numbers]
        outlines = [expected[n] for n in numbers]
        known = all(k.whole_frames >= 4 for k in tracks) and not touches_border(region)
        # What a hidden object's own colour explains is foreign all the same where the object is not expected.
        in_view = [k for k in tracks if not k.hidden] or tracks
        foreign = self._foreign(region, bins, in_view, outlines) if known else None
        if foreign is not None:
            lost = self._lost_like(t, foreign, bins)
            if lost is not None:
                # It comes out from behind what is in front of it: expected where its first pixels are.
                track = self.result.tracks[lost]
                x, y = template_of(foreign).centre - track.template.centre
                if track in tracks:
                    outlines[tracks.index(track)] = track.template.moved(float(x), float(y))
                else:
                    track.gone = False
                    tracks.append(track)
                    outlines.append(track.template.moved(float(x), float(y)))
            elif len(self.result.tracks) < self.max_objects:
                number = self._create(t, foreign, bins)
                self.result.split_from[number] = (t, numbers[0])
                tracks.append(self.result.tracks[number])
                outlines.append(self.result.tracks[number].template)
        shares = self._partition(t, region, bins, tracks, outlines)
        seen: set[int] = set()
        for track, share in zip(tracks, shares, strict=True):
            if self._take_share(t, track, share):
                seen.add(track.number)
        return seen

    def _partition(
        self, t: int, region: Mask, bins: Bins, tracks: list[Track], outlines: list[Template]
    ) -> list[Share]:
        left, top, right, bottom = window_of(region, 6)
        members = []
        for track, outline in zip(tracks, outlines, strict=True):
            missing = max(t - track.last_seen - 1, 0)
            search = int(min(3 + 0.5 * np.hypot(*track.velocity) + 1.5 * missing, 30))
            members.append(Member(log_likelihood(track.colours), ((outline, 1.0),), search))
        view = (slice(top, bottom), slice(left, right))
        shares = partition(region[view], bins[view], left, top, members, self.size)
        return [Share(whole(s.mask, left, top, self.size), s.placed, s.clarity) for s in shares]

    def _take_share(self, t: int, track: Track, share: Share) -> bool:
        area = int(share.mask.sum())
        outline = share.placed[0]
        if area < max(8, 0.03 * outline.area):
            return False
        self.result.labels[t][share.mask] = track.number
        self.result.placed[t, track.number] = outline
        self.result.clarity[t, track.number] = share.clarity
        if area > 0.25 * outline.area:
            step = t - track.last_seen
            shift = outline.centre - track.template.centre
            track.velocity = 0.6 * track.velocity + 0.4 * shift / max(step, 1)
        track.template = renewed(outline, share.mask, share.clarity)
        track.last_seen, track.hidden = t, False
        track.at_border = touches_border(share.mask)
        return True

    # --- objects ------------------------------------------------------------------------------------

    def _give(self, t: int, number: int, region: Mask, bins: Bins, *, alone: bool) -> None:
        """Assign the region, or the part of it, to the object."""
        track = self.result.tracks[number]
        fresh = number not in self.result.alone[t]
        mask = region if fresh else region | (self.result.labels[t] == number)
        template = template_of(mask)
        border = touches_border(mask)
        step = t - track.last_seen
        if step > 0:
            shift = _displacement(track.template, template, border or track.at_border)
            track.velocity = 0.5 * track.velocity + 0.5 * shift / step if step < 4 else shift / step
        track.template, track.last_seen = template, t
        track.hidden, track.at_border = False, border
        track.whole_frames += 0 if border else 1
        track.colours = MEMORY * track.colours + histogram(bins[region])
        self.result.labels[t][region] = number
        if alone:
            self.result.alone[t].add(number)

    def _create(self, t: int, mask: Mask, bins: Bins) -> int:
        number = len(self.result.tracks) + 1
        self.result.tracks[number] = Track(
            number=number,
            template=template_of(mask),
            colours=histogram(bins[mask]),
            last_seen=t,
            at_border=touches_border(mask),
        )
        self.result.born[number] = t
        return number

    def _newcomer(self, t: int, region: Mask, bins: Bins) -> int | None:
        """Return the number of the object that an unclaimed region is: a lost one found again, or a new one."""
        best = self._lost_like(t, region, bins)
        if best is not None:
            self.result.tracks[best].gone = False
            return best
        border = touches_border(region)
        if len(self.result.tracks) >= self.max_objects:
            self.dropped += 1
            return None
        number = self._create(t, region, bins)
        for other in self.result.tracks.values():
            # Born inside the image out of another object's region: until now the two were taken for one.
            if other.number == number or border or t == 0:
                continue
            before = self.result.labels[t - 1] == other.number
            if (before & region).sum() > 0.3 * region.sum():
                self.result.split_from[number] = (t, other.number)
        return number

    def _lost_like(self, t: int, region: Mask, bins: Bins) -> int | None:
        """Return the object not seen now that a region is most likely to be, by colour, size and way gone."""
        colours = histogram(bins[region])
        template = template_of(region)
        border = touches_border(region)
        best, best_cost = None, 1.0
        for track in self.result.tracks.values():
            if track.last_seen >= t - 1 or (self.result.labels[t] == track.number).any():
                continue
            alike = similarity(colours, track.colours)
            distance = float(np.hypot(*(template.centre - track.template.centre)))
            speed = float(np.hypot(*track.velocity))
            gap = t - track.last_seen
            reach = 25 + 1.5 * np.sqrt(track.template.area) + min(speed * gap, 0.35 * max(self.size))
            size = float(np.log(template.area / max(track.template.area, 1)))
            if size < 0 and (border or track.hidden):
                size *= 0.2  # coming out bit by bit
            if alike < 0.5 or distance > reach or abs(size) > 1.2:
                continue
            cost = (1 - alike) + 0.5 * distance / reach + 0.2 * abs(size)
            if cost < best_cost:
                best, best_cost = track.number, cost
        return best

    def _lose(self, t: int, track: Track, expected: Template) -> None:
        """Mark an object without pixels: hidden behind another, gone over the border, or lost."""
        width, height = self.size
        centre = expected.centre
        outline = expected.drawn(0, 0, width, height)
        inside = outline.sum() / max(expected.area, 1)
        hidden = bool((self.result.labels[t][outline] > 0).mean() > 0.4) if outline.any() else False
        outside = not (0 <= centre[0] < width and 0 <= centre[1] < height) or inside < 0.5
        if track.at_border and not hidden:
            outside = True
        track.hidden = hidden
        if outside or (not hidden and t - track.last_seen > 5):
            track.gone = True


def _displacement(before: Template, after: Template, truncated: bool) -> Floats:
    """Motion of an object between two outlines; of a truncated one by the edges that are inside the image."""
    if not truncated:
        return after.centre - before.centre
    h0, w0 = before.mask.shape
    h1, w1 = after.mask.shape
    shift = []
    for low0, size0, low1, size1 in ((before.left, w0, after.left, w1), (before.top, h0, after.top, h1)):
        low, high = low1 - low0, (low1 + size1) - (low0 + size0)
        shift.append(low if abs(low) > abs(high) else high)
    return np.array(shift, dtype=float)


def touches_border(mask: Mask) -> bool:
    """Check whether a mask of the whole image reaches the image's border."""
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())


def window_of(mask: Mask, margin: int) -> tuple[int, int, int, int]:
    """Left, top, right, bottom (exclusive) of the mask's bounding box, grown by a margin inside the image."""
    y, x = np.nonzero(mask.any(axis=1))[0], np.nonzero(mask.any(axis=0))[0]
    height, width = mask.shape
    return (
        max(int(x[0]) - margin, 0),
        max(int(y[0]) - margin, 0),
        min(int(x[-1]) + margin + 1, width),
        min(int(y[-1]) + margin + 1, height),
    )


def whole(part: Mask, left: int, top: int, size: tuple[int, int]) -> Mask:
    """Return a window's mask in the whole image."""
    mask = np.zeros((size[1], size[0]), dtype=bool)
    mask[top : top + part.shape[0], left : left + part.shape[1]] = part
    return mask
