"""The background without bodies, corrected by what is known: what nothing supports, and where bodies were found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Background, Mask, sample_rows
from atw_mcp.perception.known.finding import Candidate
from atw_mcp.perception.known.settings import SETTINGS
from atw_mcp.perception.video import Frames


def with_supports(background: Background, frames: Frames, bare: Mask) -> Background:
    """Return the background with what was taken for objects at rest put back where there are none.

    bare (H, W): on fixtures, which are taken for such themselves, and where no floor is within reach. A smooth surface
    says nothing of those at all: there the median of the frames takes its place.
    """
    removed = cv2.dilate(background.still.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    where = bare if background.smooth else bare & removed
    image = background.image.copy()
    image[where] = np.median(frames[sample_rows(len(frames))][:, where], axis=0)
    return replace(background, image=image, still=background.still & ~bare)


def uncovered(
    background: Background, frames: Frames, places: Sequence[Sequence[Candidate | None]]
) -> Background | None:
    """Return the background with the median of the frames in which no body covers a pixel, where some body covers it in
    many others; None where that changes nothing. places: of each body by row.
    """
    picks = sample_rows(len(frames))
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


def _as_usual(frame: Frames, background: Background) -> NDArray[np.float32]:
    """Return a frame under the background's lighting."""
    gain = (background.image + 1.0) / (background.relit(frame) + 1.0)
    usual: NDArray[np.float32] = (frame * gain).astype(np.float32)
    return usual
