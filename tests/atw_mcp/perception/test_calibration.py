"""Cameras are recovered from exact and noisy projections, and degenerate input is refused with what is needed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from atw_mcp.perception.calibration import (
    CalibrationError,
    calibrate_from_homography,
    calibrate_from_known_length,
    calibrate_from_points,
    calibrate_given,
)
from polyworld.world.camera import Camera

SIZE = (480, 320)


def tilted_camera(focal: float = 525.0) -> Camera:
    """Above the floor, looking down at it and a little aside."""
    turn = Rotation.from_euler("xz", [122, 20], degrees=True).as_matrix()
    centre = turn.T @ np.array([0.1, -0.2, -6.0])
    t = -turn @ centre
    return Camera(
        width=SIZE[0],
        height=SIZE[1],
        intrinsics=((focal, 0.0, 239.5), (0.0, focal, 159.5), (0.0, 0.0, 1.0)),
        rotation=tuple(tuple(float(v) for v in row) for row in turn),
        translation=tuple(float(v) for v in t),
    )


FLOOR = np.array([(x, y, 0.0) for x in (-1.5, 0.0, 1.5) for y in (-1.0, 0.0, 1.0)])
SPACE = np.concatenate([FLOOR, FLOOR[::2] + np.array([0.1, 0.2, 0.8])])


@pytest.mark.parametrize("points", [FLOOR, FLOOR + np.array([0.3, -0.2, 0.2]), SPACE])
def test_exact_points_give_back_the_camera(points: np.ndarray) -> None:
    truth = tilted_camera()
    found = calibrate_from_points(points, truth.project(points), SIZE)
    assert found.rms is not None
    assert found.rms < 1e-4
    assert found.camera.intrinsics[0][0] == pytest.approx(525.0, rel=1e-4)
    assert np.allclose(found.camera.centre, truth.centre, atol=1e-3)
    probe = np.array([[0.4, -0.7, 0.5], [-1.0, 0.9, 0.2]])
    assert np.allclose(found.camera.project(probe), truth.project(probe), atol=0.02)


def test_half_a_pixel_of_noise_gives_half_a_pixel_of_error() -> None:
    truth = tilted_camera()
    rng = np.random.default_rng(4)
    pixels = truth.project(SPACE) + rng.normal(0, 0.5, (len(SPACE), 2))
    found = calibrate_from_points(SPACE, pixels, SIZE)
    assert found.rms is not None
    assert 0.2 < found.rms < 1.0
    assert len(found.errors) == len(SPACE)
    assert found.camera.intrinsics[0][0] == pytest.approx(525.0, rel=0.06)


def test_given_intrinsics_are_kept() -> None:
    truth = tilted_camera(700.0)
    four = SPACE[[0, 2, 6, 9]]
    found = calibrate_from_points(four, truth.project(four), SIZE, intrinsics=truth.intrinsics)
    assert found.camera.intrinsics == truth.intrinsics
    assert np.allclose(found.camera.centre, truth.centre, atol=1e-3)


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_homography_of_a_plane_gives_back_the_camera(height: float) -> None:
    truth = tilted_camera()
    k, r, t = np.array(truth.intrinsics), np.array(truth.rotation), np.array(truth.translation)
    matrix = k @ np.column_stack([r[:, 0], r[:, 1], r[:, 2] * height + t])
    for scale in (1.0, -3.7):  # a homography has no scale and no sign
        found = calibrate_from_homography(scale * matrix, SIZE, plane_z=height)
        assert found.camera.intrinsics[0][0] == pytest.approx(525.0, rel=1e-3)
        assert np.allclose(found.camera.centre, truth.centre, atol=5e-3)


@pytest.mark.parametrize(
    ("view", "point", "right", "up"),
    [
        ("side", (0.3, 0.0, 0.4), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ("top", (0.3, 0.4, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ],
)
def test_known_length_sets_the_scale_everywhere_in_the_plane(
    view: str, point: tuple[float, ...], right: tuple[float, ...], up: tuple[float, ...]
) -> None:
    camera = calibrate_from_known_length((100, 200), (300, 200), 0.5, SIZE, view=view).camera
    start = camera.project(np.array(point))
    assert np.allclose(camera.project(np.add(point, np.multiply(0.1, right))) - start, [40, 0], atol=1e-6)
    assert np.allclose(camera.project(np.add(point, np.multiply(0.1, up))) - start, [0, -40], atol=1e-6)
    # Half an object's depth of 0.1 m nearer the camera changes sizes by 2% at most.
    nearer = np.array(camera.centre) - np.array(point)
    nearer *= 0.1 / np.linalg.norm(nearer)
    stretched = camera.project(np.add(point, np.multiply(0.1, right)) + nearer) - camera.project(
        np.array(point) + nearer
    )
    assert stretched[0] == pytest.approx(40, rel=0.02)


def test_given_camera_is_returned_as_it_is() -> None:
    truth = tilted_camera()
    found = calibrate_given(truth.intrinsics, truth.rotation, truth.translation, SIZE)
    assert np.allclose(found.camera.project(FLOOR), truth.project(FLOOR))
    with pytest.raises(CalibrationError, match="orthonormal"):
        calibrate_given(truth.intrinsics, np.ones((3, 3)), truth.translation, SIZE)
    with pytest.raises(CalibrationError, match="fx, fy > 0"):
        calibrate_given(-np.eye(3), truth.rotation, truth.translation, SIZE)


def degenerate() -> list[tuple[np.ndarray, np.ndarray, str]]:
    truth = tilted_camera()
    line = np.array([(x, 2 * x, 0.0) for x in (-0.5, -0.2, 0.0, 0.3, 0.6)])
    three_in_line = np.array([(0, 0, 0), (0.5, 0, 0), (1, 0, 0), (0.2, 1, 0.0)])
    repeated = FLOOR[[0, 2, 6, 0]]
    few_in_space = SPACE[[0, 2, 6, 9, 11]]
    broken = FLOOR.copy()
    broken[3, 1] = np.nan
    turned = truth.project(FLOOR)[::-1]
    return [
        (line, truth.project(line), "one line"),
        (three_in_line, truth.project(three_in_line), "0, 1 and 2 lie in a line"),
        (repeated, truth.project(repeated), r"more than once, in rows \[0, 3\]"),
        (few_in_space, truth.project(few_in_space), "at least 6"),
        (FLOOR[:3], truth.project(FLOOR[:3]), "at least 4"),
        (broken, turned, "finite"),
        (FLOOR, truth.project(FLOOR)[:4], r"shape \(9, 2\)"),
        (FLOOR[:, :2], truth.project(FLOOR), r"\(k, 3\)"),
    ]


@pytest.mark.parametrize(("points", "pixels", "says"), degenerate())
def test_degenerate_points_are_refused_with_what_is_needed(points: np.ndarray, pixels: np.ndarray, says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        calibrate_from_points(points, pixels, SIZE)


def test_plane_seen_head_on_does_not_determine_the_focal_length() -> None:
    camera = calibrate_from_known_length((0, 0), (100, 0), 1.0, SIZE, view="top").camera
    with pytest.raises(CalibrationError, match="head-on"):
        calibrate_from_points(FLOOR, camera.project(FLOOR), SIZE)


def test_singular_homography_and_impossible_length_are_refused() -> None:
    with pytest.raises(CalibrationError, match="singular"):
        calibrate_from_homography(np.ones((3, 3)), SIZE)
    with pytest.raises(CalibrationError, match="positive"):
        calibrate_from_known_length((0, 0), (100, 0), 0.0, SIZE)
    with pytest.raises(CalibrationError, match="2 px apart"):
        calibrate_from_known_length((0, 0), (1, 0), 1.0, SIZE)
