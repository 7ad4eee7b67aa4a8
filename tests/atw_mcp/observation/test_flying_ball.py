"""A ball thrown across a room and filmed by one camera: from the video and its radius to its path and its rebound."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.atw_mcp.perception.test_flight import BALL, CAMERA, FRAME, HEIGHT, WIDTH, bouncing
from tests.atw_mcp.session import Session

RESTITUTION = 0.7
KNOWN = {"name": "ball", "shape": {"kind": "sphere", "radius": BALL.radius}}
PATH = bouncing(30, np.array([-0.9, 0.4, 0.7]), np.array([1.5, -0.3, 1.2]), RESTITUTION)
PLACES = [[x, y, 0.0] for x in (-1.0, 0.0, 1.0) for y in (-0.6, 0.8)] + [
    [-1.0, 1.2, 0.9],
    [1.0, 1.2, 0.9],
    [0.0, 1.2, 0.4],
]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Frames drawn four times as large and reduced: a ball before a plain floor and wall, with noise."""
    file = tmp_path_factory.mktemp("clip") / "throw.mp4"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), 1.0 / FRAME, (WIDTH, HEIGHT))
    rng = np.random.default_rng(4)
    for place in PATH:
        image = np.full((4 * HEIGHT, 4 * WIDTH, 3), 170, dtype=np.uint8)
        image[2 * HEIGHT :] = 120
        depth = CAMERA.to_camera(place)[2]
        centre, radius = CAMERA.project(place) * 4 + 1.5, 4 * CAMERA.intrinsics[0][0] * BALL.radius / depth
        at = tuple(int(v) for v in np.round(centre * 16))
        cv2.circle(image, at, round(radius * 16), (40, 40, 200), -1, cv2.LINE_AA, 4)
        small = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(float)
        writer.write(np.clip(small + rng.normal(0.0, 1.5, small.shape), 0, 255).astype(np.uint8))
    writer.release()
    return str(file)


@pytest.fixture(scope="module")
def modelled(clip: str) -> tuple[Session, dict[str, Any]]:
    """A session in which the throw was modelled, and the result."""
    session = Session(Path(clip).with_name("atw.db"))
    points = [{"world": place, "pixel": CAMERA.project(np.array(place)).tolist()} for place in PLACES]
    return session, session("ModelVideo", video=clip, objects=[{**KNOWN, "color": "red"}], points=points,
                            patience_seconds=300)  # fmt: skip


def test_a_thrown_ball_is_followed_through_the_air_and_its_rebound_is_found(
    modelled: tuple[Session, dict[str, Any]],
) -> None:
    session, made = modelled
    data = made["data"]
    assert data["verdict"] in ("good", "doubtful")
    built = next(step for step in data["steps"] if step["tool"] == "BuildWorld")
    assumed = session("ReadEvidence", evidence=built["evidence"])["data"]["assumed"]
    assert any("ball leaves the floor (in free flight in frames 0.." in text for text in assumed)
    session("CommitWorld", case=made["case"], world=data["world"])
    rolled = session("Rollout", case=made["case"], horizon_frames=29)["data"]
    (row,) = rolled["objects"]
    np.testing.assert_allclose(row["start"], PATH[0], atol=0.04)
    np.testing.assert_allclose(row["end"], PATH[29], atol=0.04)
    bounces = [event["time"] for event in rolled["timeline"] if event["what"] == "collision"]
    low = [t * FRAME for t in range(1, 29) if PATH[t, 2] < min(PATH[t - 1, 2], PATH[t + 1, 2])]
    assert len(bounces) == len(low)
    np.testing.assert_allclose(bounces, low, atol=FRAME)
    world = session("InspectWorld", case=made["case"], fields=["parameters"])["data"]
    found = {item["name"]: item["parameters"]["restitution"]["value"] for item in world["objects"]}
    assert found["ball"] == pytest.approx(RESTITUTION, abs=0.08)


def test_a_velocity_given_for_an_object_that_is_tracked_is_said_not_to_be_used(
    modelled: tuple[Session, dict[str, Any]],
) -> None:
    session, made = modelled
    built = session("BuildWorld", case=made["case"], objects=[{**KNOWN, "velocity": [9.0, 0.0, 0.0]}])["data"]
    assert "velocity given for ball: not used, it begins as its track does" in built["assumed"]
    np.testing.assert_allclose(built["objects"][0]["velocity"], [1.5, -0.3, 1.2], atol=0.4)
    assert (built["representation"], built["objects"][0]["position"][2]) == ("spatial", pytest.approx(0.7, abs=0.1))
