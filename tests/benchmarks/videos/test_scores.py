"""Scores of masks against truth: cases whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.videos.scores import score_masks


def scene() -> np.ndarray:
    """Two squares of 10 x 10 pixels, labels (T = 3, H = 40, W = 60); the second one moves by 5 pixels a frame."""
    labels = np.zeros((3, 40, 60), dtype=np.uint8)
    for t in range(3):
        labels[t, 5:15, 5:15] = 1
        labels[t, 20:30, 10 + 5 * t : 20 + 5 * t] = 2
    return labels


def test_true_masks_are_complete() -> None:
    labels = scene()
    score = score_masks(labels, ["a", "b"], {"two": labels == 2, "one": labels == 1})
    assert score.complete
    assert [(b.body, b.observed, b.iou, b.off, b.seen) for b in score.bodies] == [
        ("a", "one", 1.0, 0.0, 1.0),
        ("b", "two", 1.0, 0.0, 1.0),
    ]


def test_a_shifted_mask_has_its_overlap_and_its_distance() -> None:
    labels = scene()
    shifted = np.roll(labels == 1, 2, axis=2)  # 8 of 10 columns overlap: 80 / 120
    score = score_masks(labels, ["a", "b"], {"one": shifted, "two": labels == 2})
    assert score.bodies[0].iou == pytest.approx(2.0 / 3.0)
    assert score.bodies[0].off == pytest.approx(2.0 / (2.0 * np.sqrt(100 / np.pi)))


def test_what_is_no_body_is_a_ghost_and_what_has_no_mask_is_not_found() -> None:
    labels = scene()
    ghost = np.zeros(labels.shape, dtype=bool)
    ghost[:, 35:39, 40:50] = True
    score = score_masks(labels, ["a", "b"], {"one": labels == 1, "ghost": ghost})
    assert not score.complete
    assert score.ghosts == ("ghost",)
    assert score.bodies[1].observed is None
