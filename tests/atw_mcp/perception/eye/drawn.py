"""Pictures of discs on a floor, drawn with smooth edges and noise, whose places are known."""

from __future__ import annotations

import numpy as np

WIDTH, HEIGHT = 160, 120
FLOOR = (150.0, 150.0, 150.0)
RED, BLUE, GREY = (40.0, 40.0, 190.0), (180.0, 80.0, 40.0), (149.0, 149.0, 149.0)


def frames(
    discs: list[tuple[np.ndarray, float, tuple[float, float, float]]], *, noise: float = 1.0, seed: int = 0
) -> np.ndarray:
    """Frames (T, H, W, 3) of BGR bytes with discs (places (T, 2) [px], radius [px], BGR colour), the first behind."""
    random = np.random.default_rng(seed)
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    shine = 1.0 + 0.1 * u / WIDTH  # the floor is not of one brightness
    found = []
    for k in range(len(discs[0][0])):
        picture = np.array(FLOOR) * shine[..., None]
        for places, radius, colour in discs:
            distance = np.hypot(u - places[k, 0], v - places[k, 1])
            share = np.clip(radius - distance + 0.5, 0.0, 1.0)[..., None]
            picture = picture * (1 - share) + np.array(colour) * share
        found.append(np.clip(picture + random.normal(0, noise, picture.shape), 0, 255).astype(np.uint8))
    return np.stack(found)


def line(start: tuple[float, float], step: tuple[float, float], count: int) -> np.ndarray:
    """Places (count, 2) [px] at constant velocity."""
    return np.array(start) + np.arange(count)[:, None] * np.array(step)
