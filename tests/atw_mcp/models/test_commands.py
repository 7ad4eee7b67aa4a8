"""Poses and meshes from commands whose output is known."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from atw_mcp.models import Limits, ModelError, PredictedMasks, Provenance, meshes, open_folder, poses
from atw_mcp.models.folders import ModelFolder
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Frames, PerceptionCancelled, load
from polyworld.world.camera import Camera
from polyworld.world.shapes import Box
from tests.atw_mcp.models import tiny
from tests.atw_mcp.perception.clips import Disc, render

CUBE = {"ball": Box(half_extents=(0.05, 0.05, 0.05))}
CAMERA = Camera(
    width=240,
    height=160,
    intrinsics=((200.0, 0.0, 119.5), (0.0, 200.0, 79.5), (0.0, 0.0, 1.0)),
    rotation=((1.0, 0.0, 0.0), (0.0, -0.6, -0.8), (0.0, 0.8, -0.6)),
    translation=(0.1, -0.2, 2.0),
)


@pytest.fixture
def seen(tmp_path: Path) -> tuple[ImageObservation, Frames]:
    clip = render(tmp_path / "clip.mp4", [Disc(lambda t: (60.0 + 5 * t, 80.0), 12.0, (40, 40, 200))], 8)
    info, frames = load(clip.path)
    model = ModelFolder("recorded", tmp_path, "segmentation", "sam2_video", "unknown", 0)
    made = PredictedMasks({"ball": clip.truth[0]}, {"ball": np.ones(8)}, Provenance(model, "cpu", 1))
    return made.observation(info, frames, tuple(range(8))), frames


def test_poses_in_camera_axes_become_tracks_in_the_world(tmp_path: Path, seen: tuple[ImageObservation, Frames]) -> None:
    positions = np.stack([0.02 * np.arange(8), np.full(8, 0.3), np.full(8, 0.05)], axis=1)
    turned = Rotation.from_rotvec(np.outer(np.arange(8) * 0.3, [0.2, 0.1, 1.0]))
    entries = []
    for t in (0, 1, 2, 4, 5, 7):
        pose = np.eye(4)
        pose[:3, :3] = np.asarray(CAMERA.rotation) @ turned[t].as_matrix()
        pose[:3, 3] = CAMERA.to_camera(positions[t])
        entries.append({"frame": t, "pose": pose.tolist(), "confidence": 0.8, "sigma": 0.004})
    script = f"""
