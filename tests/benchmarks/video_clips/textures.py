"""Make floor textures as PNG bytes."""

import cv2
import numpy as np
from numpy.random import Generator

from .bodies import Vec
from .looks import Look


def _blurred(rng: Generator, side: int, cell: int) -> np.ndarray:
    small = rng.normal(0.0, 1.0, (side // cell, side // cell)).astype(np.float32)
    return cv2.resize(small, (side, side), interpolation=cv2.INTER_CUBIC)


def floor_png(rng: Generator, look: Look) -> bytes:
    """Draw the floor's texture (tileable only roughly) in the look's colour and return PNG bytes."""
    side = 512
    rgb: Vec = look.floor_rgb
    base = np.ones((side, side, 3)) * np.asarray(rgb)
    if look.floor == "noise":
        pattern = sum(_blurred(rng, side, c) * w for c, w in ((2, 0.03), (8, 0.03), (32, 0.04)))
        base = base + np.asarray(pattern)[..., None]
    elif look.floor == "checker":
        cells = (np.indices((side, side)) // (side // 8)).sum(axis=0) % 2
        base = base * (1.0 + 0.35 * (cells[..., None] - 0.5) * float(rng.uniform(0.6, 1.6)))
    elif look.floor == "wood":
        rows = np.arange(side) // 64
        tone = rng.uniform(0.8, 1.15, 8)[rows][:, None]
        stretched = cv2.resize(
            rng.normal(0, 1, (side // 2, 8)).astype(np.float32), (side, side), interpolation=cv2.INTER_CUBIC
        )
        wood = np.array([0.58, 0.40, 0.25]) * float(rng.uniform(0.8, 1.2))
        base = wood * (tone * (1.0 + 0.08 * stretched))[..., None]
        base[np.arange(side) % 64 < 2] *= 0.6
    image = np.clip(base * 255, 0, 255).astype(np.uint8)
    return bytes(cv2.imencode(".png", image[..., ::-1])[1].tobytes())
