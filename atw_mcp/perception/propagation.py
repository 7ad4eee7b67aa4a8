"""Following one object, given in one frame, through the others, among objects already known."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.appearance import colour_bins, histogram, log_likelihood
from atw_mcp.perception.background import Mask, model_background
from atw_mcp.perception.partition import Member, Template, partition, template_of
from atw_mcp.perception.segmentation import segment, without_shadow
from atw_mcp.perception.tracking import touches_border, whole, window_of
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled

AGREED = 0.75  # overlap of what is expected and what was tracked, from which a track is taken up again
AGREED_FRAMES = 3
UNLIKE = 22.0  # levels: mean difference above which a patch is not the object any more


class Propagation:
    """Masks of all objects (name: T masks) while one of them is followed."""

    def __init__(
        self, frames: Frames, masks: dict[str, list[Mask]], name: str, cancelled: Cancelled | None = None
    ) -> None:
        self.frames = frames
        self.masks = {k: list(v) for k, v in masks.items()}
        self.name = name
        self.cancelled = cancelled
        self.background = model_background(frames)
        self.min_area = max(24, round(2e-4 * frames.shape[1] * frames.shape[2]))
        self.size = (frames.shape[2], frames.shape[1])
        self.was_known = any(m.any() for m in masks[name])
        self.changed = {name}

    def regions_at(self, row: int, points: tuple[tuple[float, float], ...]) -> Mask:
        """What stands out from the background at some points of a frame; empty where nothing does."""
        labels = segment(self.frames[row], self.background, min_area=self.min_area).labels
        width, height = self.size
        touched = {
            int(labels[round(y), round(x)]) for x, y in points if 0 <= round(x) < width and 0 <= round(y) < height
        }
        regions: Mask = np.isin(labels, sorted(touched - {0}))
        return regions

    def spread(self, row: int, mask: Mask) -> set[str]:
        """Take `mask` as the object in one row and follow it both ways; returns the objects whose masks changed."""
        self.colours = histogram(colour_bins(self.frames[row])[mask])
        first = segment(self.frames[row], self.background, min_area=self.min_area)
        self.has_hue = bool(first.dim[mask].mean() < 0.5)
        self._set(row, mask)
        for step in (1, -1):
            self._follow(row, mask, step)
        return self.changed

    def _follow(self, row: int, mask: Mask, step: int) -> None:
        template = template_of(mask)
        velocity = np.zeros(2)
        agreed = 0
        previous = row
        for t in range(row + step, len(self.frames) if step > 0 else -1, step):
            if self.cancelled is not None and self.cancelled():
                raise PerceptionCancelled("correction cancelled")
            expected = template.moved(float(velocity[0]), float(velocity[1]))
            before = self.masks[self.name][t]
            found = self._find(t, previous, template, expected)
            if found is None:
                break
            if before.any() and _overlap(found, before) > AGREED:
                agreed += 1
                if self.was_known and agreed >= AGREED_FRAMES:
                    break
            else:
                agreed = 0
            self._set(t, found)
            new = template_of(found)
            shift = new.centre - template.centre
            velocity = 0.5 * velocity + 0.5 * shift
            full = new.area > 0.8 * template.area or touches_border(found)
            template = new if full else template.moved(float(shift[0]), float(shift[1]))
            previous = t

    def _find(self, t: int, previous: int, template: Template, expected: Template) -> Mask | None:
        """The object's mask at t, from the foreground or, where it does not stand out, by its look; None if lost."""
        width, height = self.size
        foreground = segment(self.frames[t], self.background, min_area=self.min_area)
        outline = expected.drawn(0, 0, width, height)
        touched = np.unique(foreground.labels[outline])
        region = np.isin(foreground.labels, touched[touched > 0])
        if outline.any() and (region & outline).sum() > 0.4 * outline.sum():
            share = self._share(t, region, expected)
            return None if share is None else without_shadow(share, foreground, has_hue=self.has_hue)
        return self._by_look(t, previous, template, expected)

    def _share(self, t: int, region: Mask, expected: Template) -> Mask | None:
        """The object's part of a region in which other objects may be."""
        others = [n for n, series in self.masks.items() if n != self.name and (series[t] & region).sum() > 12]
        if not others:
            mixed = region.sum() > 2.2 * expected.area
            return region if not mixed else region & _grown(expected.drawn(0, 0, *self.size), 4)
        bins = colour_bins(self.frames[t])
        left, top, right, bottom = window_of(region, 6)
        view = (slice(top, bottom), slice(left, right))
        members = [Member(log_likelihood(self.colours), ((expected, 1.0),), 6)]
        for other in others:
            mask = self.masks[other][t]
            members.append(Member(log_likelihood(histogram(bins[mask])), ((template_of(mask), 1.0),), 1))
        shares = partition(region[view], bins[view], left, top, members, self.size)
        mine = whole(shares[0].mask, left, top, self.size)
        if mine.sum() < max(8, 0.05 * expected.area):
            return None
        for other, share in zip(others, shares[1:], strict=True):
            divided = whole(share.mask, left, top, self.size) | (self.masks[other][t] & ~region)
            if (divided != self.masks[other][t]).any():
                self.masks[other][t] = divided
                self.changed.add(other)
        return mine

    def _by_look(self, t: int, previous: int, template: Template, expected: Template) -> Mask | None:
        """Where the object's patch of the last frame is found again."""
        h, w = template.mask.shape
        left, top = round(template.left), round(template.top)
        if left < 0 or top < 0 or left + w > self.size[0] or top + h > self.size[1] or template.area < 12:
            return None
        patch = self.frames[previous][top : top + h, left : left + w]
        search = int(6 + 2 * np.hypot(expected.left - template.left, expected.top - template.top))
        x0, y0 = max(round(expected.left) - search, 0), max(round(expected.top) - search, 0)
        x1 = min(round(expected.left) + w + search, self.size[0])
        y1 = min(round(expected.top) + h + search, self.size[1])
        if x1 - x0 < w or y1 - y0 < h:
            return None
        weight = np.repeat(template.mask.astype(np.uint8)[..., None], 3, axis=2)
        scores = cv2.matchTemplate(self.frames[t][y0:y1, x0:x1], patch, cv2.TM_SQDIFF, mask=weight)
        y, x = np.unravel_index(int(np.argmin(scores)), scores.shape)
        error = np.sqrt(max(float(scores[y, x]), 0.0) / (3.0 * template.area))
        if error > UNLIKE:
            return None
        return Template(template.mask, x0 + float(x), y0 + float(y)).drawn(0, 0, *self.size)

    def _set(self, t: int, mask: Mask) -> None:
        self.masks[self.name][t] = mask
        for other, series in self.masks.items():
            if other != self.name and (series[t] & mask).any():
                series[t] = series[t] & ~mask
                self.changed.add(other)


def _overlap(a: Mask, b: Mask) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))


def _grown(mask: Mask, reach: int) -> NDArray[np.bool_]:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    grown: NDArray[np.bool_] = cv2.dilate(mask.astype(np.uint8), kernel) > 0
    return grown
