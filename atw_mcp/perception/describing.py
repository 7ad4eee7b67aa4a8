"""Describe an object: status, confidence, colour, material and shape from its masks."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.cues import colour_cue, material_cue, shape_cue
from atw_mcp.perception.masks import Mask, RunLengthMask, touches_border
from atw_mcp.perception.observation import Cue, ObservedObject, Status, measure
from atw_mcp.perception.video import Frames

CUE_SAMPLES = 12  # frames looked at for colour, material and shape


def describe(
    masks: list[Mask], frames: Frames, clarity: list[float], alone: list[bool], white: float
) -> ObservedObject | None:
    """Return an object, still without a name, from its masks; None if it is seen in no frame.

    clarity (T,) says how surely its pixels are distinguished from other objects' (0..1); alone (T,) whether its region
    touches no other object's.
    """
    count = len(masks)
    seen = [t for t in range(count) if masks[t].sum() >= 8]
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
    colour, material, shape = _cues(masks, frames, clear, seen, area, white)
    return ObservedObject(
        name="",
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
    masks: list[Mask], frames: Frames, clear: list[int], seen: list[int], area: NDArray[np.int64], white: float
) -> tuple[Cue, Cue, Cue]:
    """Colour, material and shape, from the clearest frames."""
    chosen = clear or sorted(seen, key=lambda t: -int(area[t]))[:CUE_SAMPLES]
    picks = sorted({chosen[round(k)] for k in np.linspace(0, len(chosen) - 1, min(CUE_SAMPLES, len(chosen)))})
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    samples = []
    for t in picks:
        inner = cv2.erode(masks[t].astype(np.uint8), disc, borderValue=0) > 0
        samples.append((frames[t], inner if inner.sum() >= 5 else masks[t]))
    return colour_cue(samples, white), material_cue(samples), shape_cue([masks[t] for t in picks])
