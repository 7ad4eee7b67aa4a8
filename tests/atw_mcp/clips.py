"""Small cases made on the spot: a clip of two discs, and tracks of known motion."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

SIZE = (160, 120)
FRAMES = 24


def write_film(path: Path, frames: Iterable[NDArray[Any]], *, rate: float = 25.0, code: str = "mp4v") -> Path:
    """A video of frames (H, W, 3), clipped to bytes."""
    pictures = iter(frames)
    first = next(pictures, None)
    size = SIZE if first is None else (first.shape[1], first.shape[0])
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), rate, size)
    for frame in () if first is None else chain((first,), pictures):
        writer.write(np.clip(frame, 0, 255).astype(np.uint8))
    writer.release()
    return path


def write_clip(path: Path, frames: int = FRAMES) -> Path:
    """An MP4 of a red and a blue disc that move towards each other on a grey ground."""
    images = np.full((frames, SIZE[1], SIZE[0], 3), 150, dtype=np.uint8)
    for t, image in enumerate(images):
        cv2.circle(image, (25 + 2 * t, 60), 9, (40, 40, 200), -1, cv2.LINE_AA)
        cv2.circle(image, (135 - 2 * t, 62), 9, (200, 60, 40), -1, cv2.LINE_AA)
    return write_film(path, images)


def write_tracks(path: Path, *, speed: float = 1.0, friction: float = 0.2, step: float = 0.04, count: int = 30) -> Path:
    """A CSV of one ball at rest and one puck that slides to rest under Coulomb friction: x = v t - mu g t^2 / 2."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "t", "object", "x", "y", "z"])
        for frame in range(count):
            t = min(frame * step, speed / (friction * 9.81))
            writer.writerow([frame, frame * step, "puck", speed * t - 0.5 * friction * 9.81 * t * t, 0.0, 0.05])
            writer.writerow([frame, frame * step, "ball", 0.0, 2.0, 0.05])
    return path
