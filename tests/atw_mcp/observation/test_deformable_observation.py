"""From a video of a swinging rope, or points measured of it, to a fitted world."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.solver.rollout import rollout
from polyworld.world import Environment, MotionPlane, TimeBase, World
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.rope import Rope
from tests.atw_mcp.session import Session

Array = NDArray[np.float64]
SCALE, ORIGIN, SIZE, STEP, FRAMES = 200.0, (160.0, 30.0), (320, 240), 0.04, 20
DAMPING = 0.9


@lru_cache
def swinging() -> Array:
    """Points (T, k, 3) of a rope hung at the origin that was let go sideways."""
    angle = np.deg2rad(50.0)
    end = (0.8 * float(np.sin(angle)), 0.0, -0.8 * float(np.cos(angle)))
    rope = Rope(
        name="cord",
        representation="rope_planar",
        points=((0.0, 0.0, 0.0), end),
        segments=32,
        radius=0.012,
        stretch_stiffness=300.0,
        bending_stiffness=2e-4,
        linear_damping=DAMPING,
    )
    world = World(
        environment=Environment(motion_plane=MotionPlane(normal=(0.0, -1.0, 0.0), supports=False)),
        deformables=(rope,),
        attachments=(Attachment(name="hook", object="cord", end="start"),),
        time=TimeBase(seconds_per_frame=STEP, frame_count=FRAMES, substep=0.002),
    )
    return rollout(world, (FRAMES - 1) * STEP).trajectory.deformables["cord"].points


def write_rope_clip(path: Path) -> Path:
    """An MP4 of that rope, seen from the side: x to the right, z up, 200 px a metre."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 1.0 / STEP, SIZE)
    for points in swinging():
        image = np.full((SIZE[1], SIZE[0], 3), 170, dtype=np.uint8)
        pixels = np.stack([ORIGIN[0] + SCALE * points[:, 0], ORIGIN[1] - SCALE * points[:, 2]], axis=1)
        cv2.polylines(image, [np.round(16 * pixels).astype(np.int32)], False, (30, 30, 160), 5, cv2.LINE_AA, 4)
        writer.write(image)
    writer.release()
    return path


def write_points(path: Path) -> Path:
    """The same as points along the rope, with millimetres of noise."""
    rng = np.random.default_rng(0)
    lines = ["frame,object,point,x,y,z,sigma"]
    for t, points in enumerate(swinging()):
        for k, (x, _, z) in enumerate(points[::4]):
            dx, dz = 0.002 * rng.normal(size=2)
            lines.append(f"{t},cord,{k},{x + dx:.5f},0,{z + dz:.5f},0.002")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


PARTS = [
    {"part": "rope", "name": "cord", "segments": 10, "radius": 0.012, "stretch_stiffness": 300.0,
     "bending_stiffness": 2e-4},
    {"part": "attachment", "name": "hook", "object": "cord", "end": "start"},
]  # fmt: skip


def test_a_rope_in_a_video_is_noticed_measured_built_and_fitted(session: Session, tmp_path: Path) -> None:
    case = session("OpenCase", video=str(write_rope_clip(tmp_path / "rope.mp4")))["case"]
    seen = session("ObserveObjects", case=case, max_objects=1)
    (name,) = [item["name"] for item in seen["data"]["objects"]]
    assert [item["may_be"] for item in seen["data"]["deforming"]] == ["rope"]
    assert "may be deformable" in seen["summary"]
    refused = session.refused("ObserveObjects", case=case, deformable=[{"object": "snake", "kind": "rope"}])
    assert name in refused
    shapes = session("ObserveObjects", case=case, deformable=[{"object": name, "kind": "rope"}])
    (line,) = [row for row in shapes["data"]["measured"] if row["readout"] == "centreline"]
    assert line["frames_seen"] > 0.8 * FRAMES
    session(
        "CalibrateCamera",
        case=case,
        known_length={"first_pixel": list(ORIGIN), "second_pixel": [ORIGIN[0] + SCALE, ORIGIN[1]], "length": 1.0},
    )
    parts = [{**PARTS[0], "name": name}, {**PARTS[1], "object": name}]
    built = session("BuildWorld", case=case, parts=parts, substep=0.004)
    fitted = session(
        "FitWorld",
        case=case,
        world=built["data"]["world"],
        materials=["linear_damping"],
        patience_seconds=300,
    )
    assert "standard deviations" in fitted["summary"]
    (value,) = [v for v in fitted["data"]["values"] if v["name"].endswith("linear_damping")]
    # Lines read off a video of 5 px/2.5 cm, and a rope of a third of the segments.
    assert value["value"] == pytest.approx(DAMPING, abs=0.25)
    # [px] 1 is the stated accuracy of a centreline; a tenth of the range of its motion would be 16 px.
    assert fitted["data"]["shape_rms_in_sigma"] < 3.0


def test_measured_points_join_the_tracks_and_are_fitted(session: Session, tmp_path: Path) -> None:
    file = write_points(tmp_path / "points.csv")
    case = session("OpenCase", data=str(file))["case"]
    read = session(
        "ImportObservation",
        case=case,
        kind="points",
        path=str(file),
        points_are="centreline",
        seconds_per_frame=STEP,
    )
    assert "1 shapes of cord" in read["summary"]
    assert read["data"]["shapes"][0]["readout"] == "centreline"
    built = session("BuildWorld", case=case, parts=PARTS, floor="none", substep=0.004, representation="planar")
    fitted = session(
        "FitWorld",
        case=case,
        world=built["data"]["world"],
        materials=["linear_damping", "bending_stiffness"],
        holdout_from=16,
        patience_seconds=300,
    )
    values = {v["name"]: v for v in fitted["data"]["values"]}
    assert values["cord.linear_damping"]["value"] == pytest.approx(DAMPING, abs=0.1)
    assert fitted["data"]["position_rmse_held_out"] is None  # shapes alone were measured
    assert fitted["data"]["shape_rmse"]["cord"]["centreline"] < 0.02  # m; the rope swings through more than a metre
    series = tmp_path / "tension.csv"
    series.write_text("frame,object,quantity,value,sigma\n0,cord,tension,0.1,0.05\n5,cord,tension,0.6,0.05\n")
    more = session("ImportObservation", case=case, kind="series", path=str(series))
    assert {row["readout"] for row in more["data"]["shapes"]} == {"centreline", "tension"}
    bare = tmp_path / "bare.csv"
    bare.write_text("frame,object,quantity,value\n0,cord,tension,0.1\n")
    assert "value_sigma" in session.refused("ImportObservation", case=case, kind="series", path=str(bare))
