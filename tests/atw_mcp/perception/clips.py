"""Small synthetic clips with known truth, drawn with OpenCV and written as real video files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.atw_mcp.clips import write_film

Image = NDArray[np.float32]
WIDTH, HEIGHT = 240, 160


@dataclass(frozen=True)
class Disc:
    """A shaded disc: centre(t) [px], drawn in order (later ones in front)."""

    centre: Callable[[int], tuple[float, float]]
    radius: float
    bgr: tuple[float, float, float]


@dataclass(frozen=True)
class Clip:
    """frames (T, H, W, 3) as drawn; truth: visible mask (T, H, W) of each disc, in order."""

    frames: NDArray[np.uint8]
    truth: list[NDArray[np.bool_]]
    path: Path

    def centres(self, k: int) -> NDArray[np.float64]:
        """Centroid (T, 2) of what is visible of disc k, NaN where nothing is."""
        result = np.full((len(self.frames), 2), np.nan)
        for t, mask in enumerate(self.truth[k]):
            if mask.any():
                y, x = np.nonzero(mask)
                result[t] = x.mean(), y.mean()
        return result


def plain(level: float = 135.0, slope: float = 25.0) -> Image:
    """An empty floor, brighter at the upper left."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    image = level + slope * (0.5 - x / WIDTH) + slope * (0.5 - y / HEIGHT)
    return np.repeat(image[..., None], 3, axis=2).astype(np.float32)


def textured(seed: int = 3, amplitude: float = 18.0) -> Image:
    """A wall with blotches of a few pixels."""
    noise = np.random.default_rng(seed).normal(0, 1, (HEIGHT, WIDTH, 3)).astype(np.float32)
    blotches = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return (130 + amplitude * blotches / blotches.std()).astype(np.float32)


def render(
    path: Path,
    discs: list[Disc],
    count: int,
    *,
    background: Image | None = None,
    light: Callable[[int], float] = lambda _t: 1.0,
    noise: float = 1.5,
    shadows: bool = False,
    seed: int = 0,
) -> Clip:
    """Draw, degrade and write a clip as MPEG-4; truth is what is visible before noise and compression."""
    rng = np.random.default_rng(seed)
    base = plain() if background is None else background
    frames = np.zeros((count, HEIGHT, WIDTH, 3), dtype=np.uint8)
    truth = [np.zeros((count, HEIGHT, WIDTH), dtype=bool) for _ in discs]
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    for t in range(count):
        image = base.copy()
        if shadows:
            for disc in discs:
                cx, cy = disc.centre(t)
                distance = np.hypot(
                    (x - cx - 0.5 * disc.radius) / (1.3 * disc.radius),
                    (y - cy - 0.7 * disc.radius) / (0.5 * disc.radius),
                )
                image *= (1 - 0.16 * np.clip((1.15 - distance) / 0.3, 0, 1))[..., None]
        for k, disc in enumerate(discs):
            cx, cy = disc.centre(t)
            distance = np.hypot(x - cx, y - cy)
            cover = np.clip(disc.radius - distance + 0.5, 0, 1)[..., None]
            shade = 1.1 - 0.35 * np.hypot(x - cx + 0.4 * disc.radius, y - cy + 0.4 * disc.radius) / disc.radius
            image = image * (1 - cover) + cover * np.array(disc.bgr, np.float32) * shade[..., None]
            inside = distance < disc.radius
            for other in truth[:k]:
                other[t] &= ~inside
            truth[k][t] = inside
        image = image * light(t) + rng.normal(0, noise, image.shape)
        frames[t] = np.clip(image, 0, 255).astype(np.uint8)
    return Clip(frames, truth, write_film(path, frames))


def overlap(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    """Intersection over union."""
    return float((a & b).sum() / max((a | b).sum(), 1))
