"""Recordings: their checks, and CSV files in and out, well formed and not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.data.recording_csv import parse_recording, read_recording
from polyworld.data.tracks import ObservedTracks


def run(name: str = "a", t: int = 4, n: int = 1) -> Run:
    return Run(name, tuple("uvw"[:n]), np.arange(t) * 0.1, np.zeros((t, n, 3)), np.full((t, n, 4), np.nan))


def test_runs_and_objects_may_have_times_of_their_own() -> None:
    text = """\
# thrown twice
run,object,t,x,y,z
one,ball,0.0,1,2,3
one,ball,0.1,1.5,,3
one,disc,0.05,7,8,9

two,ball,10,0,0,0
# a pause
two,ball,10.25,0,0,nan
"""
    recording = parse_recording(text)
    assert [r.name for r in recording.runs] == ["one", "two"]
    one, two = recording.runs
    assert one.names == ("ball", "disc")
    assert two.names == ("ball",)
    assert one.times.tolist() == [0.0, 0.05, 0.1]
    assert two.times.tolist() == [10.0, 10.25]
    assert np.array_equal(one.positions[:, 0], [[1, 2, 3], [np.nan] * 3, [1.5, np.nan, 3]], equal_nan=True)
    assert np.array_equal(one.positions[:, 1], [[np.nan] * 3, [7, 8, 9], [np.nan] * 3], equal_nan=True)
    assert np.isnan(one.orientations).all()
    assert np.isnan(two.positions[1, 0, 2])


def test_rows_and_columns_may_come_in_any_order() -> None:
    text = "Z, T ,object,run\n3,0.2,b,r\n1,0,b,r\n2,0.1,b,r\n"
    (only,) = parse_recording(text).runs
    assert only.times.tolist() == [0.0, 0.1, 0.2]
    assert only.positions[:, 0, 2].tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(only.positions[:, 0, :2]).all()


def test_without_run_and_object_there_is_one_run_of_the_only_object() -> None:
    recording = parse_recording("t,x\n0,1\n1,2\n", objects=("cart",))
    assert [r.names for r in recording.runs] == [("cart",)]
    with pytest.raises(ValueError, match="the world has 2: cart, cube"):
        parse_recording("t,x\n0,1\n", objects=("cart", "cube"))
    with pytest.raises(ValueError, match="column object is missing"):
        parse_recording("t,x\n0,1\n")


def test_quaternions_are_normalised_and_may_be_absent_in_rows() -> None:
    text = "object,t,qw,qx,qy,qz\nb,0,0.9999,0.014,0,0\nb,1,,,,\nb,2,0.6,0,0.8,0\n"
    (only,) = parse_recording(text).runs
    assert np.linalg.norm(only.orientations[0, 0]) == pytest.approx(1.0, abs=1e-15)
    assert np.isnan(only.orientations[1]).all()
    assert only.orientations[2, 0].tolist() == [0.6, 0.0, 0.8, 0.0]


def test_times_that_differ_by_rounding_are_one_instant() -> None:
    (only,) = parse_recording("object,t,x\na,0.3,1\nb,0.30000000000000004,2\na,0.4,1\nb,0.4,2\n").runs
    assert only.times.tolist() == [0.3, 0.4]
    assert only.positions[0, :, 0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no rows; expected a header"),
        ("# only a comment\n\n", "no rows; expected a header"),
        ("object,t,x\n", "line 1 is a header, but no rows"),
        ("0,1,2\n3,4,5\n", "line 1 has none of the columns"),
        ("object,x,y\na,0,1\n", "column t .* is missing"),
        ("object,t\na,0\n", "nothing measured"),
        ("object,t,x,x\na,0,1,1\n", "columns repeat: x"),
        ("object,t,x,qw,qx\na,0,1,1,0\n", "needs all of qw, qx, qy, qz; there is only qw, qx"),
        ("object,t,x\na,0,1\n\na,1\n", "line 4: 2 cells, expected 3"),
        ("object,t,x\na,0,1,2\n", "line 2: 4 cells, expected 3"),
        ("object,t,x\na,0,one\n", "line 2: x is not a number: 'one'"),
        ("object,t,x\na,0,1\na,1,inf\n", "line 3: x is not finite"),
        ("object,t,x\na,,1\n", "line 2: t is empty"),
        ("object,t,x\n,0,1\n", "line 2: object is empty"),
        ("run,object,t,x\n,a,0,1\n", "line 2: run is empty"),
        (
            "object,t,x\na,0,1\nb,0,1\na,0.0,2\n",
            "line 4: run '1' has object 'a' at t = 0 in line 2 already, with another x",
        ),
        ("object,t,qw,qx,qy,qz\na,0,1,0,,0\n", "line 2: .* measured are qw, qx, qz"),
        ("object,t,qw,qx,qy,qz\na,0,0,0,0,0\n", "line 2: .* norm 0, expected 1"),
        ("object,t,qw,qx,qy,qz\na,0,2,0,0,0\n", "line 2: .* norm 2, expected 1"),
        ('object,t,x\n"a,0,1\n', "line 2: "),
        ("object,t,x\na,0,1\n", "line 2 is the only row: motion needs rows of two instants"),
        ("object,t,x,confidence\na,0,1,7\n", "line 2: confidence must lie in 0..1, got 7"),
        ("object,t,x,sigma\na,0,1,0\n", "line 2: sigma must be above 0"),
        ("object,t,x [mm],sigma\na,0,1,0.1\n", "column 'sigma' states no unit, but 'x .mm.' does"),
        ("frame,object,t,x\n0.5,a,0,1\n", "line 2: frame must be a whole number, got 0.5"),
    ],
)
def test_malformed_files_are_refused_with_the_line(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_recording(text)


def test_a_file_is_named_in_its_errors(tmp_path: Path) -> None:
    path = tmp_path / "drop.csv"
    path.write_text("object,t,x\na,0,?\n")
    with pytest.raises(ValueError, match=r"drop\.csv: line 2: x is not a number"):
        read_recording(path)
    path.write_bytes(b"object,t,x\na,0,1\xff\n")
    with pytest.raises(ValueError, match=r"drop\.csv: line 2 is not in UTF-8 .* export the table as CSV in UTF-8"):
        read_recording(path)
    path.write_bytes("﻿object,t,x\r\na,0,1\r\na,1,1\r\n".encode())  # as spreadsheets write it
    assert read_recording(path).runs[0].positions[0, 0, 0] == 1.0


def test_a_run_checks_shapes_times_and_names() -> None:
    with pytest.raises(ValueError, match=r"expected \(4, 1, 3\) and \(4, 1, 4\)"):
        Run("a", ("u",), np.arange(4.0), np.zeros((4, 1, 2)), np.zeros((4, 1, 4)))
    with pytest.raises(ValueError, match="must be finite and increase"):
        Run("a", ("u",), np.array([0.0, 1.0, 1.0, 2.0]), np.zeros((4, 1, 3)), np.zeros((4, 1, 4)))
    with pytest.raises(ValueError, match="object names repeat"):
        Run("a", ("u", "u"), np.arange(4.0), np.zeros((4, 2, 3)), np.zeros((4, 2, 4)))
    with pytest.raises(ValueError, match=r"angular_velocities \(4, 2, 3\), expected \(4, 1, 3\)"):
        replace(run(), angular_velocities=np.zeros((4, 2, 3)))
    assert run(n=2).symmetry == (1, 1)
    assert len(run().rows(np.array([True, False, True, True])).times) == 3


def test_a_recording_has_runs_of_different_names_and_lists_them() -> None:
    with pytest.raises(ValueError, match="at least one run"):
        Recording(())
    with pytest.raises(ValueError, match="names of runs repeat"):
        Recording((run("a"), run("a")))
    recording = Recording((run("a"), run("b")))
    assert recording.select(("b",)).runs == (recording.run("b"),)
    with pytest.raises(KeyError, match=r"unknown run 'c'; runs: \['a', 'b'\]"):
        recording.run("c")


def test_a_run_of_tracks_leaves_out_what_nobody_saw() -> None:
    tracks = ObservedTracks(
        names=("u",),
        frames=np.arange(3),
        seconds_per_frame=0.04,
        positions=np.ones((3, 1, 3)),
        position_sigma=np.full((3, 1), 0.02),
        orientations=np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1)),
        confidence=np.array([[1.0], [0.0], [0.5]]),
        orientation_confidence=np.array([[0.0], [0.0], [1.0]]),
        symmetry=(4,),
    )
    made = Run.of_tracks("video", tracks)
    assert np.isfinite(made.positions[:, 0]).all(axis=1).tolist() == [True, False, True]
    assert np.isfinite(made.orientations[:, 0]).all(axis=1).tolist() == [False, False, True]
    assert made.times == pytest.approx([0.0, 0.04, 0.08])
    assert (made.sigma, made.symmetry) == (0.02, (4,))
