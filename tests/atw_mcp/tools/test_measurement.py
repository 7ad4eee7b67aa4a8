"""CalibrateCamera reports how well the camera is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from polyworld.pictures.render import look_at
from tests.atw_mcp.clips import write_clip
from tests.atw_mcp.session import Session

CORNERS = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.2, 0.3, 0.0]])


def test_rms_and_the_largest_error_are_reported_and_four_points_are_called_unchecked(
    session: Session, tmp_path: Path
) -> None:
    """The fifth of the pixels is 4 px off; without it the four leave nothing over to see that by."""
    case = session("OpenCase", video=str(write_clip(tmp_path / "marbles.mp4")))
    size = {key: case["data"]["facts"][key] for key in ("width", "height")}
    camera = look_at(np.array([1.0, -5.0, 4.0]), np.zeros(3), focal=size["width"] * 1.2, **size)
    pixels = camera.project(CORNERS) + np.array([[0.0, 0.0]] * 4 + [[4.0, 0.0]])
    points = [{"world": w, "pixel": p} for w, p in zip(CORNERS.tolist(), pixels.tolist(), strict=True)]
    four = session("CalibrateCamera", case=case["case"], points=points[:4])
    assert "nothing left over to check" in four["summary"]
    five = session("CalibrateCamera", case=case["case"], points=points)
    assert "nothing left over" not in five["summary"]
    assert 1.0 < five["data"]["largest_error"] < 4.0
    assert five["data"]["rms"] < five["data"]["largest_error"]
    assert five["data"]["compared"] == 5
    assert f"at most {five['data']['largest_error']:.3g} px" in five["summary"]
    assert "errors" not in five["data"]
