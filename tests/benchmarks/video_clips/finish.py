"""Add what a recorder adds to rendered frames (noise, captions, compression) and write the video file."""

from pathlib import Path

import cv2
import numpy as np
from numpy.random import Generator

from .looks import Look

TITLES = ("test 3", "lab cam", "take 2", "REC", "sample clip", "run 14")


def _write_text(image: np.ndarray, text: str, corner: tuple[float, float]) -> None:
    scale = max(0.45, image.shape[0] / 480 * 0.7)
    (w, h), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    x = int(8 + corner[0] * (image.shape[1] - w - 16))
    y = int(h + 8 + corner[1] * (image.shape[0] - h - 16))
    cv2.putText(image, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, (15, 15, 15), 3, cv2.LINE_AA)
    cv2.putText(image, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, (240, 240, 240), 1, cv2.LINE_AA)


def finish(rng: Generator, look: Look, frames: list[np.ndarray]) -> list[np.ndarray]:
    """Return the frames (RGB) with noise, caption and compression as drawn."""
    title, corners = str(rng.choice(TITLES)), rng.integers(0, 2, (2, 2))
    if np.array_equal(corners[0], corners[1]):
        corners[1] = 1 - corners[0]
    out = []
    for n, frame in enumerate(frames):
        image: np.ndarray = frame.astype(np.float32)
        if look.noise > 0:
            grain = look.noise * np.sqrt(0.4 + image / 255)
            image = image + rng.normal(0, 1, image.shape) * grain
        picture: np.ndarray = np.ascontiguousarray(np.clip(image, 0, 255).astype(np.uint8))
        if look.caption in ("timer", "both"):
            _write_text(picture, f"{n / look.fps:06.3f} s", (float(corners[0, 0]), float(corners[0, 1])))
        if look.caption in ("title", "both"):
            _write_text(picture, title, (float(corners[1, 0]), float(corners[1, 1])))
        if look.quality:
            coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, look.quality])[1]
            picture = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
        out.append(picture)
    return out


def write_video(folder: Path, look: Look, frames: list[np.ndarray]) -> Path:
    """Write clip.mp4 (MPEG-4) or clip.avi (Motion JPEG) and return its path."""
    path = folder / f"clip.{look.container}"
    codec = cv2.VideoWriter.fourcc(*("mp4v" if look.container == "mp4" else "MJPG"))
    writer = cv2.VideoWriter(str(path), codec, float(look.fps), look.size)
    if not writer.isOpened():
        raise OSError(f"cannot write {path}")
    for frame in frames:
        writer.write(frame[..., ::-1])
    writer.release()
    return path
