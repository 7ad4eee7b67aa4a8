"""From files to committed worlds through the tools, judged by motion whose law is known."""

from __future__ import annotations

import json
from pathlib import Path

import anyio
import cv2
import numpy as np
import pytest
import trimesh
from mcp import Client

from tests.atw_mcp.clips import write_clip, write_tracks
from tests.atw_mcp.session import Session

BOX = {"kind": "box", "half_extents": [0.05, 0.05, 0.05]}


def test_friction_and_speed_of_a_sliding_puck_are_recovered(session: Session, tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "slide.csv", speed=1.2, friction=0.23)
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path), position_sigma=0.001)
    built = session("BuildWorld", case=case, default_shape=BOX)
    assert built["data"]["representation"] == "planar"
    assert built["data"]["seconds_per_frame"] == pytest.approx(0.04)
    asked = {
        "case": case,
        "world": built["source"]["world"],
        "parameters": [{"paths": ["objects.puck.friction"], "lower": 0.0, "upper": 1.0}],
        "generations": 20,
    }
    fitted = session("FitWorld", **asked, patience_seconds=300)
    values = {value["name"]: value["value"] for value in fitted["data"]["values"]}
    assert values["puck.friction"] == pytest.approx(0.23, abs=0.005)
    assert fitted["data"]["position_rmse"] < 0.002
    read = session("ReadProperty", case=case, world=fitted["data"]["world"], objects=["puck"], property="velocity")
    assert read["data"]["values"][0]["value"][0] == pytest.approx(1.2, abs=0.02)

    record = session("ReadEvidence", evidence=fitted["evidence"], detail="full")["data"]
    assert set(fitted["data"]) - set(record) == {"undetermined_whole"}  # which say how to read it
    assert record["position_rmse"] == fitted["data"]["position_rmse"]

    again = session("FitWorld", **asked)
    assert again["data"]["computed_now"] is False
    assert again["data"]["world"] == fitted["data"]["world"]


def test_what_can_roll_on_a_level_floor_is_spatial_and_would_suit_a_planar_world_too(
    session: Session, tmp_path: Path
) -> None:
    path = write_tracks(tmp_path / "roll.csv", speed=1.0, friction=0.02)
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path), position_sigma=0.001)
    ball = {"kind": "sphere", "radius": 0.05}
    for shape, kind, other in ((ball, "spatial", "planar"), (BOX, "planar", None)):
        built = session("BuildWorld", case=case, default_shape=shape)["data"]
        assert (built["representation"], built.get("alternative_representation")) == (kind, other)
    asked = session("BuildWorld", case=case, default_shape=ball, representation="spatial")["data"]
    assert "alternative_representation" not in asked  # it was asked for


def test_objects_of_a_clip_move_at_their_known_speed(session: Session, tmp_path: Path) -> None:
    # Discs of 9 px radius move 2 px a frame; 100 px are 1 m and a frame lasts 1/25 s: 0.5 m/s, radius 0.09 m.
    case = session("OpenCase", video=str(write_clip(tmp_path / "discs.mp4")))["case"]
    seen = session("ObserveObjects", case=case)
    assert sorted(item["colour"] for item in seen["data"]["objects"]) == ["blue", "red"]
    renamed = session(
        "ObserveObjects",
        case=case,
        corrections=[
            {"kind": "rename", "object": item["name"], "name": item["colour"]} for item in seen["data"]["objects"]
        ],
    )
    assert set(renamed["objects"]) == {"red", "blue"}
    length = {"first_pixel": [20, 60], "second_pixel": [120, 60], "length": 1.0, "view": "top"}
    session("CalibrateCamera", case=case, known_length=length)
    ball = {"kind": "sphere", "radius": 0.09}
    objects = [{"name": "red", "shape": ball}, {"name": "blue", "shape": ball}]
    built = session("BuildWorld", case=case, objects=objects)
    moving = {item["name"]: item["velocity"] for item in built["data"]["objects"]}
    assert moving["red"] == pytest.approx([0.5, 0.0, 0.0], abs=0.03)
    assert moving["blue"] == pytest.approx([-0.5, 0.0, 0.0], abs=0.03)
    assert any("frame rate" in note for note in built["data"]["assumed"])
    assert built["source"]["observation"] is not None
    opened = session("OpenCase", case=case)
    assert {entry["kind"] for entry in opened["data"]["observations"]} == {"objects", "camera", "tracks"}


def test_recalibration_moves_the_next_world_and_leaves_the_earlier_one(session: Session, tmp_path: Path) -> None:
    case = session("OpenCase", video=str(write_clip(tmp_path / "discs.mp4")))["case"]
    session("ObserveObjects", case=case)
    ids = []
    for metres in (1.0, 2.0, 1.0):
        length = {"first_pixel": [20, 60], "second_pixel": [120, 60], "length": metres, "view": "top"}
        session("CalibrateCamera", case=case, known_length=length)
        ids.append(session("BuildWorld", case=case)["source"]["world"])
    assert ids[0] == ids[2] != ids[1]
    assert session("InspectWorld", case=case, world=ids[1])["source"]["world"] == ids[1]


def test_an_imported_mesh_is_a_body_and_an_obstacle(session: Session, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=100.0)  # millimetres; 2562 vertices
    ball.export(tmp_path / "ball.stl")
    path = write_tracks(tmp_path / "slide.csv")
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path))
    mesh = session("ImportObservation", case=case, kind="mesh", path=str(tmp_path / "ball.stl"), scale=0.001)
    shape = {"kind": "mesh", "mesh": mesh["data"]["mesh"]}
    built = session(
        "BuildWorld",
        case=case,
        default_shape=shape,
        obstacles=[{"name": "boulder", "shape": shape, "position": [3.0, 0.0, 0.0]}],
    )
    assert built["data"]["representation"] == "spatial"
    world = json.loads(session.store_document(built["source"]["world"]))
    vertices = np.array(world["objects"][0]["shape"]["vertices"])
    assert len(vertices) <= 256
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.1, rel=1e-3)
    assert len(world["statics"][-1]["shape"]["faces"]) == 5120
    text = session.refused("BuildWorld", case=case, default_shape={"kind": "mesh", "mesh": "obs-0"})
    assert mesh["data"]["mesh"] in text


