"""Known objects looked for through the tools, in a clip of a ball that a post hides in part; the post is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.atw_mcp.perception.test_known import AROUND, RADIUS, from_the_side, past_the_post
from tests.atw_mcp.session import Session


def test_a_ball_behind_a_post_is_found_with_the_post_given(session: Session, tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    past_the_post(path, np.linspace(-0.6, 0.6, 24))
    case = session("OpenCase", video=str(path))["case"]
    places = np.concatenate([AROUND, [[0.0, 0.5, 0.0], [-0.5, 0.0, 0.5], [0.5, 0.3, 0.4], [0.1, -0.4, 0.0]]])
    pixels = from_the_side().project(places)
    points = [{"world": w.tolist(), "pixel": p.tolist()} for w, p in zip(places, pixels, strict=True)]
    session("CalibrateCamera", case=case, points=points)
    ball = {"name": "ball", "color": "red", "shape": {"kind": "sphere", "radius": RADIUS}}
    post = {"name": "post", "shape": {"kind": "box", "half_extents": [0.15, 0.05, 0.4]}, "position": [0.0, -0.3, 0.4]}
    seen = session("ObserveObjects", case=case, known=[ball], obstacles=[post], patience_seconds=60)
    (found,) = seen["data"]["objects"]
    assert found["name"] == "ball"
    assert found["frames"]["hidden"] >= 1
    assert found["frames"]["visible"] >= 15


def test_an_obstacle_that_is_no_solid_is_named(session: Session, tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    past_the_post(path, np.linspace(-0.6, 0.6, 4))
    case = session("OpenCase", video=str(path))["case"]
    pixels = from_the_side().project(AROUND)
    points = [{"world": w.tolist(), "pixel": p.tolist()} for w, p in zip(AROUND, pixels, strict=True)]
    session("CalibrateCamera", case=case, points=points)
    ball = {"name": "ball", "color": "red", "shape": {"kind": "sphere", "radius": RADIUS}}
    post = {"name": "post", "shape": {"kind": "mesh", "mesh": "obs-0"}, "position": [0.0, -0.3, 0.4]}
    assert "obs-0" in session.refused("ObserveObjects", case=case, known=[ball], obstacles=[post])
