"""What other programs measured comes in exactly, or is refused with the reason."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from atw_mcp.perception.import_files import ImportDataError
from atw_mcp.perception.import_images import import_camera, import_depth, import_masks, import_mesh
from atw_mcp.perception.import_shapes import import_points, import_series
from atw_mcp.perception.import_tracks import clevrer_appearances, import_tracks
from polyworld.data.recording_header import RecordingForm
from polyworld.data.tracks import ObservedTracks
from polyworld.probing.readouts import Amount, Centreline, Curve, Front, Markers, Tension
from polyworld.world.camera import Camera
from tests.atw_mcp.perception.clips import HEIGHT, WIDTH, Clip, Disc, render

CLEVRER = Path(__file__).parents[4] / "shared" / "data" / "clevrer"


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


# --- tracks ---------------------------------------------------------------------------------------------


FRAMES = RecordingForm(seconds_per_frame=0.04)


def test_a_table_with_frames_and_yaw(tmp_path: Path) -> None:
    text = "frame,object,x,y,z,yaw,confidence\n0,a,0.1,0.2,0,0.0,1\n0,b,1,1,0,,0.5\n2,a,0.3,0.2,0,1.5708,1\n2,b,,,,,\n"
    tracks = import_tracks(written(tmp_path / "t.csv", text), FRAMES).tracks
    assert tracks.names == ("a", "b")
    assert tracks.frames.tolist() == [0, 2]
    assert tracks.times.tolist() == [0.0, 0.08]
    assert tracks.positions[1, 0].tolist() == [0.3, 0.2, 0.0]
    assert tracks.orientations[1, 0] == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)], abs=1e-4)
    assert tracks.confidence.tolist() == [[1.0, 0.5], [1.0, 0.0]]
    assert np.isnan(tracks.positions[1, 1]).all()


@pytest.mark.parametrize(
    "times",
    [
        [0.02 * k for k in range(5)],
        [0.0, 0.031426, 0.060405, 0.089883, 0.122553, 0.19],  # dropped frames
        [0.0, 0.005, 0.0083333, 0.0133333, 0.0166667],
        [0.0, 0.1, 0.13, 0.3],
        [0.0, 1e-4, 0.05, 0.0501],  # two trackers that hardly differ
        [3.7, 3.71, 3.8],
    ],
)
def test_measured_times_are_kept_and_every_one_has_its_frame(tmp_path: Path, times: list[float]) -> None:
    rows = "".join(f"{t!r},ball,{k},0,1.5\n" for k, t in enumerate(times))
    tracks = import_tracks(written(tmp_path / "t.csv", "t,object,x,y,z\n" + rows)).tracks
    assert tracks.times == pytest.approx(times, rel=1e-14, abs=1e-15)
    assert len(set(tracks.frames.tolist())) == len(times)
    assert np.abs(tracks.frames - tracks.moments).max() <= 0.5
    again = ObservedTracks.from_dict(json.loads(json.dumps(tracks.to_dict())))
    assert again.times.tolist() == tracks.times.tolist()
    assert tracks.window(int(tracks.frames[1]), int(tracks.frames[-1])).times.tolist() == tracks.times[1:].tolist()


def test_frame_numbers_beside_times_are_labels_and_no_straight_line_replaces_the_times(tmp_path: Path) -> None:
    times = [0.0, 0.033, 0.1, 0.133]
    rows = "".join(f"{k},{t},ball,{k},0,1.5\n" for k, t in enumerate(times))
    tracks = import_tracks(written(tmp_path / "t.csv", "frame,t,object,x,y,z\n" + rows)).tracks
    assert tracks.frames.tolist() == [0, 1, 2, 3]
    assert tracks.times == pytest.approx(times, rel=1e-14)
    assert [tracks.time_of(f) for f in (0, 2, 4)] == pytest.approx([0.0, 0.1, 0.133 + tracks.seconds_per_frame])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("object,x,y\na,1,1\n", "line 1: column t .* is missing"),
        ("frame,object,x,y,z\n", "no rows"),
        ("frame,object,x,y,z\n0,a,1,1,1\n1,a,1,1,1\n", "seconds_per_frame"),
        ("t,object,x,y\n0,a,1,1\n1,a,1,1\n", "line 1: columns x and y without z: state whether y is height"),
        ("t,object,x,z\n0,a,1,1\n0,a,1,2\n", "line 3: run '1' has object 'a' at t = 0 in line 2 already"),
        ("t,object,x,z\n0,a,one,1\n1,a,1,two\n", "line 2: x is not a number: 'one'; line 3: z is not a number: 'two'"),
        ("t,object,x,z\n0,a,1\n", "line 2: 3 cells, expected 4 as in the header"),
        ("t,object,x,z\n0,,1,1\n", "line 2: object is empty"),
        ("t,object,x,z,qw,qx\n0,a,1,1,1,0\n", "there is only qw, qx"),
        ("t,object,x,z,yaw,qw,qx,qy,qz\n0,a,1,1,0,1,0,0,0\n", "qw, qx, qy, qz or yaw; leave out one"),
        ("t,object,x,z,confidence\n0,a,1,1,7\n", r"line 2: confidence must lie in 0\.\.1"),
        ("t,object,x,z,qw,qx,qy,qz\n0,a,1,1,2,0,0,0\n", "norm 2, expected 1"),
        ("t,run,x,z\n0,a,1,1\n0,b,1,1\n", "tracks are of one run, the table has a, b: it is a kind='recording'"),
        ("t,object,wx\n0,a,1\n1,a,1\n", "tracks need places"),
    ],
)
def test_a_table_that_does_not_hold_tracks_is_refused(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ImportDataError, match=says):
        import_tracks(written(tmp_path / "t.csv", text))


def test_tables_of_spreadsheets_are_read_alike(tmp_path: Path) -> None:
    plain = import_tracks(written(tmp_path / "t.csv", "t,object,x,z\n0,a,0.5,1\n0.1,a,,1\n"))
    foreign = "sep=;\nt;object;x;z\n0;a;0,5;1\n0,1;a;NA;1\n"
    assert import_tracks(written(tmp_path / "u.csv", foreign)).tracks.to_dict() == plain.tracks.to_dict()


def test_json_tracks_come_back_as_they_were_written(tmp_path: Path) -> None:
    text = "frame,object,x,z\n0,a,0.1,0.2\n1,a,0.3,0.2\n"
    tracks = import_tracks(written(tmp_path / "t.csv", text), FRAMES).tracks
    again = import_tracks(written(tmp_path / "t.json", json.dumps(tracks.to_dict()))).tracks
    assert again.to_dict() == tracks.to_dict()
    with pytest.raises(ImportDataError, match="neither tracks"):
        import_tracks(written(tmp_path / "x.json", '{"colour": 1}'))
    with pytest.raises(ImportDataError, match="not JSON"):
        import_tracks(written(tmp_path / "y.json", "{"))
    with pytest.raises(ImportDataError, match="no file"):
        import_tracks(tmp_path / "missing.csv")


def test_clevrer_annotation_reads_positions_turns_and_looks() -> None:
    path = CLEVRER / "annotation_00000.json"
    if not path.exists():
        pytest.skip("shared CLEVRER data not found beside the repository")
    tracks = import_tracks(path).tracks
    assert tracks.seconds_per_frame == 0.028
    record = json.loads(path.read_text())["motion_trajectory"][20]["objects"][2]
    k = tracks.index("cyan_metal_cube")
    assert tracks.positions[20, k].tolist() == record["location"]
    yaw = 2 * np.arctan2(tracks.orientations[20, k, 3], tracks.orientations[20, k, 0])
    assert yaw == pytest.approx(record["orientation"][2], abs=1e-3)
    # The dataset lays its cylinders along y and stands them up with a quarter turn about x.
    assert tracks.orientations[0, tracks.index("yellow_rubber_cylinder")] == pytest.approx([1, 0, 0, 0], abs=1e-4)
    assert tracks.confidence[0, tracks.index("blue_rubber_sphere")] == 0.5  # not yet in view
    appearance, shape = clevrer_appearances(path)["blue_metal_sphere"]
    assert (appearance.color, appearance.material, shape) == ("blue", "metal", "sphere")


# --- masks ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    discs = [
        Disc(lambda t: (40 + 5.0 * t, 80), 15, (170, 70, 40)),
        Disc(lambda _t: (180, 60), 12, (40, 40, 170)),
    ]
    return render(tmp_path_factory.mktemp("masks") / "a.mp4", discs, 8)


def test_label_images_folders_and_run_lengths_give_the_same_observation(clip: Clip, tmp_path: Path) -> None:
    labels, folders = tmp_path / "labels", tmp_path / "folders"
    records = []
    for part in (labels, folders / "left", folders / "right"):
        part.mkdir(parents=True)
    for t in range(8):
        image = np.zeros((HEIGHT, WIDTH), np.uint8)
        for k, name in enumerate(("left", "right")):
            mask = clip.truth[k][t]
            image[mask] = k + 1
            cv2.imwrite(str(folders / name / f"{t:05d}.png"), mask.astype(np.uint8) * 255)
            runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[-1], mask.ravel(order="F"), [-1]]))))
            counts = [0, *runs.tolist()] if mask[0, 0] else runs.tolist()
            records.append({"frame": t, "object": name, "segmentation": {"size": [HEIGHT, WIDTH], "counts": counts}})
        cv2.imwrite(str(labels / f"frame_{t}.png"), image)
    source = written(tmp_path / "masks.json", json.dumps(records))
    for path, names in ((labels, ("object_1", "object_2")), (folders, ("left", "right")), (source, ("left", "right"))):
        observation = import_masks(path, clip.path)
        assert observation.names == names
        for k, name in enumerate(names):
            assert all(np.array_equal(observation.mask(name, t), clip.truth[k][t]) for t in range(8))
            assert observation.object(name).shape.name == "sphere"
        assert observation.object(names[0]).colour.name == "blue"


@pytest.mark.parametrize(
    ("records", "says"),
    [
        ([{"frame": 9, "object": "a", "mask": {"size": [HEIGHT, WIDTH], "counts": [HEIGHT * WIDTH]}}], r"0\.\.7"),
        ([{"frame": 1, "object": "a", "mask": {"size": [4, 4], "counts": [16]}}], "240 x 160"),
        ([{"frame": 1, "object": "a"}], "segmentation"),
        ([{"frame": 1, "object": "a", "mask": {"size": [HEIGHT, WIDTH], "counts": [3]}}], "cover 3 pixels"),
        ({"masks": 1}, "expected a list"),
        ([], "no mask"),
    ],
)
def test_masks_that_do_not_fit_the_video_are_refused(clip: Clip, tmp_path: Path, records: object, says: str) -> None:
    with pytest.raises(ImportDataError, match=says):
        import_masks(written(tmp_path / "m.json", json.dumps(records)), clip.path)


# --- depth, cameras, meshes -----------------------------------------------------------------------------


def test_depth_needs_its_unit_said(tmp_path: Path) -> None:
    folder = tmp_path / "depth"
    folder.mkdir()
    values = np.array([[0, 1500], [2000, 65535]], np.uint16)
    cv2.imwrite(str(folder / "0003.png"), values)
    with pytest.raises(ImportDataError, match="metres_per_unit"):
        import_depth(folder)
    maps = import_depth(folder, metres_per_unit=0.001)
    assert maps.frames == (3,)
    assert np.isnan(maps.depth[0, 0, 0])
    assert maps.depth[0, 0, 1] == pytest.approx(1.5)
    cv2.imwrite(str(folder / "0004.png"), values.astype(np.uint8))
    with pytest.raises(ImportDataError, match="16-bit"):
        import_depth(folder, metres_per_unit=0.001)
    np.savez(tmp_path / "d.npz", range=values)
    with pytest.raises(ImportDataError, match=r"\['range'\]"):
        import_depth(tmp_path / "d.npz")


def test_camera_from_its_own_json_and_from_a_homography(tmp_path: Path) -> None:
    camera = Camera(
        width=480,
        height=320,
        intrinsics=((500.0, 0.0, 239.5), (0.0, 500.0, 159.5), (0.0, 0.0, 1.0)),
        rotation=((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        translation=(0.0, 0.0, 3.0),
    )
    path = written(tmp_path / "c.json", camera.model_dump_json())
    assert import_camera(path) == camera
    with pytest.raises(ImportDataError, match="image size"):
        import_camera(written(tmp_path / "h.json", json.dumps({"H": np.eye(3).tolist(), "plane_z": 0})))
    with pytest.raises(ImportDataError, match="which plane"):
        import_camera(written(tmp_path / "h.json", json.dumps({"H": np.eye(3).tolist()})), (480, 320))
    with pytest.raises(ImportDataError, match="neither a camera"):
        import_camera(written(tmp_path / "h.json", "{}"), (480, 320))
    with pytest.raises(ImportDataError, match="head-on"):
        import_camera(written(tmp_path / "h.json", json.dumps({"H": np.eye(3).tolist(), "plane_z": 0})), (480, 320))


def test_mesh_keeps_its_vertices_and_takes_a_scale(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(1.0, 2.0, 3.0))
    for suffix in ("obj", "stl", "ply"):
        path = tmp_path / f"box.{suffix}"
        box.export(path)
        mesh = import_mesh(path, scale=0.01)
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.01, 0.02, 0.03])
        assert mesh.watertight
    with pytest.raises(ImportDataError, match=r"not a mesh|no triangles"):
        import_mesh(written(tmp_path / "bad.obj", "hello"))


# --- shapes ---


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_marks_are_named_by_where_they_are_first_and_a_late_one_is_left_out(tmp_path: Path) -> None:
    file = write(
        tmp_path / "marks.csv",
        "t,object,point,x,y,z,sigma",
        "0.0,flag,10,0.1,0,1,0.001",
        "0.0,flag,9,0.2,0,1,",
        "0.1,flag,10,0.1,0.05,1,0.002",
        "0.1,flag,9,,,,",
        "0.1,flag,late,0.3,0,1,",
    )
    found = import_points(file, points_are="markers", position_sigma=0.02)
    (series,) = found.series
    assert isinstance(series.readout, Markers)
    assert series.readout.at == ((0.2, 0.0, 1.0), (0.1, 0.0, 1.0))  # 9 comes before 10
    assert found.seconds_per_frame == pytest.approx(0.1)
    assert series.sigma.tolist() == [[0.02, 0.001], [0.02, 0.002]]
    assert series.confidence.tolist() == [[1.0, 1.0], [0.0, 1.0]]
    assert found.left_out == ("flag: mark 'late' is not seen in the first frame",)


def test_points_along_a_rope_are_spaced_evenly_and_where_one_is_missing_they_are_a_part(tmp_path: Path) -> None:
    file = write(
        tmp_path / "rope.csv",
        "frame,object,point,x,y,z",
        *(f"0,rope,{k},{x},0,0" for k, x in enumerate((0.0, 0.1, 0.2, 1.0))),
        *(f"1,rope,{k},{x},0,0" for k, x in enumerate((0.0, 0.1, 0.2))),
    )
    found = import_points(file, points_are="centreline", seconds_per_frame=0.04)
    whole, part = found.series
    assert isinstance(whole.readout, Centreline)
    assert whole.values[0, :, 0] == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])
    assert whole.confidence.max(axis=1).tolist() == [1.0, 0.0]
    assert isinstance(part.readout, Curve)
    assert part.confidence.tolist() == [[0.0] * 4, [1.0, 1.0, 1.0, 0.0]]


def test_series_of_numbers_are_distinguished_by_what_they_are_of(tmp_path: Path) -> None:
    file = write(
        tmp_path / "levels.csv",
        "frame,object,quantity,value,sigma,container,at",
        "0,water,amount,0.001,1e-4,cup,",
        "1,water,amount,0.002,1e-4,cup,",
        "0,water,amount,0.1,1e-4,jug,",
        "1,rope,tension,3.5,0.1,,0.25",
        "1,water,height,0.3,0.01,,",
    )
    found = import_series(file, seconds_per_frame=0.5)
    by = {series.readout: series for series in found.series}
    assert by[Amount(object="water", container="cup")].values[:, 0, 0].tolist() == [0.001, 0.002]
    assert by[Tension(object="rope", at=0.25)].confidence[:, 0].tolist() == [0.0, 1.0]
    assert by[Front(object="water")].sigma[1, 0] == 0.01
    assert len(by) == 4


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("0,water,colour,1,1,,", "quantities: amount"),
        ("0,water,amount,1,1,,", "column container"),
        ("0,water,height,1,,,", "no accuracy"),
        ("0,rope,tension,1,1,,1.5", "0..1"),
    ],
)
def test_a_series_that_cannot_be_weighed_or_understood_is_refused(tmp_path: Path, line: str, said: str) -> None:
    file = write(tmp_path / "bad.csv", "frame,object,quantity,value,sigma,container,at", line)
    with pytest.raises(ImportDataError, match=said):
        import_series(file, seconds_per_frame=0.5)
