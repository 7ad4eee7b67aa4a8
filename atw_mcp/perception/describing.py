"""Describe objects: status, confidence, colour, material and shape from their masks."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.cues import colour_cue, material_cue, shape_cue
from atw_mcp.perception.masks import Mask, RunLengthMask, touches_border, window
from atw_mcp.perception.observation import Cue, ObservedObject, Status, measure
from atw_mcp.perception.video import Frames

CUE_SAMPLES = 12  # frames looked at for colour, material and shape
LEAST_PIXELS = 8  # of a mask


def describe(
    masks: Mapping[str, list[Mask]],
    frames: Frames,
    clarity: Mapping[str, NDArray[np.float64]] | None = None,
    only: Collection[str] | None = None,
) -> dict[str, ObservedObject]:
    """Return objects by name from their masks (T), but those that are seen in no frame.

    clarity (T,): how surely pixels are distinguished from other objects' (0..1), default 1. only: names of those to
    describe.
    """
    apart = dict(zip(masks, _standing_apart(list(masks.values())), strict=True))
    found = {}
    for name in masks if only is None else only:
        sure = np.ones(len(frames)) if clarity is None else clarity[name]
        made = _described(name, masks[name], frames, sure, apart[name])
        if made is not None:
            found[name] = made
    return found


def _described(
    name: str, masks: list[Mask], frames: Frames, clarity: NDArray[np.float64], alone: list[bool]
) -> ObservedObject | None:
    """Object of masks; alone (T,): whether its region touches no other object's."""
    count = len(masks)
    seen = [t for t in range(count) if masks[t].sum() >= LEAST_PIXELS]
    if not seen:
        return None
    stored = tuple(RunLengthMask.encode(m) if t in set(seen) else None for t, m in enumerate(masks))
    centroid, box, area = measure(stored)
    border = [touches_border(m) for m in masks]
    clear = [t for t in seen if alone[t] and not border[t]]
    full = _full_area(area, clear or seen, count)
    status: list[Status] = []
    confidence = np.zeros(count)
    first, last = seen[0], seen[-1]
    for t in range(count):
        if stored[t] is None:
            outside = (t < first and border[first]) or (t > last and border[last])
            status.append("absent" if outside else "hidden")
            continue
        share = min(float(area[t] / max(full[t], 1.0)), 1.0)
        if border[t]:
            status.append("truncated")
            confidence[t] = (0.35 + 0.45 * share) * clarity[t]
        elif not alone[t] and share < 0.94:
            status.append("occluded")
            confidence[t] = clarity[t] * (0.15 + 0.75 * share)
        else:
            status.append("visible")
            confidence[t] = 0.97 * clarity[t] * (1.0 if alone[t] else 0.95) * (0.5 + 0.5 * share)
    colour, material, shape = _cues(masks, frames, clear, seen, area)
    return ObservedObject(
        name=name,
        colour=colour,
        material=material,
        shape=shape,
        status=tuple(status),
        confidence=np.round(confidence, 4),
        centroid=centroid,
        box=box,
        area=area,
        masks=stored,
        entry_frame=first,
        exit_frame=last,
        enters=bool(first > 0 and border[first]) or bool(first == 0 and border[0] and area[0] < 0.9 * full[0]),
        exits=bool(last < count - 1 and border[last]),
    )


def _standing_apart(all_masks: list[list[Mask]]) -> list[list[bool]]:
    """For each object and frame, whether its mask stands apart from every other's."""
    kernel = np.ones((3, 3), np.uint8)
    apart = [[True] * len(series) for series in all_masks]
    for t in range(len(all_masks[0]) if all_masks else 0):
        for k, series in enumerate(all_masks):
            near = window(series[t], 1)
            own = series[t][near]
            grown = cv2.dilate(own.astype(np.uint8), kernel) > 0 if own.size else own
            around = (grown & other[t][near] for m, other in enumerate(all_masks) if m != k)
            apart[k][t] = not any(part.any() for part in around)
    return apart


def _full_area(area: NDArray[np.int64], clear: list[int], count: int) -> NDArray[np.float64]:
    """Area that the whole object would have in every frame: interpolated between the frames it is clear in."""
    rows = np.array(clear)
    values = area[rows].astype(float)
    if len(values) >= 5:  # a frame with a bad mask must not set the scale
        padded = np.pad(values, 2, mode="edge")
        values = np.median(np.stack([padded[k : k + len(values)] for k in range(5)]), axis=0)
    full: NDArray[np.float64] = np.interp(np.arange(count), rows, values)
    return full


def _cues(
    masks: list[Mask], frames: Frames, clear: list[int], seen: list[int], area: NDArray[np.int64]
) -> tuple[Cue, Cue, Cue]:
    """Colour, material and shape, from the clearest frames."""
    chosen = clear or sorted(seen, key=lambda t: -int(area[t]))[:CUE_SAMPLES]
    picks = sorted({chosen[round(k)] for k in np.linspace(0, len(chosen) - 1, min(CUE_SAMPLES, len(chosen)))})
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    samples = []
    for t in picks:
        inner = cv2.erode(masks[t].astype(np.uint8), disc, borderValue=0) > 0
        samples.append((frames[t], inner if inner.sum() >= 5 else masks[t]))
    return colour_cue(samples), material_cue(samples), shape_cue([masks[t] for t in picks])
