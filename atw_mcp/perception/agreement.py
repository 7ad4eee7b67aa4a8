"""Agreement of two observations of one video, by object and by frame, and which of them to prefer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject
from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]

SAME = 0.1  # mean IoU from which two objects are taken to be one
AGREE = 0.7  # IoU from which two masks of one object are taken to agree
LOOKS = 12  # frames in which colours are looked at
RING = 0.15  # width of the ring around an object, of the square root of its area


@dataclass(frozen=True)
class ObjectAgreement:
    """One object as two observations have it; None where one has it not.

    iou (T,): of its masks in the frames both observed, 0 where one alone sees it, NaN where neither does. merit (0..1),
    of the first and the second: how alike its masks of neighbouring frames are once their motion is taken out, times
    the share, of the frames in which either sees the object, in which this one does, times how far the colours inside
    differ from those around it.
    """

    first: str | None
    second: str | None
    frames: tuple[int, ...]
    iou: Floats
    merit: tuple[float, float]

    @property
    def mean(self) -> float:
        """Mean IoU over the frames in which either sees the object."""
        return float(np.nanmean(self.iou)) if np.isfinite(self.iou).any() else 0.0

    @property
    def better(self) -> str:
        """Which observation has the greater merit: "first" or "second"."""
        return "first" if self.merit[0] >= self.merit[1] else "second"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        apart = [f for f, v in zip(self.frames, self.iou, strict=True) if np.isfinite(v) and v < AGREE]
        return {
            "first": self.first,
            "second": self.second,
            "mean_iou": round(self.mean, 3),
            "frames_agreeing": int((self.iou >= AGREE).sum()),
            "frames_disagreeing": _spans(apart),
            "merit": {"first": round(self.merit[0], 3), "second": round(self.merit[1], 3)},
            "better": self.better,
        }


def agreement(first: ImageObservation, second: ImageObservation, images: Frames) -> tuple[ObjectAgreement, ...]:
    """Compare two observations of one video over the frames both have. images (T, H, W, 3): the frames of `first`.

    Objects of one name are matched, the others one to one by mean IoU; those without a partner come last. Raises
    ObservationError where the videos differ or no frame is common.
    """
    if first.video.sha256 != second.video.sha256:
        raise ObservationError(f"{first.video.path} and {second.video.path} are not the same video")
    frames = tuple(f for f in first.frames if f in set(second.frames))
    if not frames:
        raise ObservationError("the two observations have no frame in common")
    rows = [[o.row(f) for f in frames] for o in (first, second)]
    ious = np.full((len(first.objects), len(second.objects), len(frames)), np.nan)
    for i, one in enumerate(first.objects):
        for j, other in enumerate(second.objects):
            ious[i, j] = [_iou(one.masks[a], other.masks[b]) for a, b in zip(*rows, strict=True)]
    mean = np.array([[np.nanmean(v) if np.isfinite(v).any() else 0.0 for v in row] for row in ious])
    named = np.array([[one.name == other.name for other in second.objects] for one in first.objects])
    pairs = list(zip(*linear_sum_assignment(-mean - 2.0 * named), strict=True)) if mean.size else []
    matched = {int(i): int(j) for i, j in pairs if named[i, j] or mean[i, j] >= SAME}
    rest = [(None, j) for j in range(len(second.objects)) if j not in matched.values()]
    both = sorted(matched.items()) + [(i, None) for i in range(len(first.objects)) if i not in matched] + rest
    shown = images[rows[0]]
    found = []
    for k, m in both:
        items = (None if k is None else first.objects[k], None if m is None else second.objects[m])
        if k is not None and m is not None:
            iou = ious[k, m]
        else:  # seen by one alone
            seen = next((item.masks, own) for item, own in zip(items, rows, strict=True) if item is not None)
            iou = np.array([np.nan if seen[0][t] is None else 0.0 for t in seen[1]])
        either = float(np.isfinite(iou).sum())
        merits = [0.0 if x is None else _merit(x, own, shown, either) for x, own in zip(items, rows, strict=True)]
        names = [None if x is None else x.name for x in items]
        found.append(ObjectAgreement(names[0], names[1], frames, iou, (merits[0], merits[1])))
    return tuple(found)


def by_agreement(
    first: ImageObservation, second: ImageObservation, images: Frames, names: Sequence[str]
) -> tuple[ImageObservation, tuple[ObjectAgreement, ...]]:
    """`first` with each object as the one of greater merit has it, and how far they agree.

    Objects are those of `first`, and those of `second` whose names are in `names`: of what is known to be there. The
    frames are those of `first`. Where the two disagree in a frame, the confidence there is multiplied by their IoU, so
    that a fit leans on frames in which two independent methods see the same. An object that one method alone sees has
    its confidence halved; others of `second` alone are left out. The warnings name both.
    """
    compared = agreement(first, second, images)
    partner = {item.first: item for item in compared if item.first is not None}
    objects, notes = [], []
    for item in first.objects:
        found = partner[item.name]
        if found.second is None:
            notes.append(f"{item.name} is seen by one method only: its confidence is halved")
            objects.append(replace(item, confidence=np.round(0.5 * item.confidence, 4)))
            continue
        taken = item
        if found.better == "second" and second.frames == first.frames:
            taken = replace(second.object(found.second), name=item.name)
        weight = np.ones(len(first.frames))
        for frame, value in zip(found.frames, found.iou, strict=True):
            if np.isfinite(value) and value < AGREE:
                weight[first.row(frame)] = value
        objects.append(replace(taken, confidence=np.round(taken.confidence * weight, 4)))
        if found.mean < AGREE:
            notes.append(
                f"{item.name}: two methods disagree about it (mean IoU {found.mean:.2f}): look at its outlines"
            )
    alone = [item.second for item in compared if item.first is None and item.second is not None]
    if second.frames == first.frames:
        for name in [n for n in alone if n in names]:
            item = second.object(name)
            objects.append(replace(item, confidence=np.round(0.5 * item.confidence, 4)))
            notes.append(f"{name} is seen by one method only: its confidence is halved")
            alone.remove(name)
    if alone:
        notes.append(f"left out, since one method alone sees them: {', '.join(alone)}")
    return replace(first, objects=tuple(objects), warnings=(*first.warnings, *notes)), compared


def _merit(item: ObservedObject, rows: list[int], images: Frames, either: float) -> float:
    share = sum(item.masks[t] is not None for t in rows) / max(either, 1.0)
    return _steadiness(item, rows) * share * _distinctness(item, rows, images)


def _iou(one: RunLengthMask | None, other: RunLengthMask | None) -> float:
    if one is None and other is None:
        return float("nan")
    if one is None or other is None:
        return 0.0
    a, b = one.decode(), other.decode()
    return float((a & b).sum() / max((a | b).sum(), 1))


def _steadiness(item: ObservedObject, rows: list[int]) -> float:
    """Median IoU of an object's masks of neighbouring rows, each moved to the other's centroid."""
    values = []
    for a, b in pairwise(rows):
        one, other = item.masks[a], item.masks[b]
        if one is not None and other is not None and item.status[a] == item.status[b] == "visible":
            values.append(_moved_iou(one.decode(), other.decode(), item.centroid[b] - item.centroid[a]))
    return float(np.median(values)) if values else 0.0


def _moved_iou(one: Mask, other: Mask, shift: Floats) -> float:
    """IoU of `other` with `one` moved by a shift (x, y) [px], to the nearest pixel."""
    y, x = np.nonzero(one)
    dx, dy = np.round(shift).astype(int)
    y, x = y + dy, x + dx
    inside = (y >= 0) & (x >= 0) & (y < one.shape[0]) & (x < one.shape[1])
    both = int(other[y[inside], x[inside]].sum())
    return both / max(len(y) + int(other.sum()) - both, 1)


def _distinctness(item: ObservedObject, rows: list[int], images: Frames) -> float:
    """Median distance of the colours inside an object's masks and in a ring around them (Bhattacharyya, 0..1).

    A mask that has no surroundings, as one that fills the frame, stands out from nothing: 0.
    """
    seen = [k for k, t in enumerate(rows) if item.masks[t] is not None]
    values = []
    for k in sorted({seen[round(v)] for v in np.linspace(0, len(seen) - 1, min(LOOKS, len(seen)))}):
        stored = item.masks[rows[k]]
        assert stored is not None
        inside = stored.decode().astype(np.uint8)
        width = max(round(RING * float(np.sqrt(inside.sum()))), 2)
        around = cv2.dilate(inside, np.ones((2 * width + 1, 2 * width + 1), np.uint8)) - inside
        if not around.any():
            values.append(0.0)
            continue
        inner, outer = (_colours(images[k], mask) for mask in (inside, around))
        values.append(float(np.sqrt(max(1.0 - np.sqrt(inner * outer).sum(), 0.0))))
    return float(np.median(values)) if values else 0.0


def _colours(image: Frames, mask: NDArray[np.uint8]) -> Floats:
    """Share of the mask's pixels in each of 8 x 8 x 8 cells of colour."""
    counts = np.asarray(cv2.calcHist([image], [0, 1, 2], mask, [8, 8, 8], [0, 256] * 3), dtype=float)
    shares: Floats = counts / counts.sum()
    return shares


def _spans(frames: list[int]) -> list[list[int]]:
    """Frame numbers as [first, last] of runs without a gap."""
    spans: list[list[int]] = []
    for frame in frames:
        if spans and frame == spans[-1][1] + 1:
            spans[-1][1] = frame
        else:
            spans.append([frame, frame])
    return spans