def test_an_imported_camera_is_used_by_the_world(session: Session, tmp_path: Path) -> None:
    camera = {
        "width": 160, "height": 120, "intrinsics": [[200, 0, 80], [0, 200, 60], [0, 0, 1]],
        "rotation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]], "translation": [0, 0, 3.0],
    }  # fmt: skip
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    case = session("OpenCase", video=str(write_clip(tmp_path / "discs.mp4")))["case"]
    session("ImportObservation", case=case, kind="camera", path=str(tmp_path / "camera.json"))
    session("ObserveObjects", case=case)
    built = session("BuildWorld", case=case)
    world = json.loads(session.store_document(built["source"]["world"]))
    assert world["camera"]["translation"] == [0, 0, 3.0]
    camera["width"] = 320
    (tmp_path / "wide.json").write_text(json.dumps(camera))
    text = session.refused("ImportObservation", case=case, kind="camera", path=str(tmp_path / "wide.json"))
    assert "160 x 120" in text


def test_masks_depth_and_camera_from_elsewhere_make_a_world_without_assumptions(
    session: Session, tmp_path: Path
) -> None:
    # A camera at y = -3 m that looks along +y, 1 m above the floor: a pixel is 1.5 cm wide at 3 m.
    clip = write_clip(tmp_path / "discs.mp4")
    labels, depth = tmp_path / "labels", np.full((24, 120, 160), np.nan, dtype=np.float32)
    labels.mkdir()
    for t in range(24):
        image = np.zeros((120, 160), dtype=np.uint8)
        cv2.circle(image, (25 + 2 * t, 60), 9, 1, -1)
        cv2.circle(image, (135 - 2 * t, 62), 9, 2, -1)
        cv2.imwrite(str(labels / f"{t:04d}.png"), image)
        depth[t][image == 1], depth[t][image == 2] = 3.0, 3.5
    np.savez(tmp_path / "depth.npz", depth=depth)
    camera = {
        "width": 160, "height": 120, "intrinsics": [[200, 0, 80], [0, 200, 60], [0, 0, 1]],
        "rotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]], "translation": [0, 1, 3.0],
    }  # fmt: skip
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    case = session("OpenCase", video=str(clip))["case"]
    session("ImportObservation", case=case, kind="masks", path=str(labels))
    session("ImportObservation", case=case, kind="depth", path=str(tmp_path / "depth.npz"))
    session("ImportObservation", case=case, kind="camera", path=str(tmp_path / "camera.json"))
    ball = {"kind": "sphere", "radius": 0.15}
    objects = [{"name": f"object_{n}", "shape": ball} for n in (1, 2)]
    built = session("BuildWorld", case=case, objects=objects, floor="none", representation="spatial")
    near = next(item for item in built["data"]["objects"] if item["name"] == "object_1")
    assert near["position"] == pytest.approx([(25 - 80) / 200 * 3.0, 0.1, 1.0], abs=0.06)  # 0.1: 2/3 of the radius
    assert near["velocity"][0] == pytest.approx(2 / 200 * 3.0 / 0.04, rel=0.05)
    far = next(item for item in built["data"]["objects"] if item["name"] == "object_2")
    assert far["position"][1] - near["position"][1] == pytest.approx(0.5, abs=0.02)


def test_a_cancelled_fit_keeps_the_best_found_and_is_not_reused(session: Session, tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "slide.csv")
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path))
    draft = session("BuildWorld", case=case, default_shape=BOX)["source"]["world"]
    asked = {
        "case": case,
        "world": draft,
        "method": "cem",
        "generations": 2000,
        "population": 512,
        "patience_seconds": 0,
    }

    async def cancel() -> str:
        async with Client(session.server) as client:  # one connection: a server that loses its client stops its work
            running = json.loads((await client.call_tool("FitWorld", asked)).content[0].text)
            assert running["status"] == "running"
            stop = {"evidence": running["evidence"]}
            status: str = json.loads((await client.call_tool("CancelWork", stop)).content[0].text)["status"]
            with anyio.fail_after(60):
                while status == "running":
                    await anyio.sleep(0.1)
                    result = await client.call_tool("ReadEvidence", {"evidence": running["evidence"]})
                    status = json.loads(result.content[0].text)["status"]
            return status

    assert anyio.run(cancel) == "cancelled"
    assert session.store_rows("SELECT count(*) FROM fits") == [(0,)]


def test_a_world_is_described_without_any_file(session: Session) -> None:
    """A ball thrown level from 2 m: its surface meets the floor after sqrt(2 (2 - 0.1) / g)."""
    opened = session("OpenCase", name="throw", questions=["When does it land?"])
    assert "BuildWorld" in opened["data"]["next"]
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 2], "velocity": [3, 0, 0]}
    built = session("BuildWorld", case="throw", objects=[ball])
    session("CommitWorld", case="throw", world=built["source"]["world"])
    rollout = session("Rollout", case="throw", horizon_seconds=1.0)["source"]["rollout"]
    events = session("ReadEvents", rollout=rollout, floor=True)["data"]["events"]
    assert events[0]["time"] == pytest.approx((2 * 1.9 / 9.81) ** 0.5, abs=1e-4)
    assert session("OpenCase", name="throw")["data"]["questions"] == ["When does it land?"]
