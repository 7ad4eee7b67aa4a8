"""Tables as programs write them are read as they are, or refused with one sentence: line, column and cure."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from polyworld.data.pixel_scale import PixelScale
from polyworld.data.recording import Recording
from polyworld.data.recording_csv import parse_recording, read_recording
from polyworld.data.recording_header import RecordingForm

METRE = {"x [px]": "x [0.01 m]", "y [px]": "z [-0.01 m]"}


def read(text: str, columns: dict[str, str] | None = None, seconds_per_frame: float | None = None) -> Recording:
    """The recording of a table that shows the ball where it names no object."""
    return parse_recording(text, ("ball",), form=RecordingForm(columns or {}, seconds_per_frame=seconds_per_frame))


def refusal(text: str, columns: dict[str, str] | None = None, seconds_per_frame: float | None = None) -> str:
    with pytest.raises(ValueError, match=r"\w") as raised:
        read(text, columns, seconds_per_frame)
    return str(raised.value)


def named(text: str, columns: dict[str, str] | None = None, seconds_per_frame: float | None = None) -> Recording:
    """The same of a table that names its objects, in any words."""
    return parse_recording(text, form=RecordingForm(columns or {}, seconds_per_frame=seconds_per_frame))


def test_tracker_writes_the_name_of_a_mass_above_the_header() -> None:
    text = "mass_A\t\t\nt\tx\ty\n0.0E0\t1.5E-2\t2.0\n1.0E-1\t2.5E-2\t3.0\n"
    assert "line 2: columns x and y without z: state whether y is height" in refusal(text)
    (run,) = named(text, {"y": "z"}).runs
    assert run.names == ("mass_A",)
    assert run.positions[:, 0, ::2].tolist() == [[0.015, 2.0], [0.025, 3.0]]


def test_tracker_writes_several_masses_side_by_side() -> None:
    text = "#multi:\n\tmass A\t\tmass B\t\t\nt\tx\ty\tx\ty\t\n0\t1\t2\t3\t4\t\n0.1\t1\t2.5\t\t\t\n0.2\t1\t3\t5\t6\t\n"
    (run,) = named(text, {"y": "z"}).runs
    assert run.names == ("mass_A", "mass_B")
    assert run.positions[2, :, ::2].tolist() == [[1.0, 3.0], [5.0, 6.0]]
    assert np.isnan(run.positions[1, 1]).all()


@pytest.mark.parametrize("individuals", ["", "individuals,one,one,one,one,one,one\n"])
def test_deeplabcut_writes_three_or_four_rows_above_its_pixels(individuals: str) -> None:
    text = (
        f"scorer,net,net,net,net,net,net\n{individuals}bodyparts,ball,ball,ball,hand tip,hand tip,hand tip\n"
        "coords,x,y,likelihood,x,y,likelihood\n0,320,100,0.9,10,20,0\n1,330,90,0.8,11,21,1\n"
    )
    assert "for frame numbers give seconds_per_frame" in refusal(text)
    assert "x [px] and y [px] are pixels: state the length of one, as columns={'x [px]': 'x [0.002 m]'" in refusal(
        text, None, 0.02
    )
    (run,) = named(text, METRE, 0.02).runs
    who = "one_" if individuals else ""
    assert run.names == (f"{who}ball", f"{who}hand_tip")
    assert run.times.tolist() == [0.0, 0.02]
    assert run.positions[:, 0, ::2].tolist() == pytest.approx(np.array([[3.2, -1.0], [3.3, -0.9]]))
    assert np.isfinite(run.positions[:, 1, 0]).tolist() == [False, True]  # a likelihood of 0 is no place


def test_trackmate_writes_labels_and_units_below_its_header() -> None:
    text = (
        "LABEL,ID,TRACK_ID,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME\n"
        "Label,Spot ID,Track ID,X,Y,Z,T,Frame\nLabel,Spot ID,Track ID,X,Y,Z,T,Frame\n"
        ",,,(micron),(micron),(micron),(sec),\nID1,1,0,500,2000,0,0.0,0\nID2,2,0,600,1000,0,0.5,1\n"
    )
    with pytest.warns(UserWarning, match="columns not used: frame, LABEL of the spot, ID of the spot"):
        (run,) = named(text).runs
    assert run.names == ("track_0",)
    assert run.positions[1, 0].tolist() == pytest.approx([6e-4, 1e-3, 0.0])
    assert run.times.tolist() == [0.0, 0.5]
    assert "x [pixel] and y [pixel] are pixels" in refusal(text.replace("micron", "pixel"))


def test_trackpy_numbers_its_particles_and_gives_pixels() -> None:
    text = ",y,x,mass,frame,particle\n0,100,320,9.5,0,0\n1,90,330,9.5,1,0\n2,50,10,9.5,0,7\n3,50,11,9.5,1,7\n"
    with pytest.warns(UserWarning, match="columns not used: mass, column 1 without a name"):
        (run,) = named(text, METRE, 0.5).runs
    assert run.names == ("particle_0", "particle_7")
    assert run.positions[1, 0, ::2].tolist() == pytest.approx([3.3, -0.9])


def test_logger_pro_and_capstone_write_runs_side_by_side() -> None:
    text = "Latest: Time (s),Latest: X (cm),Latest: Y (cm)\n0,100,200\n0.1,110,210\n"
    (run,) = read(text, {"Y (cm)": "z"}).runs  # which keeps the unit
    assert run.positions[1, 0, ::2].tolist() == pytest.approx([1.1, 2.1])
    text = "Time (s) Run #1,Position (m) Run #1,Time (s) Run #2,Position (m) Run #2\n0,1,0,5\n0.1,2,0.2,6\n0.2,3,,\n"
    assert "line 1: column 'Position (m)' does not state its axis: state it, as columns=" in refusal(text)
    runs = read(text, {"Position (m)": "x"}).runs
    assert [r.name for r in runs] == ["Run #1", "Run #2"]
    assert [r.times.tolist() for r in runs] == [[0.0, 0.1, 0.2], [0.0, 0.2]]
    assert runs[1].positions[:, 0, 0].tolist() == [5.0, 6.0]


@pytest.mark.parametrize(
    "header",
    ['"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)"', "time,ax,ay", "t;Linear Accelerometer x (m/s²);b"],
)
def test_logs_of_accelerometers_are_refused_with_what_to_do(header: str) -> None:
    message = refusal(f"{header}\n0,1,2\n1,2,3\n".replace(",", ";" if ";" in header else ","))
    assert message.startswith("line 1: ")
    assert "readings of an accelerometer" in message
    assert "Track the body in a video" in message


@pytest.mark.parametrize("mark", ["%", ";", "#"])
def test_comments_begin_with_any_usual_sign_and_may_be_the_header(mark: str) -> None:
    (run,) = read(f"{mark} measured today\n{mark} t x z\n0 1 2\n1 3 4\n").runs
    assert run.positions[1, 0, ::2].tolist() == [3.0, 4.0]
    (run,) = read(f"{mark} measured today\nt,x,z\n0,1,2\n1,3,4\n").runs
    assert run.positions[1, 0, ::2].tolist() == [3.0, 4.0]


def test_a_row_between_semicolons_may_begin_with_an_empty_cell() -> None:
    (run,) = read(";t;x\n;0;1\n;1;2\n").runs
    assert run.positions[:, 0, 0].tolist() == [1.0, 2.0]


def test_a_table_without_a_header_needs_the_order_of_its_columns() -> None:
    text = "0,1,20\n0.1,2,30\n"
    assert "line 1 has none of the columns" in refusal(text)
    assert "state what they are by their places, as columns={'1': 't [s]', '2': 'x [m]', ...}" in refusal(text)
    (run,) = read(text, {"1": "t", "2": "x", "3": "z [cm]"}).runs
    assert run.times.tolist() == [0.0, 0.1]
    assert run.positions[1, 0, ::2].tolist() == pytest.approx([2.0, 0.3])


def test_records_of_one_pixel_coordinate_take_a_scale() -> None:
    text = "t,y_px\n0,100\n0.1,50\n"
    assert "columns y_px are pixels: state the length of one, as columns={'y_px': 'z [-0.002 m]'}" in refusal(text)
    assert read(text, {"y_px": "z [-0.01 m]"}).runs[0].positions[:, 0, 2].tolist() == pytest.approx([-1.0, -0.5])
    (run,) = parse_recording(text, ("ball",), form=RecordingForm(pixels=PixelScale(100.0, image_axes=True))).runs
    assert run.positions[:, 0, 2].tolist() == pytest.approx([-1.0, -0.5])
    assert np.isnan(run.positions[:, 0, :2]).all()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "a MATLAB file; in MATLAB, export it as CSV"),
        (b"\x89HDF\r\n\x1a\n", "HDF5 file .* export the table as CSV"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", r"old kind \(.xls\); save it as .xlsx, or export the sheet as CSV"),
        (b"\x00\x01\x02\xff", "no text; export the table as CSV"),
    ],
)
def test_files_that_are_no_tables_are_refused_with_what_to_export(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=says) as raised:
        read_recording(path, ("ball",))
    assert str(raised.value).startswith("data.csv: ")
    assert "save it as UTF-8" not in str(raised.value)


def test_arrays_of_numpy_are_refused_with_what_to_export(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=np.arange(3.0))
    np.save(tmp_path / "a.npy", np.arange(3.0))
    for name in ("a.npz", "a.npy"):
        with pytest.raises(ValueError, match="as CSV"):
            read_recording(tmp_path / name, ("ball",))


def test_workbooks_are_read_whatever_they_are_called(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl is not installed: no workbooks are read")
    book = openpyxl.Workbook()
    for row in (["Time (s)", "x [mm]"], [0.0, 1500], [0.1, None], [0.2, 1700.5]):
        book.active.append(row)
    book.create_sheet("empty")
    for name in ("book.xlsx", "book.xls"):
        with (tmp_path / name).open("wb") as file:
            book.save(file)
        (run,) = read_recording(tmp_path / name, ("ball",)).runs
        assert run.times.tolist() == [0.0, 0.1, 0.2]
        assert run.positions[:, 0, 0].tolist() == pytest.approx([1.5, np.nan, 1.7005], nan_ok=True)
    book["empty"].append(["notes"])
    book.save(tmp_path / "two.xlsx")
    with pytest.raises(ValueError, match="one filled sheet is read, this has 2"):
        read_recording(tmp_path / "two.xlsx", ("ball",))


def test_a_workbook_that_unpacks_to_more_than_memory_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("openpyxl", reason="openpyxl is not installed: no workbooks are read")
    path = tmp_path / "large.xlsx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("xl/workbook.xml", b"")
        with packed.open("xl/sheet.xml", "w") as sheet:
            for _ in range(210):
                sheet.write(io.BytesIO(bytes(1_000_000)).getbuffer())
    with pytest.raises(ValueError, match="above the limit of 200 MB"):
        read_recording(path, ("ball",))
