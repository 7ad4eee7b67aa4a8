"""Observations of rendered clips from one seed per body, as somebody who looks at a frame gives it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.correction import correct
from atw_mcp.perception.corrections import Correction
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import load
from tests.benchmarks.videos.scores import SEEN

Labels = NDArray[np.uint8]
Seeded = Literal["box", "outline"]

MARGIN = 2  # [px] by which a box is larger than the body
WHOLE = 0.8  # of a body's largest visible area, from which a frame shows it whole


def seeds(labels: Labels, bodies: list[str], how: Seeded) -> list[Correction]:
    """Return one seed for each body that labels (T, H, W) show: its box, or its outline, in the middle one of the
    frames that show it whole."""
    made = []
    height, width = labels.shape[1:]
    for k, body in enumerate(bodies):
        area = (labels == k + 1).sum(axis=(1, 2))
        if area.max() < SEEN:
            continue
        whole = np.flatnonzero(area >= max(WHOLE * area.max(), SEEN))
        frame = int(whole[len(whole) // 2])
        mask = labels[frame] == k + 1
        if how == "outline":
            contours = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
            points = max(contours, key=cv2.contourArea)[:, 0]
            if len(points) > 2:
                fewer = points[:: -(-len(points) // 200)]
                made.append(Correction(kind="add", object=body, frame=frame, outline=fewer.tolist()))
                continue
        y, x = np.nonzero(mask)
        left, top = max(int(x.min()) - MARGIN, 0), max(int(y.min()) - MARGIN, 0)
        right, bottom = min(int(x.max()) + MARGIN + 1, width), min(int(y.max()) + MARGIN + 1, height)
        box = [left, top, right - left, bottom - top]
        made.append(Correction(kind="add", object=body, frame=frame, box=box))
    return made


def observe_seeded(file: Path, labels: Labels, bodies: list[str], how: Seeded) -> ImageObservation:
    """Follow every body of a clip from one seed, nothing else being known."""
    info, frames = load(file)
    nothing = ImageObservation(info, tuple(range(len(frames))), ())
    return correct(nothing, file, seeds(labels, bodies, how))
