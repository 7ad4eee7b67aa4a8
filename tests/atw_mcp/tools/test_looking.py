"""Pictures and measurements of the demo clip, against what its simulator knows of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer
from atw_mcp.demo.truth import FOLDER
from atw_mcp.looking.overlay import ROOM
from atw_mcp.observation.observing import latest_image_observation
from atw_mcp.perception.tracks import estimate_sizes, world_tracks
from atw_mcp.tools import construction, looking, measurement, observation, opening, rollout_pictures
from polyworld.edits.interventions import Remove, branch
from polyworld.world import TimeBase
from polyworld.world.camera import Camera
from polyworld.world.shapes import Box
from tests.atw_mcp.perception.test_world_tracks import quarter_turn_error
from tests.atw_mcp.two_discs import case_with, two_discs

CASE = "table"


def done(outcome: Any) -> Answer:
    answer = outcome.work(Progress()) if isinstance(outcome, LongWork) else outcome
    assert isinstance(answer, Answer)
    return answer


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((FOLDER / "collision.json").read_text())
    return loaded


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory, truth: dict[str, Any]) -> Iterator[App]:
    """The clip observed, calibrated with its true camera and built into a world; not fitted."""
    app = App(tmp_path_factory.mktemp("store") / "atw.db")
    opening.open_case(app, video=str(FOLDER / "collision.mp4"), name=CASE)
    expected = ["red cylinder", "blue cube", "yellow cylinder", "green cube"]  # as the demo asks
    done(observation.observe_objects(app, CASE, expected=expected))
    camera = {key: truth["camera"][key] for key in ("intrinsics", "rotation", "translation")}
    measurement.calibrate_camera(app, CASE, camera=measurement.CameraArgument.model_validate(camera))
    done(construction.build_world_tool(app, CASE, seconds_per_frame=truth["seconds_per_frame"]))
    yield app
    app.store.close()


def picture(file: bytes) -> np.ndarray[Any, Any]:
    decoded = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return np.asarray(decoded, dtype=int)


def test_frames_are_pictures_with_outlines_where_the_objects_are(app: App) -> None:
    drawn = looking.inspect_frames(app, CASE, frames=[0, 24])
    bare = looking.inspect_frames(app, CASE, frames=[0, 24], plain=True)
    assert list(drawn.pictures) == ["frame 000000.jpg", "frame 000024.jpg"]
    assert [row["frame"] for row in drawn.data["frames"]] == [0, 24]
    for name, file in drawn.pictures.items():
        changed = np.abs(picture(file) - picture(bare.pictures[name])).max(axis=2) > 60
        assert changed.any(axis=0).sum() > 50  # outlines and names
        assert changed.mean() < 0.15  # and the frame still to be seen
    (blue,) = [item for item in drawn.data["frames"][0]["objects"] if item["name"] == "blue_cube"]
    u, v = blue["centroid"]
    scale = picture(bare.pictures["frame 000000.jpg"]).shape[1] / 480
    b, _, r = picture(bare.pictures["frame 000000.jpg"])[round(v * scale), round(u * scale)]
    assert b > 2 * r


def test_bodies_of_an_independent_simulator_are_measured_to_millimetres(app: App, truth: dict[str, Any]) -> None:
    _, seen = latest_image_observation(app, app.case(CASE)) or pytest.fail("nothing is observed")
    assert set(seen.names) == {f"{o.colour.name}_{o.shape.name}" for o in seen.objects} == set(truth["names"])
    camera = Camera.model_validate(truth["camera"])
    sizes = estimate_sizes(seen, camera)
    solids = {name: estimate.solid for name, estimate in sizes.items()}
    tracks = world_tracks(seen, camera, solids, seconds_per_frame=truth["seconds_per_frame"])
    positions, orientations = np.array(truth["positions"]), np.array(truth["orientations"])
    for k, name in enumerate(tracks.names):
        j, shape, solid = truth["names"].index(name), truth["objects"][name]["shape"], solids[name]
        assert solid.kind == shape["kind"]
        if isinstance(solid, Box):
            assert solid.half_extents[0] == pytest.approx(shape["half_extents"][0], rel=0.02)
            yaw = 2 * np.arctan2(orientations[:, j, 3], orientations[:, j, 0])
            turned = tracks.orientation_confidence[:, k] > 0.3
            assert np.median(quarter_turn_error(tracks.orientations[turned, k], yaw[turned])) < 1.5
        error = np.linalg.norm(tracks.positions[:, k, :2] - positions[:, j, :2], axis=1)
        found = tracks.confidence[:, k] > 0
        assert found.mean() > 0.95
        assert np.median(error[found]) < 0.004, name
        assert error[found].max() < 0.015, name
        # Stated accuracy is neither boast nor alarm.
        assert 0.1 < np.median(error[found] / tracks.position_sigma[found, k]) < 3, name
        item = seen.object(name)
        drawn = np.array([frame[name] for frame in truth["masks"]])
        whole = np.array([status == "visible" for status in item.status])
        np.testing.assert_allclose(item.area[whole], drawn[whole, 0], rtol=0.06)


def test_observed_motion_is_where_the_simulator_drew_it(app: App, truth: dict[str, Any]) -> None:
    for name in truth["names"]:
        data = looking.inspect_observed_motion(app, CASE, name, limit=500).data
        at = {key: data["columns"].index(key) for key in data["columns"]}
        assert len(data["rows"]) == truth["frame_count"]
        compared = 0
        for row in data["rows"]:
            _, u, v = truth["masks"][row[at["frame"]]][name]
            assert not row[at["touches_border"]]
            if row[at["status"]] == "visible":
                assert np.hypot(row[at["u"]] - u, row[at["v"]] - v) < 1.5
                compared += 1
        assert compared > 10, name


def test_observed_motion_is_in_metres_where_the_camera_is_calibrated(app: App, truth: dict[str, Any]) -> None:
    data = looking.inspect_observed_motion(app, CASE, "red_cylinder", frames=[0, 20]).data
    at = {key: data["columns"].index(key) for key in data["columns"]}
    true = np.array(truth["positions"])[:, truth["names"].index("red_cylinder")]
    for row in data["rows"]:
        assert row[at["time"]] == pytest.approx(row[at["frame"]] * truth["seconds_per_frame"])
        assert np.hypot(row[at["x"]] - true[row[0], 0], row[at["y"]] - true[row[0], 1]) < 0.01


def test_metres_of_an_earlier_observation_are_not_shown_beside_new_pixels(app: App) -> None:
    base = app.store.cases.observations(CASE, "objects")[0][1]
    tracks = looking.inspect_observed_motion(app, CASE, "red_cylinder").observation
    rename = observation.Correction(kind="rename", object="blue_cube", name="box")
    try:
        done(observation.observe_objects(app, CASE, corrections=[rename], observation=tracks))  # those tracks are of it
        found = looking.inspect_observed_motion(app, CASE, "red_cylinder")
        assert found.observation not in (base, tracks)
        assert "u" in found.data["columns"]
        assert "x" not in found.data["columns"]
        assert "of an earlier observation" in found.summary
    finally:
        done(observation.observe_objects(app, CASE, observation=base))
    assert "x" in looking.inspect_observed_motion(app, CASE, "red_cylinder").data["columns"]


def test_scale_of_pictures_is_said_where_it_is_not_one(app: App) -> None:
    found = looking.inspect_frames(app, CASE, frames=[3], zoom=2.0, crop=[0, 0, 100, 80])
    assert "pictures 2 times the video's size" in found.summary
    assert picture(found.pictures["frame 000003.jpg"]).shape[:2] == (160, 200)


def test_world_is_drawn_over_the_frames_with_its_error(app: App) -> None:
    answer = rollout_pictures.inspect_rollout(app, CASE, frames=[0, 70])
    first, last = ({item["name"]: item for item in row["objects"]} for row in answer.data["frames"])
    assert answer.data["frames"][0]["over_video"]
    for name in ("red_cylinder", "blue_cube", "yellow_cylinder", "green_cube"):
        assert first[name]["overlap"] > 0.9
        assert first[name]["error_m"] < 0.01
    assert last["red_cylinder"]["error_m"] > 0.05  # never fitted: it must show
    assert answer.data["error"]["position_rmse_by_object"]["red_cylinder"] > 0.05
    magenta = picture(answer.pictures["frame 000000.jpg"])
    plain = looking.inspect_frames(app, CASE, frames=[0], plain=True)
    frame = picture(plain.pictures["frame 000000.jpg"])
    gained = (magenta[: frame.shape[0], : frame.shape[1]] - frame)[..., [0, 2]].min(axis=2) > 60
    assert gained.sum() > 200


def test_text_beside_pictures_has_one_row_for_each_object_and_its_worst_frame(app: App) -> None:
    answer = rollout_pictures.inspect_rollout(app, CASE, frames=list(range(0, 72, 8)))
    assert answer.shown is not None
    rows = {row["name"]: row for row in answer.shown["objects"]}
    assert len(rows) == len(answer.shown["objects"]) == 4
    for name, row in rows.items():
        each = {f["frame"]: i for f in answer.data["frames"] for i in f["objects"] if i["name"] == name}
        # All observed frames are compared, those shown among them.
        assert row["worst_error_m"] >= max(i["error_m"] for i in each.values() if "error_m" in i) - 1e-3
        assert row["worst_error_m"] >= row["position_rmse"]
        (there,) = rollout_pictures.inspect_rollout(app, CASE, frames=[row["worst_at_frame"]], objects=[name]).data[
            "frames"
        ]
        assert there["objects"][0]["error_m"] == pytest.approx(row["worst_error_m"], abs=1e-3)
        assert row["mean_overlap"] == pytest.approx(np.mean([i["overlap"] for i in each.values()]), abs=1e-3)
    assert len(json.dumps(answer.shown)) < 0.5 * len(json.dumps(answer.data))


def test_time_is_called_the_files_until_a_world_has_its_own(app: App, tmp_path: Path) -> None:
    assert "file" not in looking.inspect_frames(app, CASE, frames=[3]).summary
    fresh = App(tmp_path / "fresh.db")
    opening.open_case(fresh, video=str(FOLDER / "collision.mp4"), name="new")
    answer = looking.inspect_frames(fresh, "new", frames=[3])
    assert "the file's" in answer.summary
    assert answer.data["time_is"] == "file time"
    fresh.store.close()


def test_draft_is_shown_over_the_observed_frames_and_the_way_beyond_is_named(app: App) -> None:
    for beyond in ({"frames": [99]}, {"interval": [0.0, 9.0]}):
        with pytest.raises(ToolError, match=r"observed frames only. Next: CommitWorld\(.*Rollout\(.*horizon_seconds"):
            rollout_pictures.inspect_rollout(app, CASE, **beyond)


def test_branch_is_drawn_on_its_own_and_not_measured_against_the_video(app: App) -> None:
    case = app.case(CASE)
    base = app.world(case)
    without = branch(base, [Remove(object="blue_cube")])
    app.keep_world(case, without, how="intervention", parent=base, detail={"edits": []})
    answer = rollout_pictures.inspect_rollout(app, CASE, world=without.id, frames=[40])
    assert answer.data["branch"]
    assert not answer.data["frames"][0]["over_video"]
    assert answer.data["error"] is None
    assert all("error_m" not in item for item in answer.data["frames"][0]["objects"])


def test_world_without_a_video_is_drawn_as_far_as_asked(tmp_path: Path) -> None:
    app = App(tmp_path / "data.db")
    world = two_discs().model_copy(update={"time": TimeBase(seconds_per_frame=0.02), "camera": None})
    case_with(app, world, committed=False)
    with pytest.raises(ToolError, match=r"interval=\[0, SECONDS\]"):
        rollout_pictures.inspect_rollout(app, "discs")
    answer = rollout_pictures.inspect_rollout(app, "discs", interval=[0.0, 0.4], pictures=2)
    assert [row["frame"] for row in answer.data["frames"]] == [0, 20]
    striker = answer.data["frames"][1]["objects"][0]
    assert striker["position"][0] == pytest.approx(0.4, abs=1e-6)  # 1 m/s, no friction, no collision yet
    assert striker["visible_pixels"] > 100
    assert answer.data["error"] is None


def test_pictures_of_one_result_fit_into_a_message(app: App) -> None:
    answer = rollout_pictures.inspect_rollout(app, CASE, world=app.store.cases.worlds(CASE)[0][0], pictures=12)
    assert len(answer.pictures) == 13  # the last: where and when the world is off
    assert sum(map(len, answer.pictures.values())) <= ROOM


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda app: looking.inspect_frames(app, CASE, frames=[72]), r"\[72\] are outside the video: .*0\.\.71"),
        (lambda app: looking.inspect_frames(app, CASE, objects=["pink ball"]), "no object 'pink ball'.*blue_cube"),
        (
            lambda app: rollout_pictures.inspect_rollout(app, CASE, frames=[99]),
            r"outside the rollout: choose among 0\.\.71",
        ),
        (lambda app: rollout_pictures.inspect_rollout(app, CASE, rollout="rollout-00"), "Next: Rollout"),
        (lambda app: rollout_pictures.inspect_rollout(app, CASE, rollout="rollout-00", world="w"), "not both"),
        (lambda app: looking.inspect_observed_motion(app, CASE, "blue"), "did you mean|no object 'blue'"),
        (lambda app: looking.inspect_observed_motion(app, CASE, "blue_cube", frames=[0, 99]), "reaches outside"),
    ],
)
def test_refusals_name_the_valid_choices(app: App, call: Any, complaint: str) -> None:
    with pytest.raises(ToolError, match=complaint):
        call(app)


def test_nothing_observed_yet_says_what_to_call(tmp_path: Path) -> None:
    app = App(tmp_path / "empty.db")
    opening.open_case(app, video=str(FOLDER / "collision.mp4"), name="new")
    assert "as they are" in looking.inspect_frames(app, "new", frames=[3]).summary
    with pytest.raises(ToolError, match="Next: ObserveObjects"):
        looking.inspect_observed_motion(app, "new", "red_cylinder")
    with pytest.raises(ToolError, match="BuildWorld"):
        rollout_pictures.inspect_rollout(app, "new")
