"""Pictures for an agent: side by side, and small enough for a message."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from atw_mcp.overlay import ROOM, contact_sheet, encoded


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
    files = encoded({f"frame {k}": noise for k in range(6)})
    assert sum(map(len, files.values())) <= ROOM
    decoded = cv2.imdecode(np.frombuffer(files["frame 3.jpg"], np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    assert decoded.shape[1] / decoded.shape[0] == pytest.approx(1.5, rel=0.05)