assert request["task"] == "pose" and request["objects"] == ["ball"] and request["intrinsics"][0][0] == 200.0
assert len(list((source / "frames").iterdir())) == 8 and len(list((source / "masks" / "ball").iterdir())) == 8
assert (source / "meshes" / "ball.ply").stat().st_size > 0
(target / "poses.json").write_text(json.dumps({{"objects": {{"ball": {json.dumps(entries)}}}}}))
"""
    model = open_folder(tiny.command(tmp_path / "pose", "pose", script))
    tracks = poses(model, *seen, CAMERA, CUBE, 0.02, Limits())
    rows = [0, 1, 2, 4, 5, 7]
    assert np.abs(tracks.positions[rows, 0] - positions[rows]).max() < 1e-9
    found = Rotation.from_quat(tracks.orientations[rows, 0][:, [1, 2, 3, 0]])
    assert (found * turned[rows].inv()).magnitude().max() < 1e-9
    assert (np.diff(tracks.orientations[rows, 0], axis=0) ** 2).sum(axis=1).max() < 1.0  # no flips of sign
    assert tracks.confidence[:, 0].tolist() == [0.8, 0.8, 0.8, 0.0, 0.8, 0.8, 0.0, 0.8]
    assert tracks.position_sigma[0, 0] == pytest.approx(0.004)


@pytest.mark.parametrize(
    ("written", "text"),
    [
        ({"objects": {"cup": []}}, "it was asked for"),
        ({"objects": {"ball": [{"frame": 0, "pose": np.diag([2.0, 1, 1, 1]).tolist()}]}}, "not a rotation"),
        ({"objects": {"ball": [{"frame": 0, "pose": [1.0]}]}}, "4 x 4"),
        ({"objects": {"ball": [{"frame": 99, "pose": np.eye(4).tolist()}]}}, "frame 99"),
        ([], "must be"),
    ],
)
def test_wrong_poses_are_refused(
    tmp_path: Path, seen: tuple[ImageObservation, Frames], written: object, text: str
) -> None:
    script = f"(target / 'poses.json').write_text({json.dumps(json.dumps(written))})\n"
    model = open_folder(tiny.command(tmp_path / "pose", "pose", script))
    with pytest.raises(ValueError, match=text):
        poses(model, *seen, CAMERA, CUBE, 0.02, Limits())


def test_a_command_that_fails_says_its_last_words(tmp_path: Path, seen: tuple[ImageObservation, Frames]) -> None:
    model = open_folder(tiny.command(tmp_path / "pose", "pose", "sys.exit('no weights at weights.pth')\n"))
    with pytest.raises(ModelError, match=r"ended with 1: no weights at weights\.pth"):
        poses(model, *seen, CAMERA, CUBE, 0.02, Limits())
    silent = open_folder(tiny.command(tmp_path / "silent", "pose", "\n"))
    with pytest.raises(ModelError, match=r"wrote no poses\.json"):
        poses(silent, *seen, CAMERA, CUBE, 0.02, Limits())


def test_a_command_is_stopped_on_time_and_on_request(tmp_path: Path, seen: tuple[ImageObservation, Frames]) -> None:
    script = "import time\ntime.sleep(60)\n"
    model = open_folder(tiny.command(tmp_path / "pose", "pose", script, timeout_seconds=1))
    begin = time.monotonic()
    with pytest.raises(ModelError, match="longer than 1 s"):
        poses(model, *seen, CAMERA, CUBE, 0.02, Limits())
    with pytest.raises(PerceptionCancelled):
        poses(model, *seen, CAMERA, CUBE, 0.02, Limits(), cancelled=lambda: True)
    assert time.monotonic() - begin < 20


MESH = """
import shutil
assert request["best_frames"]["ball"] in request["frames"]
(target / "ball.obj").write_text("v 0 0 0\\nv 2 0 0\\nv 0 1 0\\nv 0 0 1\\nf 1 3 2\\nf 1 2 4\\nf 2 3 4\\nf 1 4 3\\n")
"""


def test_a_mesh_takes_its_size_from_what_is_known(tmp_path: Path, seen: tuple[ImageObservation, Frames]) -> None:
    for name, scale in (("scaled", 0.01), ("free", None)):
        entry = {"objects": {"ball": {"file": "ball.obj", "metres_per_unit": scale}}}
        script = MESH + f"(target / 'meshes.json').write_text({json.dumps(json.dumps(entry))})\n"
        tiny.command(tmp_path / name, "mesh", script)
    scaled, free = (open_folder(tmp_path / name) for name in ("scaled", "free"))
    own = meshes(scaled, *seen, ["ball"], {}, 0.02, Limits())["ball"]
    assert np.ptp(own.mesh.vertices, axis=0) == pytest.approx([0.02, 0.01, 0.01])
    assert own.mesh.watertight
    given = meshes(free, *seen, ["ball"], {"ball": 0.1}, 0.02, Limits())["ball"]
    assert np.ptp(given.mesh.vertices, axis=0) == pytest.approx([0.1, 0.05, 0.05])
    assert "0.1 m" in given.scale_from
    with pytest.raises(ModelError, match="does not know the size of ball"):
        meshes(free, *seen, ["ball"], {}, 0.02, Limits())


def test_a_mesh_outside_the_output_is_refused(tmp_path: Path, seen: tuple[ImageObservation, Frames]) -> None:
    entry = {"objects": {"ball": {"file": "../ball.obj", "metres_per_unit": 1.0}}}
    script = f"(target / 'meshes.json').write_text({json.dumps(json.dumps(entry))})\n"
    model = open_folder(tiny.command(tmp_path / "mesh", "mesh", script))
    with pytest.raises(ModelError, match="must lie in OUTPUT"):
        meshes(model, *seen, ["ball"], {}, 0.02, Limits())
