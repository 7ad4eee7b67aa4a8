"""Points followed by an exported program of known motion, and the rotations that follow from points."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from atw_mcp.models import Limits, ModelError, PredictedPoints, Provenance, Query, follow_points, open_folder, rotations
from atw_mcp.models.folders import ModelFolder
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.shapes import Box, Sphere
from tests.atw_mcp.models import tiny

CPU = Limits("cpu", 4)


def exported(folder: Path, size: tuple[int, int, int], points: int) -> ModelFolder:
    """A tracker that follows the brightest column: every point moves with it. Window, height, width; points."""
    torch, _ = tiny.libraries()

    class Column(torch.nn.Module):
        def forward(self, video, queries):
            place = video[0].mean(dim=(1, 2)).argmax(dim=1).float()  # (T,) column of the bar
            at = queries[0, :, 0].long().clamp(0, video.shape[1] - 1)
            moved = place[:, None] - place[at][None]
            x = queries[0, :, 1][None] + moved
            y = queries[0, :, 2][None].expand(video.shape[1], -1)
            return torch.stack([x, y], dim=-1)[None], (x < video.shape[4])[None]

    count, height, width = size
    arguments = (torch.zeros(1, count, 3, height, width), torch.zeros(1, points, 3))
    folder.mkdir()
    torch.export.save(torch.export.export(Column(), arguments), str(folder / "tracker.pt2"))
    (folder / "model.json").write_text(json.dumps({"task": "points", "program": "tracker.pt2", "license": "mit"}))
    return open_folder(folder)


def bar(count: int, speed: int, width: int = 64) -> np.ndarray:
    frames = np.zeros((count, 32, width, 3), np.uint8)
    for t in range(count):
        frames[t, :, 8 + speed * t] = 255
    return frames


def test_windows_and_groups_of_fixed_size_join_to_whole_tracks(tmp_path: Path) -> None:
    model = exported(tmp_path / "tracker", (6, 32, 64), points=2)
    queries = [Query("a", 0, 8.0, 5.0), Query("a", 9, 30.0, 10.0), Query("b", 19, 12.0, 20.0)]
    found = follow_points(model, bar(20, 2), queries, CPU)
    t = np.arange(20)
    for k, query in enumerate(queries):
        assert found.pixels[:, k, 0] == pytest.approx(query.x + 2.0 * (t - query.row), abs=1e-3)
        assert found.pixels[:, k, 1] == pytest.approx(np.full(20, query.y), abs=1e-3)
    assert found.visible[9, 1]
    assert not found.visible[-1, 0] or found.pixels[-1, 0, 0] < 64
    assert found.provenance.to_dict()["licence"] == "mit"


def test_frames_of_another_size_are_brought_to_the_programs_and_back(tmp_path: Path) -> None:
    model = exported(tmp_path / "tracker", (8, 16, 32), points=1)
    frames = np.repeat(np.repeat(bar(8, 2, 32)[:, :16], 2, axis=1), 2, axis=2)  # twice as large, 4 px a frame
    found = follow_points(model, frames, [Query("a", 0, 20.0, 11.0)], CPU)
    assert found.pixels[:, 0, 0] == pytest.approx(20.0 + 4.0 * np.arange(8), abs=1e-3)
    assert found.pixels[:, 0, 1] == pytest.approx(11.0, abs=1e-3)


def test_a_program_with_other_inputs_is_refused(tmp_path: Path) -> None:
    torch, _ = tiny.libraries()
    folder = tmp_path / "wrong"
    folder.mkdir()
    torch.export.save(torch.export.export(torch.nn.Linear(3, 3), (torch.zeros(1, 3),)), str(folder / "model.pt2"))
    (folder / "model.json").write_text(json.dumps({"task": "points"}))
    with pytest.raises(ModelError, match=r"takes video \(1, T, 3, H, W\)"):
        follow_points(open_folder(folder), bar(4, 1), [Query("a", 0, 1.0, 1.0)], CPU)
    (folder / "model.pt2").unlink()
    with pytest.raises(ModelError, match=r"no file model\.pt2"):
        follow_points(open_folder(folder), bar(4, 1), [Query("a", 0, 1.0, 1.0)], CPU)


CAMERA = Camera(
    width=640,
    height=480,
    intrinsics=((800.0, 0.0, 319.5), (0.0, 800.0, 239.5), (0.0, 0.0, 1.0)),
    rotation=((1.0, 0.0, 0.0), (0.0, -0.6, -0.8), (0.0, 0.8, -0.6)),
    translation=(0.0, 0.0, 3.0),
)


def moving(positions: np.ndarray, orientations: np.ndarray | None = None) -> ObservedTracks:
    count = len(positions)
    turned = np.full((count, 1, 4), np.nan) if orientations is None else orientations[:, None]
    return ObservedTracks(
        names=("body",),
        frames=np.arange(count),
        seconds_per_frame=0.02,
        positions=positions[:, None],
        position_sigma=np.full((count, 1), 0.001),
        orientations=turned,
        confidence=np.ones((count, 1)),
        orientation_confidence=np.where(np.isfinite(turned).all(axis=2), 1.0, 0.0),
        symmetry=(0,),
    )


def followed(world: np.ndarray, visible: np.ndarray, noise: float) -> PredictedPoints:
    """World points (T, n, 3) as a tracker would give them."""
    pixels = CAMERA.project(world) + np.random.default_rng(5).normal(0, noise, (*world.shape[:2], 2))
    queries = tuple(Query("body", 0, 0.0, 0.0) for _ in range(world.shape[1]))
    model = ModelFolder("recorded", Path(), "points", "program", "unknown", 0)
    return PredictedPoints(queries, pixels, visible, Provenance(model, "cpu", 1))


def angle_between(found: np.ndarray, truth: Rotation) -> np.ndarray:
    """Angle (T,) between orientations and the truth, both counted from the first frame [rad]."""
    turned = Rotation.from_quat(found[:, [1, 2, 3, 0]])
    relative = (turned * turned[0].inv()) * (truth * truth[0].inv()).inv()
    return np.asarray(relative.magnitude())


def test_a_rolling_balls_rotation_is_measured_through_whole_turns() -> None:
    radius, t = 0.1, np.arange(120)
    positions = np.stack([-0.6 + 0.01 * t, 0.002 * t, np.full(120, radius)], axis=1)
    axis = np.array([-0.002, 0.01, 0.0]) / radius  # rolling: omega = n x v / r, per frame
    truth = Rotation.from_rotvec(t[:, None] * axis)
    assert np.linalg.norm(axis) * 120 > 2 * np.pi * 1.5
    marks = np.random.default_rng(2).normal(size=(60, 3))
    marks /= np.linalg.norm(marks, axis=1, keepdims=True)
    offsets = np.stack([truth[k].apply(marks) for k in range(120)])
    world = positions[:, None] + radius * offsets
    facing = (offsets * (CAMERA.centre - world)).sum(axis=2) > 0.15 * np.linalg.norm(CAMERA.centre - world, axis=2)
    tracks = rotations(
        followed(world, facing, 0.3), moving(positions), CAMERA, {"body": Sphere(radius=radius)}, MotionPlane()
    )
    assert (tracks.orientation_confidence[:, 0] > 0.5).all()
    assert tracks.symmetry == (1,)
    error = angle_between(tracks.orientations[:, 0], truth)
    assert error.max() < 0.1
    spin = np.degrees(error[-1]) / (np.degrees(np.linalg.norm(axis)) * 119)
    assert spin < 0.01


def test_points_that_slip_do_not_turn_the_body() -> None:
    count = 30
    positions = np.tile([0.0, 0.0, 0.1], (count, 1))
    truth = Rotation.from_rotvec(np.outer(np.arange(count) * 0.04, [0, 0, 1.0]))
    towards = (CAMERA.centre - positions[0]) / np.linalg.norm(CAMERA.centre - positions[0])
    marks = towards + np.random.default_rng(2).normal(0, 0.25, size=(40, 3))  # all face the camera throughout
    marks /= np.linalg.norm(marks, axis=1, keepdims=True)
    world = positions[:, None] + 0.1 * np.stack(
        [(truth[k] * truth[count // 2].inv()).apply(marks) for k in range(count)]
    )
    world[:, :10] = world[:1, :10]  # a quarter stays behind on the background
    visible = ((world - positions[:, None]) @ towards) > 0.02
    tracks = rotations(
        followed(world, visible, 0.1), moving(positions), CAMERA, {"body": Sphere(radius=0.1)}, MotionPlane()
    )
    assert visible.mean() > 0.9
    assert angle_between(tracks.orientations[:, 0], truth).max() < 0.03


def test_a_boxs_turn_about_the_normal_continues_its_first_orientation() -> None:
    count = 25
    positions = np.stack([0.01 * np.arange(count), np.zeros(count), np.full(count, 0.05)], axis=1)
    start = Rotation.from_rotvec([0, 0, 0.4])
    truth = Rotation.from_rotvec(np.outer(np.arange(count) * 0.05, [0, 0, 1.0])) * start
    known = np.full((count, 4), np.nan)
    known[0] = start.as_quat()[[3, 0, 1, 2]]
    marks = np.column_stack([np.random.default_rng(2).uniform(-0.05, 0.05, (20, 2)), np.zeros(20)])
    world = positions[:, None] + np.stack([truth[k].apply(marks) for k in range(count)])
    shape = Box(half_extents=(0.05, 0.05, 0.05))
    tracks = rotations(
        followed(world, np.ones((count, 20), bool), 0.1), moving(positions, known), CAMERA, {"body": shape},
        MotionPlane(),
    )  # fmt: skip
    found = Rotation.from_quat(tracks.orientations[:, 0][:, [1, 2, 3, 0]])
    assert (found * truth.inv()).magnitude().max() < 0.02
