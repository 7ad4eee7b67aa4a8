"""Metric depth and focal lengths, and the camera over a floor that follows from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from atw_mcp.models import Limits, ModelError, camera_over_floor, open_folder, predict_depth
from atw_mcp.models.depth import _in_metres
from atw_mcp.perception.calibration import CalibrationError
from atw_mcp.perception.import_images import DepthMaps
from polyworld.world.camera import Camera
from tests.atw_mcp.models import tiny

FRAMES = np.random.default_rng(1).integers(0, 256, (5, 60, 80, 3), dtype=np.uint8)


def test_depth_anything_gives_metres_in_the_videos_size(tmp_path: Path) -> None:
    model = open_folder(tiny.depth_anything(tmp_path / "depth"))
    found = predict_depth(model, FRAMES, range(0, 10, 2), Limits("cpu", 2))
    assert found.depth.depth.shape == (5, 60, 80)
    assert found.depth.frames == (0, 2, 4, 6, 8)
    assert np.nanmax(found.depth.depth) <= 20.001  # the metric head ends in max_depth times a sigmoid
    assert found.focal is None


def test_relative_depth_is_refused(tmp_path: Path) -> None:
    path = tiny.depth_anything(tmp_path / "depth", kind="relative")
    with pytest.raises(ModelError, match="unknown scale and shift"):
        open_folder(path)


def test_depth_pro_gives_a_focal_length_for_each_frame(tmp_path: Path) -> None:
    model = open_folder(tiny.depth_pro(tmp_path / "depth"))
    found = predict_depth(model, FRAMES, range(5), Limits("cpu", 2))
    assert found.depth.depth.shape == (5, 60, 80)
    assert found.focal is not None
    assert found.focal.shape == (5,)
    single = predict_depth(model, FRAMES, range(5), Limits("cpu", 1))
    assert np.allclose(single.focal, found.focal, rtol=1e-4)


def test_a_recorded_output_of_depth_pro_becomes_metres() -> None:
    torch, transformers = tiny.libraries()
    # A wall 4 m away under a field of view of 60 degrees: f = W / (2 tan 30), inverse depth c with f / (W c) = 4 m.
    focal = 80 / (2 * np.tan(np.pi / 6))
    output = transformers.models.depth_pro.modeling_depth_pro.DepthProDepthEstimatorOutput(
        predicted_depth=torch.full((1, 24, 32), focal / (80 * 4.0)), field_of_view=torch.tensor([60.0])
    )
    depth, found = _in_metres(torch, "depth_pro", output, (60, 80))
    assert float(found[0]) == pytest.approx(focal, rel=1e-5)
    assert depth.shape == (1, 60, 80)
    assert np.allclose(depth.numpy(), 4.0, rtol=1e-4)


def looking_down(tilt: float, height: float, focal: float = 300.0) -> Camera:
    """A camera above the origin's neighbourhood that looks along +y and down by `tilt` [rad]."""
    s, c = np.sin(tilt), np.cos(tilt)
    rotation = np.array([[1.0, 0, 0], [0, -s, -c], [0, c, -s]])
    centre = np.array([0.3, -2.0, height])
    matrix = ((focal, 0.0, 159.5), (0.0, focal, 119.5), (0.0, 0.0, 1.0))
    return Camera(
        width=320, height=240, intrinsics=matrix, rotation=rotation.tolist(), translation=(-rotation @ centre).tolist()
    )


def floor_depth(camera: Camera, noise: float) -> DepthMaps:
    """Depth of z = 0 with relative noise, of three frames; 30% of the pixels belong to something else."""
    rng = np.random.default_rng(3)
    v, u = np.mgrid[0:240, 0:320]
    points = camera.onto_plane(np.stack([u, v], axis=-1).astype(float), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    depth = camera.to_camera(points)[..., 2]
    depth[60:150, 20:270] *= 0.8
    maps = depth * (1 + rng.normal(0, noise, (3, 240, 320)))
    return DepthMaps(np.where(maps > 0, maps, np.nan).astype(np.float32), (0, 1, 2))


def test_the_camera_over_a_floor_is_found_from_depth_alone() -> None:
    truth = looking_down(tilt=np.radians(40.0), height=1.7)
    made = camera_over_floor(floor_depth(truth, 0.005), 300.0)
    assert made.camera.centre[2] == pytest.approx(1.7, rel=0.01)
    # Where two world axes are free, lengths between points of the floor are not.
    pixels = np.array([[60.0, 200.0], [250.0, 180.0]])
    apart = [
        np.linalg.norm(np.diff(c.onto_plane(pixels, np.zeros(3), np.array([0.0, 0.0, 1.0])), axis=0))
        for c in (truth, made.camera)
    ]
    assert apart[1] == pytest.approx(apart[0], rel=0.02)
    middle = made.camera.project(np.zeros(3))
    assert np.abs(middle - [159.5, 119.5]).max() < 3.0  # the origin is where the image's centre looks
    forward = made.camera.project(np.array([0.0, 0.5, 0.0]))
    assert forward[1] < middle[1]
    assert abs(forward[0] - middle[0]) < 2.0
    assert any("scale" in text for text in made.warnings)


def test_a_view_without_a_plane_gives_no_camera() -> None:
    rng = np.random.default_rng(0)
    cloud = DepthMaps(rng.uniform(1.0, 9.0, (1, 240, 320)).astype(np.float32), (0,))
    with pytest.raises(CalibrationError, match="no plane takes a quarter"):
        camera_over_floor(cloud, 300.0)
