"""Learned models through the tools: what is listed and refused, and what their results become."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atw_mcp.models import PredictedDepth, PredictedMasks, PredictedPoints, Prompt, Provenance
from atw_mcp.models.folders import ModelFolder
from atw_mcp.observation import model_runs
from atw_mcp.perception.import_images import DepthMaps
from tests.atw_mcp.clips import FRAMES, SIZE, write_clip
from tests.atw_mcp.models import tiny
from tests.atw_mcp.session import Session

LENGTH = {"first_pixel": [20, 60], "second_pixel": [120, 60], "length": 1.0, "view": "top"}  # 100 px are 1 m


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "models"
    folder.mkdir()
    monkeypatch.setenv("ATW_MODELS", str(folder))
    return folder


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(tmp_path / "store" / "atw.db")


@pytest.fixture
def case(session: Session, tmp_path: Path) -> str:
    return str(session("OpenCase", video=str(write_clip(tmp_path / "discs.mp4")))["case"])


def pretend(folder: Path, family: str, **config: Any) -> None:
    """A folder that looks like a model's, for runs whose output is recorded."""
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps({"model_type": family, "license": "apache-2.0", **config}))
    (folder / "model.safetensors").write_bytes(b"weights")


def disc(x: float, y: float) -> np.ndarray:
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    return np.hypot(u - x, v - y) <= 9.0


def recorded(model: ModelFolder, frames: np.ndarray, prompts: tuple[Prompt, ...], *_: Any, **__: Any) -> PredictedMasks:
    """True masks of the clip's two discs, by the colour under the prompt's box."""
    masks = {}
    for prompt in prompts:
        assert prompt.box is not None
        x = prompt.box[0] + prompt.box[2] / 2
        red = abs(x - (25 + 2 * prompt.row)) < abs(x - (135 - 2 * prompt.row))
        rows = range(len(frames))
        masks[prompt.object] = np.stack([disc(25 + 2 * t, 60) if red else disc(135 - 2 * t, 62) for t in rows])
    scores = {name: np.ones(len(frames)) for name in masks}
    return PredictedMasks(masks, scores, Provenance(model, "cpu", 4))


def test_without_models_the_list_says_how_to_add_one(session: Session, models: Path, case: str) -> None:
    listed = session("RunModel")
    assert listed["data"]["models"] == []
    assert str(models) in listed["summary"]
    text = session.refused("RunModel", model="sam2", case=case)
    assert "ATW_MODELS" in text
    assert "config.json" in text


def test_models_are_listed_with_task_and_licence(session: Session, models: Path) -> None:
    pretend(models / "sam2-tiny", "sam2_video")
    pretend(models / "other", "bert")
    listed = session("RunModel")["data"]
    assert [(m["model"], m["task"], m["licence"]) for m in listed["models"]] == [
        ("sam2-tiny", "segmentation", "apache-2.0")
    ]
    assert "bert" in listed["not_usable"][0]


