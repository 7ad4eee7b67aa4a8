"""Pictures of a gap keep their colours in few bytes."""

from __future__ import annotations

import cv2
import numpy as np

from atw_mcp.gap.pictures import AFTER, BEFORE, map_picture, path_picture
from atw_mcp.looking.overlay import ROOM
from polyworld.gap.report import Compared


def compared(scale: float) -> list[Compared]:
    """Three noisy throws of 300 samples, off by scale times the square of time."""
    rng = np.random.default_rng(0)
    times = np.linspace(0.0, 2.0, 300)
    items = []
    for k in range(3):
        observed = np.stack([1.2 * times, 0.1 * k + 0.0 * times, 1.5 * times - times**2], axis=1)
        residual = rng.normal(size=(300, 3)) + scale * np.outer(times**2, [1.0, 0.0, -1.0])
        items.append(Compared(f"run {k}", "ball", times, observed, observed + 0.02 * residual, residual))
    return items


def test_pictures_are_small_and_true_in_colour() -> None:
    paths, places = (draw(compared(3.0), compared(0.0)) for draw in (path_picture, map_picture))
    assert len(paths) < ROOM / 3 / 4  # twelve panels are four times as much
    assert len(places) < ROOM / 3
    image = cv2.imdecode(np.frombuffer(paths, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    for color in (BEFORE, AFTER):
        wanted = np.array([int(color[k : k + 2], 16) for k in (5, 3, 1)])
        assert (np.abs(image.astype(int) - wanted).max(axis=2) < 12).sum() > 150
