"""A ball bouncing before a fixed camera, from pixels to its coefficient of restitution."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.atw_mcp.session import Session

PIXELS_PER_METRE, FLOOR_ROW, RADIUS, RESTITUTION, FRAME = 150.0, 330, 0.1, 0.75, 1 / 60


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A film at 60 frames a second in a file that says 30: free flight in closed form, Newton's law at the floor."""
    path = tmp_path_factory.mktemp("side") / "bounce.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30, (640, 360))
    x, height, rise = 0.4, 1.8, 0.0
    for _ in range(90):
        frame = np.full((360, 640, 3), 200, np.uint8)
        cv2.rectangle(frame, (0, FLOOR_ROW), (640, 360), (90, 110, 120), -1)
        centre = (round(16 * x * PIXELS_PER_METRE), round(16 * (FLOOR_ROW - height * PIXELS_PER_METRE)))
        cv2.circle(frame, centre, round(16 * RADIUS * PIXELS_PER_METRE), (40, 40, 200), -1, cv2.LINE_AA, 4)
        writer.write(frame)
        x += 0.9 * FRAME
        left = FRAME
        # When the ball's lower side meets the floor: height + rise t - g t^2 / 2 = RADIUS.
        touch = (rise + np.sqrt(rise**2 + 2 * 9.81 * (height - RADIUS))) / 9.81
        if touch < left:
            rise, height, left = RESTITUTION * (9.81 * touch - rise), RADIUS, left - touch
        height, rise = height + rise * left - 0.5 * 9.81 * left**2, rise - 9.81 * left
    writer.release()
    return path


@pytest.fixture(scope="module")
def calibrated(clip: Path) -> tuple[Session, str]:
    """A session and its case, observed and with a camera."""
    session = Session(clip.with_name("atw.db"))
    case: str = session("OpenCase", video=str(clip))["case"]
    session("ObserveObjects", case=case)
    length = {"first_pixel": [100, 330], "second_pixel": [250, 330], "length": 1.0, "view": "side"}
    session("CalibrateCamera", case=case, known_length=length)
    return session, case


def test_restitution_of_a_filmed_bounce_is_recovered(calibrated: tuple[Session, str]) -> None:
    session, case = calibrated
    floor = (359.5 - FLOOR_ROW) / PIXELS_PER_METRE  # z = 0 is the lower edge of the image
    smooth = [{"name": "red_sphere", "friction": 0.0}]
    built = session("BuildWorld", case=case, seconds_per_frame=FRAME, floor=floor, objects=smooth)
    assert built["data"]["statics"] == ["floor"]
    fitted = session("FitWorld", case=case, world=built["data"]["world"], patience_seconds=300)
    values = {value["name"]: value["value"] for value in fitted["data"]["values"]}
    assert fitted["data"]["position_rmse"] < 0.01
    assert values["restitution of red_sphere"] == pytest.approx(RESTITUTION, abs=0.01)


def test_side_view_without_a_floor_says_so(calibrated: tuple[Session, str]) -> None:
    session, case = calibrated
    built = session("BuildWorld", case=case, seconds_per_frame=FRAME)
    assert any("no floor" in note for note in built["data"]["assumed"])