def test_without_the_extra_the_refusal_says_what_to_install(
    session: Session, models: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(models / "sam2-tiny", "sam2_video")
    plain = importlib.import_module

    def absent(name: str, package: str | None = None) -> Any:
        if name in ("torch", "transformers"):
            raise ModuleNotFoundError(name)
        return plain(name, package)

    monkeypatch.setattr(importlib, "import_module", absent)
    prompts = [{"object": "red", "frame": 0, "box": [16, 51, 18, 18]}]
    result = session._call("RunModel", {"model": "sam2-tiny", "case": case, "prompts": prompts})
    assert result.is_error
    assert "pip install 'atw-mcp[models]'" in result.content[0].text


def test_masks_of_a_model_become_the_observation_that_worlds_are_built_from(
    session: Session, models: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(models / "sam2-tiny", "sam2_video")
    monkeypatch.setattr(model_runs, "follow", recorded)
    assert "prompts" in session.refused("RunModel", model="sam2-tiny", case=case)
    prompts = [
        {"object": "left", "frame": 0, "box": [16, 51, 18, 18]},
        {"object": "right", "frame": 4, "box": [118, 53, 18, 18]},
    ]
    run = session("RunModel", model="sam2-tiny", case=case, prompts=prompts)
    assert run["objects"] == ["left", "right"]
    assert "apache-2.0" in run["summary"]
    assert len(run["data"]["made_with"]["weights_sha256"]) == 64
    session("CalibrateCamera", case=case, known_length=LENGTH)
    ball = {"kind": "sphere", "radius": 0.09}
    built = session("BuildWorld", case=case, objects=[{"name": n, "shape": ball} for n in ("left", "right")])
    moving = {item["name"]: item["velocity"] for item in built["data"]["objects"]}
    assert moving["left"] == pytest.approx([0.5, 0.0, 0.0], abs=0.03)
    assert moving["right"] == pytest.approx([-0.5, 0.0, 0.0], abs=0.03)


def test_a_model_is_compared_with_what_was_observed_before(
    session: Session, models: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(models / "sam2-tiny", "sam2_video")
    monkeypatch.setattr(model_runs, "follow", recorded)
    before = session("ObserveObjects", case=case)
    report = session("RunModel", model="sam2-tiny", case=case, use="report")
    rows = report["data"]["agreement"]
    assert {row["second"] for row in rows} == set(before["objects"])
    assert all(row["mean_iou"] > 0.85 for row in rows)
    latest = [o for o in session("OpenCase", case=case)["data"]["observations"] if o["kind"] == "objects"]
    assert latest[0]["observation"] == before["source"]["observation"]
    joined = session("RunModel", model="sam2-tiny", case=case, use="agreement")
    assert joined["objects"] == report["objects"]
    latest = [o for o in session("OpenCase", case=case)["data"]["observations"] if o["kind"] == "objects"]
    assert latest[0]["observation"] == joined["source"]["observation"]


def test_a_tiny_model_runs_from_the_call_to_the_record(session: Session, models: Path, case: str) -> None:
    tiny.sam2(models / "sam2")
    prompts = [{"object": "red", "frame": 2, "box": [20, 51, 18, 18], "negative": [[100, 20]]}]
    run = session("RunModel", model="sam2", case=case, prompts=prompts, stride=2, patience_seconds=120)
    assert run["data"]["made_with"]["versions"]["torch"]
    assert run["data"]["made_with"]["licence"] == "unknown"
    again = session("RunModel", model="sam2", case=case, prompts=prompts, stride=2, patience_seconds=120)
    assert again["source"]["observation"] == run["source"]["observation"]
    odd = [{"object": "red", "frame": 3, "box": [20, 51, 18, 18]}]
    assert "multiples of 2" in session.refused("RunModel", model="sam2", case=case, prompts=odd, stride=2)


def test_depth_gives_a_case_its_camera_and_worlds_their_positions(
    session: Session, models: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(models / "depth", "depth_pro")
    focal, away = 200.0, 2.0  # straight down from 2 m: 100 px are 1 m on the floor, and the discs lie on it

    def flat(model: ModelFolder, frames: np.ndarray, numbers: range, *_: Any, **__: Any) -> PredictedDepth:
        depth = np.full(frames.shape[:3], away, np.float32)
        return PredictedDepth(
            DepthMaps(depth, tuple(numbers)), np.full(len(frames), focal), Provenance(model, "cpu", 4)
        )

    monkeypatch.setattr(model_runs, "predict_depth", flat)
    session("ObserveObjects", case=case)
    report = session("RunModel", model="depth", case=case, use="report")["data"]
    assert report["intrinsics"][0][0] == pytest.approx(focal)
    assert "camera_kept" not in report
    run = session("RunModel", model="depth", case=case)["data"]
    assert run["camera"]["translation"][2] == pytest.approx(away, abs=1e-3)
    built = session("BuildWorld", case=case, default_shape={"kind": "sphere", "radius": 0.09})
    speeds = [np.linalg.norm(item["velocity"][:2]) for item in built["data"]["objects"]]
    assert speeds == pytest.approx([0.5, 0.5], abs=0.04)
    scaled = session("RunModel", model="depth", case=case, use="report")["data"]
    assert scaled["scale"]["ratio"] == pytest.approx(1.0, abs=1e-3)


def test_poses_of_a_command_become_tracks_with_orientations(session: Session, models: Path, case: str) -> None:
    session("ObserveObjects", case=case)
    session("CalibrateCamera", case=case, known_length=LENGTH)
    script = """
K = request["intrinsics"]
entries = {}
for name in request["objects"]:
    entries[name] = [
        {"frame": f, "pose": [[1, 0, 0, 0.01 * f], [0, 1, 0, 0], [0, 0, 1, 50.0], [0, 0, 0, 1]]}
        for f in request["frames"]
    ]
(target / "poses.json").write_text(json.dumps({"objects": entries}))
"""
    tiny.command(models / "pose", "pose", script)
    run = session("RunModel", model="pose", case=case)
    assert "test-1.0" in run["summary"]
    assert all(count == FRAMES for count in run["data"]["frames_with_pose"].values())
    built = session("BuildWorld", case=case)
    assert built["source"]["observation"] == run["data"]["tracks"]
    assert [item["velocity"][0] for item in built["data"]["objects"]] == pytest.approx([0.25, 0.25], abs=0.01)


def test_a_mesh_of_a_command_is_a_bodys_shape(session: Session, models: Path, case: str) -> None:
    script = """
import trimesh
found = {}
for name in request["objects"]:
    trimesh.creation.icosphere(subdivisions=2, radius=1.0).export(target / f"{name}.ply")
    found[name] = {"file": f"{name}.ply", "metres_per_unit": None}
(target / "meshes.json").write_text(json.dumps({"objects": found}))
"""
    tiny.command(models / "mesher", "mesh", script)
    names = session("ObserveObjects", case=case)["objects"]
    session("CalibrateCamera", case=case, known_length=LENGTH)
    sizes = [{"name": name, "size": 0.18} for name in names]
    run = session("RunModel", model="mesher", case=case, objects=sizes)["data"]
    shapes = [{"name": row["object"], "shape": {"kind": "mesh", "mesh": row["mesh"]}} for row in run["meshes"]]
    built = session("BuildWorld", case=case, objects=shapes)
    world = json.loads(session.store_document(built["source"]["world"]))
    vertices = np.array(world["objects"][0]["shape"]["vertices"])
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.09, rel=0.03)


def test_points_on_a_body_give_its_rotation(
    session: Session, models: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (models / "points").mkdir()
    (models / "points" / "model.json").write_text(json.dumps({"task": "points", "license": "mit"}))
    spin = 0.05  # [rad] a frame, seen from above

    def turning(model: ModelFolder, frames: np.ndarray, queries: Any, *_: Any, **__: Any) -> PredictedPoints:
        pixels = np.zeros((len(frames), len(queries), 2))
        for k, query in enumerate(queries):
            own = [q for q in queries if q.object == query.object]
            angle = 2 * np.pi * own.index(query) / max(len(own), 1)
            red = abs(query.x - (25 + 2 * query.row)) < abs(query.x - (135 - 2 * query.row))
            for t in range(len(frames)):
                x, y = (25 + 2 * t, 60) if red else (135 - 2 * t, 62)
                # counter-clockwise in the world is clockwise in v, which grows downwards
                pixels[t, k] = x + 5 * np.cos(angle + spin * t), y - 5 * np.sin(angle + spin * t)
        return PredictedPoints(tuple(queries), pixels, np.ones(pixels.shape[:2], bool), Provenance(model, "cpu", 4))

    monkeypatch.setattr(model_runs, "follow_points", turning)
    session("ObserveObjects", case=case)
    session("CalibrateCamera", case=case, known_length=LENGTH)
    run = session("RunModel", model="points", case=case)
    assert run["data"]["frames_with_orientation"]
    query = f"SELECT document FROM observations WHERE id = '{run['data']['tracks']}'"
    tracks = json.loads(session.store_rows(query)[0][0])["tracks"]
    for name in run["objects"]:
        column = tracks["names"].index(name)
        turned = np.array([row[column] for row in tracks["orientations"]], dtype=float)
        known = np.isfinite(turned).all(axis=1)
        angles = np.unwrap(2 * np.arctan2(turned[known, 3], turned[known, 0]))
        assert np.polyfit(np.flatnonzero(known), angles, 1)[0] == pytest.approx(spin, abs=0.005)
