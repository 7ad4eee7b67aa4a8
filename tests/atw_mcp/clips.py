"""Small cases made on the spot: a clip of two discs, and tracks of known motion."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np

SIZE = (160, 120)
FRAMES = 24


def write_clip(path: Path, frames: int = FRAMES) -> Path:
    """An MP4 of a red and a blue disc that move towards each other on a grey ground."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25.0, SIZE)
    for t in range(frames):
        image = np.full((SIZE[1], SIZE[0], 3), 150, dtype=np.uint8)
        cv2.circle(image, (25 + 2 * t, 60), 9, (40, 40, 200), -1, cv2.LINE_AA)
        cv2.circle(image, (135 - 2 * t, 62), 9, (200, 60, 40), -1, cv2.LINE_AA)
        writer.write(image)
    writer.release()
    return path


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
