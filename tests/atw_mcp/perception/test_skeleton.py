"""Centrelines of drawn curves, of which every point is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.perception.skeleton import CentrelineInImage, centreline

Floats = NDArray[np.float64]
SIZE = (320, 240)


def wave(count: int = 400, shift: float = 60.0) -> Floats:
    t = np.linspace(0.0, 1.0, count)
    return np.stack([shift + 200.0 * t, 120.0 + 60.0 * np.sin(5.0 * t)], axis=1)


def drawn(curve: Floats, width: int) -> NDArray[np.bool_]:
    """A rope with round ends, `width` px thick."""
    image = np.zeros(SIZE[::-1], dtype=np.uint8)
    cv2.polylines(image, [np.round(curve * 16).astype(np.int32)], False, 255, width, cv2.LINE_8, 4)
    return image > 127


def evenly(curve: Floats, count: int) -> Floats:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(at, along, curve[:, i]) for i in (0, 1)], axis=1)


def found(mask: NDArray[np.bool_]) -> CentrelineInImage:
    line = centreline(mask)
    assert line is not None
    return line


@pytest.mark.parametrize("width", [2, 4, 9, 15])
def test_points_along_a_drawn_rope_are_found_to_a_pixel_whatever_its_width(width: int) -> None:
    line = found(drawn(wave(), width))
    points = line.evenly(16)
    points = points if points[0, 0] < points[-1, 0] else points[::-1]
    away = np.linalg.norm(points - evenly(wave(), 16), axis=1)
    assert np.sqrt((away**2).mean()) < 0.8
    assert away.max() < 1.7
    assert line.width == pytest.approx(width, abs=1.0)
    assert line.whole


def test_small_holes_and_narrow_cuts_do_not_break_the_line() -> None:
    mask = drawn(wave(), 7)
    for k in (40, 200, 333):
        x, y = wave()[k].astype(int)
        mask[y - 1 : y + 2, x - 1 : x + 2] = False
    mask[:, 150:152] = False  # a cut right through
    line = found(mask)
    assert line.whole
    assert line.length == pytest.approx(found(drawn(wave(), 7)).length, rel=0.02)


def test_a_rope_that_leaves_the_image_is_not_whole() -> None:
    line = found(drawn(wave(shift=200.0), 5))
    assert line.truncated
    assert not line.whole
    away = np.linalg.norm(line.points[:, None] - wave(shift=200.0)[None], axis=2).min(axis=1)
    assert away.max() < 1.8  # what is seen of it lies on the curve all the same


def test_a_rope_across_itself_is_not_taken_for_a_line() -> None:
    t = np.linspace(0.0, 1.0, 500)
    loop = np.stack([60 + 200 * t + 70 * np.sin(2 * np.pi * t * 1.5), 120 - 70 * np.cos(2 * np.pi * t * 1.5)], axis=1)
    assert not found(drawn(loop, 5)).whole


def test_two_separate_pieces_are_two_parts_and_too_little_is_nothing() -> None:
    mask = drawn(wave(), 5)
    mask[:, 140:170] = False
    assert found(mask).parts == 2
    dot = np.zeros((20, 20), dtype=bool)
    dot[5:8, 5:8] = True
    assert centreline(dot) is None
