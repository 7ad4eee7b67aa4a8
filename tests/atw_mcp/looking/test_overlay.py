"""Pictures for an agent: side by side, and small enough for a message."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from atw_mcp.looking.overlay import OBSERVED, ROOM, SIMULATED, Canvas, contact_sheet, encoded


def test_contact_sheet_lays_pictures_row_by_row() -> None:
    pictures = [np.full((4, 6, 3), k, np.uint8) for k in range(5)]
    sheet = contact_sheet(pictures, 3)
    assert sheet.shape == (8, 18, 3)
    assert sheet[0, 13, 0] == 2
    assert sheet[5, 7, 0] == 4
    with pytest.raises(ValueError, match="at least one"):
        contact_sheet([], 3)


def test_pictures_of_one_result_fit_into_a_message_together() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (480, 720, 3)).astype(np.uint8)
    files, scale = encoded({f"frame {k}": noise for k in range(6)})
    assert sum(map(len, files.values())) <= ROOM
    decoded = cv2.imdecode(np.frombuffer(files["frame 3.jpg"], np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    assert decoded.shape[1] == round(scale * noise.shape[1])
    assert decoded.shape[1] / decoded.shape[0] == pytest.approx(1.5, rel=0.05)


def test_names_keep_off_the_other_objects_and_off_each_other() -> None:
    """Squares in a tight row leave room above and below, not between."""
    masks = {}
    for k in range(5):
        mask = np.zeros((400, 720), dtype=bool)
        mask[180:230, 200 + 52 * k : 250 + 52 * k] = True
        masks[f"green_cylinder_{k}"] = mask
    canvas = Canvas(np.full((400, 720, 3), 128, np.uint8), 1.0)
    canvas.names(masks, OBSERVED)
    everything = np.any(list(masks.values()), axis=0)
    for k, (left, top, right, bottom) in enumerate(canvas.taken):
        assert not everything[round(top) : round(bottom), round(left) : round(right)].any()
        for other in canvas.taken[:k]:
            assert right <= other[0] or other[2] <= left or bottom <= other[1] or other[3] <= top
    assert len(canvas.taken) == 5


def test_dashes_over_a_solid_outline_leave_both_to_be_seen() -> None:
    mask = np.zeros((400, 720), dtype=bool)
    mask[100:300, 200:500] = True
    canvas = Canvas(np.full((400, 720, 3), 90, np.uint8), 1.0)
    canvas.outline(mask, SIMULATED)
    canvas.outline(mask, OBSERVED, "dashed")
    along = canvas.image[98:102, 200:500].astype(int)
    white = (along.min(axis=2) > 200).any(axis=0).mean()
    magenta = ((along[..., 1] < 120) & (along[..., 0] > 180) & (along[..., 2] > 180)).any(axis=0).mean()
    assert white > 0.3
    assert magenta > 0.15
