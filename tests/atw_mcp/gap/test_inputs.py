"""Tables and worlds as options of `atw-mcp gap` give them: units, frames, pixels, angles, bodies."""

from __future__ import annotations

import argparse
import math
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from atw_mcp.calls.app import App
from atw_mcp.cli import main
from atw_mcp.gap.options import add_recording_options
from atw_mcp.observation.recording_options import read_with_remarks, recording_form
from atw_mcp.observation.recording_records import case_recording
from polyworld.data.recording_header import RecordingForm
from polyworld.world import World
from tests.atw_mcp.gap.thrown_ball import MASS, flown, world
from tests.atw_mcp.session import Session

README = Path(__file__).parents[3] / "README.md"


def form(*given: str) -> RecordingForm:
    """The form that some options give."""
    parser = argparse.ArgumentParser()
    add_recording_options(parser)
    return recording_form(parser.parse_args(list(given)))


def test_the_table_of_a_spreadsheet_and_a_ball_in_one_option_name_the_drag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The flights of `thrown_ball` in other units and signs, without a column object, rows reversed, with notes."""
    rows = [
        f"r{i};{1e3 * t:.4f};{1e3 * x:.3f};{1e3 * y:.3f};{1e3 * z:.3f};ok".replace(".", ",")
        for i, run in enumerate(flown())
        for t, x, y, z in run[::-1]
    ]
    path = tmp_path / "flights.csv"
    path.write_text("\ufeffTrial;Time (ms);X;Y;Height [mm];Note\n# by hand\n" + "\n".join(rows) + "\n")
    options = ["--object", f"ball:sphere:r=10cm:{1e3 * MASS:g}g", "--units", "x=mm,y=mm"]
    options += ["--effects", "quadratic_drag", "--max-effects", "1"]
    assert main(["gap", "--data", str(path), *options]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("identified: quadratic_drag")
    assert "flights.csv: columns not used: Note" in printed.err


def test_the_gap_that_the_readme_shows_is_what_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    throws = resources.files("atw_mcp") / "demo" / "flights.csv"
    assert main(["gap", "--data", str(throws), "--object", "ball:sphere:d=40mm:2.7g"]) == 0
    printed, shown = capsys.readouterr().out, README.read_text()
    for figures in (
        "identified: quadratic_drag (coefficient 0.0003775 kg/m, 95% 0.0003703 to 0.0003847)",
        "9.865 standard deviations of the noise without an effect, 1.019 with it",
        "gap 0.004749 m before, 0 after, 100% closed; noise 0.001101 m",
    ):
        assert figures in printed
        assert figures in shown


def test_options_give_the_form_of_a_table() -> None:
    assert form() == RecordingForm()
    assert form("--fps", "240").seconds_per_frame == pytest.approx(1 / 240)
    assert form("--seconds-per-frame", "0.028").seconds_per_frame == 0.028
    given = form("--pixels-per-metre", "812", "--origin-pixel", "320,240", "--image-axes", "--view", "top").pixels
    assert given is not None
    assert (given.per_metre, given.origin, given.image_axes, given.view) == (812.0, (320.0, 240.0), True, "top")
    assert form("--theta-described", "90deg").theta_described == pytest.approx(math.pi / 2)
    assert form("--theta-hanging").theta_hanging == 0.0
    assert form("--theta-hanging", "180deg").theta_hanging == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--units", "mm,parsec"], "--units: 'parsec' is no unit"),
        (["--fps", "0"], "--fps and --seconds-per-frame take a positive number"),
        (["--image-axes", "--view", "top"], "--image-axes, --view go with --pixels-per-metre"),
        (["--pixels-per-metre", "-5"], "--pixels-per-metre: the scale must be a positive number"),
        (["--pixels-per-metre", "5", "--origin-pixel", "320"], "--origin-pixel takes two numbers U,V such as 320,240"),
        (["--theta-described", "3mm"], "--theta-described: '3mm': 'mm' is no unit of angle; choose from rad, deg"),
    ],
)
def test_options_that_do_not_fit_are_refused_by_name(given: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=r"\w") as raised:
        form(*given)
    assert message in str(raised.value)


def test_remarks_are_printed_once_with_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "far.csv"
    path.write_text("timestamp,x,note\n1700000000,0,\n1700000000.1,9,\n")
    read_with_remarks(path, form(), World.model_validate(world()))
    remarks = capsys.readouterr().err.splitlines()
    assert [line.partition(": ")[0] for line in remarks] == ["far.csv", "far.csv"]
    assert "counted from the first one" in remarks[1]


def test_columns_are_given_as_messages_have_them(tmp_path: Path) -> None:
    path = tmp_path / "far.csv"
    path.write_text("0,1,2\n0.1,900,3\n")
    given = form("--columns", "{'1': 't [s]', '2': 'z [mm]', '3': '-'}")
    run = read_with_remarks(path, given, World.model_validate(world())).runs[0]
    assert run.positions[:, 0, 2].tolist() == [0.001, 0.9]
    with pytest.raises(ValueError, match="--columns takes headers and what they mean"):
        form("--columns", "1=t")


def test_an_error_in_the_table_names_file_line_column_and_cure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "flights.csv"
    path.write_text("t,x [mm]\n0,0\n0.1,?\n")
    assert main(["gap", "--data", str(path), "--object", "ball:sphere:2cm:3g"]) == 1
    printed = capsys.readouterr().err
    assert printed == "flights.csv: line 3: x [mm] is not a number: '?'; a cell that was not measured is empty\n"


def test_imported_spins_and_frames_stay_with_the_case(tmp_path: Path) -> None:
    call = Session(tmp_path / "atw.db")
    path = tmp_path / "spun.csv"
    rows = [f"a,ball,{f},{f},0,{10 * f},{60 * (f % 2)}" for f in range(30)]
    path.write_text("run,object,frame,x [mm],y [mm],z [mm],wz [rpm]\n" + "\n".join(rows) + "\na,other,0,1,1,1,\n")
    call("OpenCase", data=str(path), name="c")
    arguments = {"case": "c", "kind": "recording", "path": str(path), "seconds_per_frame": 0.01}
    imported = call("ImportObservation", **arguments, sealed_runs=[])
    assert imported["data"]["runs"][0]["spins"] is True
    assert imported["data"]["runs"][0]["to"] == pytest.approx(0.29)
    app = App(tmp_path / "atw.db")
    kept = case_recording(app, app.case("c"), World.model_validate(world())).parts.fitted.runs[0]
    assert kept.names == ("ball",)
    assert kept.positions[5, 0].tolist() == pytest.approx([0.005, 0.0, 0.05])
    assert kept.angular_velocities[:2, 0, 2].tolist() == pytest.approx([0.0, 2 * math.pi])
    assert np.isnan(kept.angular_velocities[:, 0, :2]).all()


def test_a_table_of_two_described_bodies_names_the_row_that_belongs_to_neither(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "two.csv"
    described = ["--object", "a:sphere:d=40mm:2.7g", "--object", "b:box:4cm:50g"]
    path.write_text("object,t,x\na,0,0\na,0.1,0\nc,0,1\n")
    assert main(["gap", "--data", str(path), *described]) == 1
    assert capsys.readouterr().err == (
        "two.csv: line 4: object is 'c', but the world has only a, b; describe 'c' in the world or leave its rows out\n"
    )
    path.write_text("t,x\n0,0\n0.1,0\n")
    assert main(["gap", "--data", str(path), *described]) == 1
    assert capsys.readouterr().err.startswith("two.csv: line 1: column object is missing, and")
    path.write_text("object,t,theta\na,0,0\na,0.1,0\n")
    assert main(["gap", "--data", str(path), *described]) == 1
    assert "line 1: theta of object 'a': an angle does not place it: no hinge" in capsys.readouterr().err
    path.write_text("object,t,x\na,0,0\na,0.1,0\n")
    assert main(["gap", "--data", str(path), *described, "--theta-hanging"]) == 1
    assert "line 1: theta_hanging is given, but column theta is missing" in capsys.readouterr().err
