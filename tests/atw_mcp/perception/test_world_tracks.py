"""Positions in the world from masks: against geometry, an independent simulator's render, and CLEVRER."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from atw_mcp.perception.calibration import calibrate_from_known_length
from atw_mcp.perception.eye import Solid
from atw_mcp.perception.import_images import import_camera
from atw_mcp.perception.import_tracks import import_tracks
from atw_mcp.perception.observation import ObservationError
from atw_mcp.perception.observe import observe
from atw_mcp.perception.tracks import estimate_sizes, world_tracks
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.shapes import Sphere
from tests.atw_mcp.perception.clips import HEIGHT, WIDTH, Disc, render

ROOT = Path(__file__).parents[3]
CLEVRER = ROOT.parent / "shared" / "data" / "clevrer"
DEMO = ROOT / "atw_mcp" / "demo"


def quarter_turn_error(quaternions: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Error [deg] of a cube's turn about z, up to quarter turns."""
    found = 2 * np.arctan2(quaternions[:, 3], quaternions[:, 0])
    error = found - yaw
    return np.degrees(np.abs(error - np.pi / 2 * np.round(error / (np.pi / 2))))


def hull_distance(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Signed distance, positive outside, of points from the convex hull of pixels, by OpenCV."""
    hull = cv2.convexHull(corners.astype(np.float32))
    return np.array([-cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in points])


def demo_camera() -> Camera:
    return Camera.model_validate(json.loads((DEMO / "collision.json").read_text())["camera"])


def test_outlines_agree_with_dense_projected_surfaces() -> None:
    camera, pose = demo_camera(), np.array([0.1, 0.05, 0.4, 0.0])
    rng = np.random.default_rng(0)
    c, s = np.cos(0.4), np.sin(0.4)
    direction = rng.normal(size=(20000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, 2000)
    ring = np.stack([0.06 * np.cos(angle), 0.06 * np.sin(angle), np.zeros(2000)], axis=1)
    lift_up = np.array([0, 0, 0.04])
    corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * 0.05
    turned = corners @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    surfaces: list[tuple[Any, tuple[float, float, float], np.ndarray]] = [
        ("sphere", (0.06, 0.06, 0.06), 0.06 * direction),
        ("cylinder", (0.06, 0.06, 0.04), np.concatenate([ring + lift_up, ring - lift_up])),
        ("box", (0.05, 0.05, 0.05), turned),
    ]
    for kind, half, surface in surfaces:
        projected = camera.project(surface + np.array([0.1, 0.05, half[2]]))
        found = Solid("body", kind, half, camera).polygon(pose)
        assert np.abs(hull_distance(projected, found)).max() < 0.15, kind
        assert hull_distance(found, projected).max() < 0.15, kind


def test_bouncing_ball_from_the_side_is_measured_in_metres(tmp_path: Path) -> None:
    """A ball in a vertical plane; 200 px are 2 m: the ball's radius of 10 px is 0.1 m."""

    def centre(t: int) -> tuple[float, float]:
        return 20 + 4.0 * t, 140 - abs(90 * np.sin(t * 0.1 + 0.2))

    clip = render(tmp_path / "a.mp4", [Disc(centre, 10, (40, 40, 170))], 44)
    camera = calibrate_from_known_length((20, 150), (220, 150), 2.0, (WIDTH, HEIGHT), view="side").camera
    plane = MotionPlane(normal=(0.0, -1.0, 0.0), supports=False)
    observation = observe(clip.path)
    sizes = estimate_sizes(observation, camera, plane)
    solid = next(iter(sizes.values())).solid
    assert isinstance(solid, Sphere)
    assert solid.radius == pytest.approx(0.1, rel=0.04)
    tracks = world_tracks(observation, camera, {observation.names[0]: solid}, plane, seconds_per_frame=0.02)
    expected = np.array([((x) / 100, (HEIGHT - 1 - y) / 100) for x, y in map(centre, range(44))])
    error = tracks.positions[:, 0][:, [0, 2]] - expected
    assert np.median(np.abs(error)) < 0.004
    assert np.abs(error).max() < 0.012
    assert np.allclose(tracks.positions[:, 0, 1], 0, atol=1e-9)
    assert np.all(tracks.confidence[:, 0] > 0.5)
    other = calibrate_from_known_length((0, 0), (10, 0), 1.0, (100, 100)).camera
    with pytest.raises(ObservationError, match=f"{WIDTH} x {HEIGHT}"):
        world_tracks(observation, other, seconds_per_frame=0.1)
    with pytest.raises(ObservationError, match="unknown object 'ball'"):
        world_tracks(observation, camera, {"ball": solid}, plane, seconds_per_frame=0.1)


def by_position(tracks: ObservedTracks, truth: np.ndarray) -> list[int]:
    """For each track the true object nearest to it."""
    distance = np.linalg.norm(tracks.positions[:, :, None, :2] - truth[:, None, :, :2], axis=-1)
    return [int(j) for j in np.nanargmin(np.nanmedian(distance, axis=0), axis=1)]


@pytest.mark.benchmark  # the default run models the same video in fitting/test_model_video.py
def test_official_clevrer_video_is_tracked_to_centimetres() -> None:
    scene = "02000"
    if not (CLEVRER / f"video_{scene}.mp4").exists():
        pytest.skip("shared CLEVRER data not found beside the repository")
    observation = observe(CLEVRER / f"video_{scene}.mp4")
    camera = import_camera(CLEVRER / "camera_homography_z0.2.json", (480, 320))
    truth = import_tracks(CLEVRER / f"annotation_{scene}.json")
    visible = truth.confidence == 1.0  # inside the camera's view
    tracks = world_tracks(observation, camera, seconds_per_frame=0.028)
    nearest = by_position(tracks, truth.positions)
    assert sorted(nearest) == list(range(len(truth.names)))
    errors = []
    for k, j in enumerate(nearest):
        observed = observation.objects[k]
        assert truth.names[j] == f"{observed.colour.name}_{observed.material.name}_{observed.shape.name}"
        seen = (tracks.confidence[:, k] > 0) & visible[:, j]
        assert seen.sum() > 0.8 * visible[:, j].sum()
        distance = np.linalg.norm(tracks.positions[seen, k, None, :2] - truth.positions[seen][:, :, :2], axis=2)
        assert np.all(np.argmin(distance, axis=1) == j), "identity swap"
        errors += distance[:, j].tolist()
        if tracks.symmetry[k] == 4:
            turn = truth.orientations[:, j]
            yaw = 2 * np.arctan2(turn[:, 3], turn[:, 0])
            assert np.median(quarter_turn_error(tracks.orientations[seen, k], yaw[seen])) < 3.0
    assert np.median(errors) < 0.03
    assert np.percentile(errors, 95) < 0.06
