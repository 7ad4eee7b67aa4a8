"""The background without bodies, corrected by what is known: what nothing supports, and where bodies were found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import SAMPLES, Background, Mask
from atw_mcp.perception.known.finding import Candidate
from atw_mcp.perception.known.settings import SETTINGS
from atw_mcp.perception.video import Frames

Rows = NDArray[np.int64]


def with_supports(background: Background, frames: Frames, bare: Mask) -> Background:
    """Return the background with what was taken for objects at rest put back where there are none.

    bare (H, W): on fixtures, which are taken for such themselves, and where no floor is within reach. What the model
    removed there is put back, and what stays the same in nearly all frames.
    """
    sample = frames[_picks(len(frames))]
    median = np.median(sample, axis=0).astype(np.float32)
    removed = cv2.dilate(background.still.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    noise = 3.0 * max(float(background.noise.max()), SETTINGS.least_noise)
    same = np.mean([np.abs(frame - median).max(axis=2) < noise for frame in sample], axis=0) > SETTINGS.constant
    where = bare & (removed | same)
    image = background.image.copy()
    image[where] = median[where]
    return replace(background, image=image, still=background.still & ~bare)


def uncovered(
    background: Background, frames: Frames, places: Sequence[Sequence[Candidate | None]]
) -> Background | None:
    """Return the background with the median of the frames in which no body covers a pixel, where some body covers it in
    many others; None where that changes nothing. places: of each body by row.
    """
    picks = _picks(len(frames))
    height, width = background.image.shape[:2]
    cover = np.zeros((len(picks), height, width), dtype=np.uint8)
    for series in places:
        for k, t in enumerate(picks):
            place = series[t]
            if place is not None:
                radius = round(SETTINGS.reach * place.radius)
                cv2.circle(cover[k], (round(place.x), round(place.y)), radius, 1, cv2.FILLED)
    covered = cover > 0
    where = (covered.mean(axis=0) > SETTINGS.dwelling) & ((~covered).sum(axis=0) >= SETTINGS.least_free)
    if not where.any():
        return None
    values = np.stack([_as_usual(frames[t], background)[where] for t in picks])
    values[covered[:, where]] = np.nan
    image = background.image.copy()
    image[where] = np.nanmedian(values, axis=0)
    return replace(background, image=image)


def _picks(count: int) -> Rows:
    picks: Rows = np.unique(np.linspace(0, count - 1, SAMPLES).round().astype(np.int64))
    return picks


def _as_usual(frame: Frames, background: Background) -> NDArray[np.float32]:
    """A frame under the background's lighting."""
    gain = (background.image + 1.0) / (background.relit(frame) + 1.0)
    usual: NDArray[np.float32] = (frame * gain).astype(np.float32)
    return usual
