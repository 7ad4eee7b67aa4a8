"""Balls of small films are found and modelled as they were drawn: 100 px are 1 m, 1.5 m/s across and 4 m/s up."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.atw_mcp.session import Session
from tests.shared_inputs import INPUTS, needs_input

LENGTH = {"first_pixel": [100, 200], "second_pixel": [200, 200], "length": 1.0, "view": "side"}
BALL = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "color": "red"}


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Session:
    monkeypatch.setenv("ATW_MCP_ALLOW", f"{INPUTS}:{tmp_path}")
    return Session(tmp_path / "atw.db")


def found(session: Session, film: Path) -> list[tuple[str, str]]:
    """Colour and shape of what is seen in every frame of a film, but for what is cut off at its edge."""
    case = session("OpenCase", video=str(film))["case"]
    objects = session("ObserveObjects", case=case, patience_seconds=300)["data"]["objects"]
    return [(o["colour"], o["shape"]) for o in objects if o["frames"] == {"visible": 26}]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=needs_input(name))
        for name in ("video_gray.mp4", "video_mono_darker_ball_not_found.mp4")
    ],
)
def test_grey_ball_darker_than_the_ground_is_found(session: Session, name: str) -> None:
    assert found(session, INPUTS / name) == [("gray", "sphere")]


@pytest.mark.parametrize("level", [60, 105])
def test_one_flat_grey_ball_is_no_shadow(session: Session, tmp_path: Path, level: int) -> None:
    """Nothing is there that could cast it."""
    film = tmp_path / "ball.mp4"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"mp4v"), 30, (320, 240))
    for t in np.arange(26) / 30:
        picture = np.full((240, 320, 3), 150, np.uint8)
        centre = (round(16 * (30 + 150 * t)), round(16 * (200 - 400 * t + 490.5 * t * t)))
        cv2.circle(picture, centre, 160, (level, level, level), -1, cv2.LINE_AA, shift=4)
        writer.write(picture)
    writer.release()
    assert found(session, film) == [("gray", "sphere")]


@needs_input("video_control_red_ball_side_view.mp4")
def test_flight_of_a_red_ball_is_modelled_in_one_call(session: Session) -> None:
    film = str(INPUTS / "video_control_red_ball_side_view.mp4")
    made = session("ModelVideo", video=film, known_length=LENGTH, objects=[BALL], patience_seconds=600)
    (error,) = made["data"]["errors"]
    assert error["frames"] == 26
    assert error["error_px"] < 0.3
    (ball,) = json.loads(session.store_document(made["data"]["world"]))["objects"]
    assert ball["velocity"] == pytest.approx([1.5, 0.0, 4.0], abs=0.02)
