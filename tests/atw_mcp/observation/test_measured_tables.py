"""Tables of measured motion through the tools: exact times, units and axes read or asked for, never guessed."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.atw_mcp.session import Session
from tests.shared_inputs import INPUTS, needs_input

PIXEL = {"x [px]": "x [0.01 m]", "y [px]": "z [-0.01 m]"}  # the inputs were drawn at 100 pixels a metre
FILM = 1.0 / 60.0
BALL = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.02}, "position": [0.0, 0.0, 1.0], "mass": 0.1}


def opened(session: Session, tmp_path: Path, name: str) -> dict[str, str]:
    """Case and path of a copy of an input that the server may read."""
    path = tmp_path / name
    shutil.copyfile(INPUTS / name, path)
    return {"case": session("OpenCase", data=str(path))["case"], "path": str(path)}


def velocities(session: Session, case: str, name: str) -> np.ndarray[Any, Any]:
    """Measured velocities (n, 3) along x: the value and its interval."""
    asked = session("InspectObservedMotion", case=case, object=name, quantities=["velocity"], limit=500)
    derived = asked["data"]["derived"]
    return np.array([row[derived["columns"].index("vx")] for row in derived["rows"]])


@pytest.mark.parametrize(
    ("name", "more", "speed"),
    [
        pytest.param(name, more, speed, marks=needs_input(name), id=name)
        for name, more, speed in (
            ("tracks_vfr_times.csv", {}, 3.0),
            ("tracks_vfr_frame_and_t.csv", {}, 3.0),
            ("tracks_alternating_5ms_3.33ms.csv", {}, 3.0),
            ("tracks_units_in_header.csv", {}, 1.5),
            ("tracks_mm_no_units.csv", {"columns": {c: f"{c} [m{'s' if c == 't' else 'm'}]" for c in "txyz"}}, 1.5),
            ("tracks_y_up_no_z.csv", {"columns": {"y": "z"}}, 1.5),
            ("unix_ms_relative.csv", {"columns": {"timestamp": "t [ms]"}}, 1.5),
            ("tracker_single_mass_A.txt", {"columns": {"y": "z"}}, 1.5),
            ("tracker_multi_masses.txt", {"columns": {"y": "z"}}, 1.5),
            ("loggerpro_latest_prefix.csv", {"columns": {"Y (m)": "z"}}, 1.5),
            ("dlc_three_header_rows.csv", {"columns": PIXEL, "seconds_per_frame": FILM}, 1.5),
            ("trackpy_link_table.csv", {"columns": PIXEL, "seconds_per_frame": FILM}, 1.5),
            (
                "trackmate_four_header_rows.csv",
                {"columns": {k.replace("px", "pixel"): v for k, v in PIXEL.items()}},
                1.5,
            ),
        )
    ],
)
def test_tracks_of_a_table_have_the_velocity_of_the_motion(
    session: Session, tmp_path: Path, name: str, more: dict[str, Any], speed: float
) -> None:
    where = opened(session, tmp_path, name)
    imported = session("ImportObservation", kind="tracks", **where, **more)
    found = velocities(session, where["case"], imported["data"]["objects"][0]["name"])
    assert found[:, 0].mean() == pytest.approx(speed, rel=0.002)
    assert np.all(np.abs(found[:, 0] - speed) < 0.02 * speed)


@needs_input("tracks_vfr_times.csv")
def test_measured_times_come_out_as_they_went_in(session: Session, tmp_path: Path) -> None:
    where = opened(session, tmp_path, "tracks_vfr_times.csv")
    imported = session("ImportObservation", kind="tracks", **where)
    assert "measured at times of their own up to 0.0" in imported["summary"]
    seen = session("InspectObservedMotion", case=where["case"], object="ball", limit=500)["data"]
    times = [row[seen["columns"].index("time")] for row in seen["rows"]]
    with (INPUTS / "tracks_vfr_times.csv").open() as file:
        assert times == pytest.approx([float(row["t"]) for row in csv.DictReader(file)], abs=1e-12)


@needs_input("tracks_vfr_times.csv")
def test_a_fit_of_unevenly_sampled_tracks_is_at_their_own_times(session: Session, tmp_path: Path) -> None:
    where = opened(session, tmp_path, "tracks_vfr_times.csv")
    session("ImportObservation", kind="tracks", **where)
    ball = {k: v for k, v in BALL.items() if k != "position"}
    built = session("BuildWorld", case=where["case"], objects=[ball], floor="none")
    fitted = session("FitWorld", case=where["case"], world=built["source"]["world"], patience_seconds=300)
    assert fitted["data"]["position_rmse"] < 0.003  # the noise is 1 mm a coordinate
    read = session(
        "ReadProperty", case=where["case"], world=fitted["data"]["world"], objects=["ball"], property="velocity"
    )
    assert read["data"]["values"][0]["value"][0] == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize("kind", ["tracks", "recording"])
@pytest.mark.parametrize(
    ("name", "says"),
    [
        pytest.param(name, says, marks=needs_input(name), id=name)
        for name, says in (
            (
                "tracks_mm_no_units.csv",
                "column 't' states no unit, and rows are 16.67 apart in it: state it, as",
            ),
            ("tracks_y_up_no_z.csv", "line 1: columns x and y without z: state whether y is height, as columns="),
            ("tracker_txy_y_up.csv", "line 1: columns x and y without z: state whether y is height, as columns="),
            ("loggerpro_latest_prefix.csv", "line 1: columns X (m) and Y (m) without z: state whether Y (m) is height"),
            ("tracker_multi_masses.txt", "line 3: columns x and y without z"),
            ("capstone_run_columns.csv", "line 1: column 'Position (m)' does not state its axis"),
            ("dlc_three_header_rows.csv", "for frame numbers give seconds_per_frame"),
            ("trackmate_four_header_rows.csv", "line 1: columns x [pixel] and y [pixel] are pixels: state the length"),
        )
    ],
)
def test_what_a_table_does_not_state_is_asked_for_alike(
    session: Session, tmp_path: Path, name: str, says: str, kind: str
) -> None:
    assert says in session.refused("ImportObservation", kind=kind, **opened(session, tmp_path, name))


@needs_input("ok_txz.csv")
def test_a_recording_of_runs_in_x_and_z_is_read(session: Session, tmp_path: Path) -> None:
    where = opened(session, tmp_path, "ok_txz.csv")
    session("BuildWorld", case=where["case"], objects=[BALL])
    read = session("ImportObservation", kind="recording", **where)["data"]
    assert [(run["run"], run["instants"]) for run in read["runs"]] == [(f"r{k}", 40) for k in range(4)]


@needs_input("capstone_run_columns.csv")
def test_runs_of_capstone_are_read_once_their_axis_is_stated(session: Session, tmp_path: Path) -> None:
    where = opened(session, tmp_path, "capstone_run_columns.csv")
    session("BuildWorld", case=where["case"], objects=[BALL])
    read = session("ImportObservation", kind="recording", columns={"Position (m)": "z"}, **where)["data"]
    assert [run["run"] for run in read["runs"]] == ["Run #1", "Run #2"]


@pytest.mark.parametrize(("scale", "said"), [(1.0, False), (1000.0, True)])
def test_places_that_reach_far_without_a_unit_are_stated(
    session: Session, tmp_path: Path, scale: float, said: bool
) -> None:
    """A throw of 0.4 m in millimetres could as well be one of 400 m: it is read, and the cure is named."""
    t = np.arange(0.0, 0.5, 1.0 / 60.0)
    places = scale * np.column_stack([0.4 * t, 1.9 * t - 4.905 * t * t])
    path = tmp_path / "throw.csv"
    np.savetxt(path, np.column_stack([t, places]), delimiter=",", header="t,x,z", comments="")
    case = session("OpenCase", data=str(path))["case"]
    left_out = session("ImportObservation", case=case, kind="tracks", path=str(path))["data"]["left_out"]
    assert any("places extend over 411.3 m; where they are in millimetres" in text for text in left_out) is said
