"""Pictures show what they are asked to show and fit into a message."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from atw_mcp.perception import contact_sheet, encode_image, overlay_labels


def test_outline_is_drawn_where_the_label_ends_and_nowhere_inside() -> None:
    frame = np.full((60, 80, 3), 120, np.uint8)
    labels = np.zeros((60, 80), np.uint8)
    labels[20:40, 30:50] = 2
    picture = overlay_labels(frame, labels, {2: "box"}, scale=2)
    assert picture.shape == (120, 160, 3)
    changed = np.abs(picture.astype(int) - 120).max(axis=2) > 30
    assert changed[40:80, 60].mean() > 0.9  # left edge
    assert not changed[50:70, 70:90].any()  # inside
    assert changed[:40].any()  # the name, above


def test_labels_of_another_size_are_refused() -> None:
    with pytest.raises(ValueError, match="same size"):
        overlay_labels(np.zeros((60, 80, 3), np.uint8), np.zeros((6, 8), np.uint8), ["a"])


def test_contact_sheet_lays_pictures_row_by_row() -> None:
    pictures = [np.full((4, 6, 3), k, np.uint8) for k in range(5)]
    sheet = contact_sheet(pictures, 3)
    assert sheet.shape == (8, 18, 3)
    assert sheet[0, 13, 0] == 2
    assert sheet[5, 7, 0] == 4
    with pytest.raises(ValueError, match="at least one"):
        contact_sheet([], 3)


@pytest.mark.parametrize("kind", ["jpeg", "png"])
def test_encoded_picture_keeps_within_its_limit(kind: str) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (400, 600, 3)).astype(np.uint8)
    data, mime = encode_image(noise, kind=kind, largest=60_000)
    assert len(data) <= 60_000
    assert mime == f"image/{kind}"
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    assert decoded.shape[1] / decoded.shape[0] == pytest.approx(1.5, rel=0.05)
