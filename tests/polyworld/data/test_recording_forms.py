"""Tables of measured motion as spreadsheets, trackers and encoders write them: names, units, signs, pixels, angles."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from polyworld.data.pixel_scale import PixelScale
from polyworld.data.recording import Run
from polyworld.data.recording_csv import parse_recording, read_recording
from polyworld.data.recording_header import RecordingForm
from polyworld.world import World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere


def only(text: str, form: RecordingForm | None = None, world: World | None = None) -> Run:
    """The only run of a table that shows the ball, or the world's only object."""
    objects = ("ball",) if world is None else ()
    (run,) = parse_recording(text, objects, form=form or RecordingForm(), world=world).runs
    return run


def refusal(text: str, form: RecordingForm | None = None, world: World | None = None) -> str:
    """The message with which a table is refused."""
    with pytest.raises(ValueError, match=r"\w") as raised:
        only(text, form, world)
    return str(raised.value)


@pytest.mark.parametrize(
    "header",
    [
        "t [ms],x [mm]",
        "T_ms,X_mm",
        "Time (ms),x (mm)",
        "timestamp/ms,x/mm",
        "time_in_ms,x position [mm]",
        "elapsed_time (milliseconds),pos_x_mm",
    ],
)
def test_headers_state_units_in_the_usual_ways(header: str) -> None:
    run = only(f"{header}\n0,1500\n20,1600\n")
    assert run.times.tolist() == pytest.approx([0.0, 0.02])
    assert run.positions[:, 0, 0].tolist() == pytest.approx([1.5, 1.6])


def test_units_given_beside_the_file_are_of_columns_that_state_none() -> None:
    text = "t,x,z [m],theta\n0,1500,2,0\n20,1600,3,0\n"
    with pytest.warns(UserWarning, match="theta"):
        run = only(text, RecordingForm(units="mm,ms"))
    assert run.times[1] == pytest.approx(0.02)
    assert run.positions[1, 0, ::2].tolist() == pytest.approx([1.6, 3.0])
    run = only("t,x,z\n0,1,2\n1,1,2\n", RecordingForm(units="x=cm, height=mm"))
    assert run.positions[0, 0].tolist() == pytest.approx([0.01, math.nan, 0.002], nan_ok=True)


@pytest.mark.parametrize(
    ("header", "units", "message"),
    [
        ("t,x [furlong]", "", "line 1: column 'x [furlong]' states an unknown unit; x is in one of m, cm"),
        ("t,x [ms]", "", "line 1: column 'x [ms]': ms is a unit of time; x is in one of m, cm"),
        ("t,x [cm]", "x=mm", "line 1: column 'x [cm]' is in cm, but mm is given for x"),
        ("t,x", "z=mm", "line 1: a unit is given for z, which no column holds"),
        ("t,x", "x=deg", "deg is a unit of angle; x is in one of m, cm"),
        ("t,x", "lightyears", "'lightyears' is no unit; known are s, ms"),
        ("t,x", "mm,cm", "two units of length; name the column, as in x=cm"),
        ("t,x", "mass=mm", "'mass' is no column with a unit; those are t, x"),
        ("timestamp,time,x", "", "line 1: columns 'timestamp' and 'time' both give t; keep one of them"),
        ("t,x [m],x [mm]", "", "line 1: columns repeat: x [mm]"),
    ],
)
def test_units_that_do_not_fit_are_refused(header: str, units: str, message: str) -> None:
    row = ",".join("1" for _ in header.split(","))
    assert message in refusal(f"{header}\n{row}\n", RecordingForm(units=units))


def test_a_line_of_units_below_the_header_is_read() -> None:
    run = only("Time,Object,X,Height\nms,,mm,cm\n0,ball,1000,50\n5,ball,1001,\n")
    assert run.times[1] == pytest.approx(0.005)
    assert run.positions[:, 0].tolist()[0] == pytest.approx([1.0, math.nan, 0.5], nan_ok=True)
    assert np.isnan(run.positions[1, 0, 2])


def test_aliases_give_runs_and_objects_and_a_quantity_by_its_own_name_wins() -> None:
    text = "trial,Name,time,height\na,ball,0,1\nb,ball,0,2\n"
    assert [(r.name, r.names, r.positions[0, 0, 2]) for r in parse_recording(text).runs] == [
        ("a", ("ball",), 1.0),
        ("b", ("ball",), 2.0),
    ]
    with pytest.warns(UserWarning, match="columns not used: Height"):
        assert only("t,z,Height\n0,1,5\n1,1,5\n").positions[0, 0, 2] == 1.0


@pytest.mark.parametrize("mark", [";", "\t"])
def test_semicolons_tabs_and_decimal_commas(mark: str) -> None:
    text = "\ufefft,x,z\n0,1,2\n".replace(",", mark) + f"0,5{mark}−1,25{mark},5\n1{mark}NA{mark}1,5e-3\n"
    run = only(text)
    assert run.times.tolist() == [0.0, 0.5, 1.0]
    assert run.positions[1, 0, ::2].tolist() == [-1.25, 0.5]
    assert np.isnan(run.positions[2, 0, 0])
    assert run.positions[2, 0, 2] == 0.0015


def test_blanks_separate_cells_and_numpy_writes_its_header_as_a_comment(tmp_path: Path) -> None:
    path = tmp_path / "saved.csv"
    np.savetxt(path, [[0.0, 1.0], [0.1, 2.0]], header="measured today\nt x_mm")
    run = read_recording(path, ("ball",)).runs[0]
    assert run.times.tolist() == [0.0, 0.1]
    assert run.positions[:, 0, 0].tolist() == pytest.approx([0.001, 0.002])


def test_spreadsheets_save_utf16_with_empty_columns_and_rows(tmp_path: Path) -> None:
    path = tmp_path / "sheet.txt"
    path.write_bytes("sep=\t\nt\tx\n0\t1\t\t\n\t\t\t\n1\t2\t\t\n".encode("utf-16"))
    assert read_recording(path, ("ball",)).runs[0].positions[:, 0, 0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t;x\n0;1,5\n1;2.5\n", "line 2: x is '1,5' with a comma, but line 3 has '2.5' with a point"),
        ("t;x\n0;1.234,5\n", "line 2: x is not a number: '1.234,5'; write numbers without signs between thousands"),
        ("t,x\n0,1,0,5\n0,1,0,6\n", "line 3: 4 cells, expected 2 as in the header; if these are decimal commas"),
        ("t,x\n0:01.5,1\n", "line 2: t is not a number: '0:01.5'; write times as numbers"),
    ],
)
def test_numbers_that_could_be_read_two_ways_are_refused(text: str, message: str) -> None:
    assert message in refusal(text)


def test_errors_of_one_kind_are_listed_three_times_and_then_counted() -> None:
    text = "t,x,z\n" + "".join(f"{i},bad{i},1\n" for i in range(20)) + "20,1,inf\n"
    first, second = refusal(text).splitlines()
    assert first.startswith("line 2: x is not a number: 'bad0'; line 3: ")
    assert "'bad2'; and 17 more; a cell that was not measured is empty" in first
    assert "bad3" not in first
    assert second.startswith("line 22: z is not finite")


def test_a_row_that_comes_twice_is_merged_with_what_the_other_lacks() -> None:
    run = only("t,x,z\n0,1,\n1,3,4\n0,1,2\n0,1,2\n")
    assert run.times.tolist() == [0.0, 1.0]
    assert run.positions[0, 0, ::2].tolist() == [1.0, 2.0]


def test_a_quaternion_and_its_negative_are_one_rotation() -> None:
    assert len(only("t,qw,qx,qy,qz\n0,0.6,0,0.8,0\n0,-0.6,0,-0.8,0\n").times) == 1


def test_repeated_times_are_refused_with_their_likely_cause() -> None:
    rounded = "t,x\n" + "".join(f"{i / 120:.2f},{i}\n" for i in range(30))
    assert "times are rounded to 0.01 s and rows are 0.00828 s apart" in refusal(rounded)
    again = "t,x\n" + "".join(f"{i % 10 / 10},{i}\n" for i in range(20))
    assert "line 12: run '1' has object 'ball' at t = 0 in line 2 already, with another x" in refusal(again)
    assert "the time starts again there" in refusal(again)
    assert "correct the time or delete one of the rows" in refusal("t,x\n0,1\n0.25,2\n0.25,3\n0.5,4\n")


def test_frames_are_counted_with_the_seconds_given() -> None:
    text = "frame,t,x\n100,7,1\n102,8,2\n"
    with pytest.warns(UserWarning, match="columns not used: t"):
        run = only(text, RecordingForm(seconds_per_frame=0.004))
    assert run.times.tolist() == pytest.approx([0.4, 0.408])
    with pytest.warns(UserWarning, match="columns not used: frame"):
        assert only(text).times.tolist() == [7.0, 8.0]
    assert "for frame numbers give seconds_per_frame" in refusal("frame,x\n1,2\n")
    assert "column frame is missing" in refusal("t,x\n1,2\n", RecordingForm(seconds_per_frame=0.1))


def test_times_since_a_date_count_from_the_first() -> None:
    with pytest.warns(UserWarning, match="counted from the first one"):
        run = only("timestamp,x\n1700000000.5,1\n1700000001.0,2\n")
    assert run.times.tolist() == [0.0, 0.5]


def test_spins_are_read_in_their_units() -> None:
    run = only("t,x,wx [rpm],omega_z (deg/s)\n0,1,60,180\n1,1,,90\n")
    assert run.angular_velocities[0, 0].tolist() == pytest.approx([2 * math.pi, math.nan, math.pi], nan_ok=True)
    assert np.isnan(run.angular_velocities[1, 0, :2]).all()


def test_units_of_numbers_that_are_hardly_metres_or_seconds_are_asked_for() -> None:
    far = "t,x\n0,0\n0.1,1200\n"
    assert refusal(far) == (
        "line 1: column 'x' states no unit, and its numbers extend over 1200: state it, as columns={'x': 'x [mm]'}, or "
        "'x [m]' if these are metres"
    )
    assert only(far, RecordingForm(columns={"x": "x [m]"})).positions[1, 0, 0] == 1200.0
    slow = "t,x\n0,0\n33,1\n66,1\n"
    assert "column 't' states no unit, and rows are 33 apart in it: state it, as columns={'t': 't [ms]'}" in refusal(
        slow
    )
    assert only(slow, RecordingForm(columns={"t": "t [ms]"})).times.tolist() == pytest.approx([0.0, 0.033, 0.066])


def test_axes_that_are_not_stated_are_asked_for() -> None:
    text = "t,x,y\n0,1,2\n1,1,3\n"
    assert "state whether y is height, as columns={'y': 'z'}, or runs along the floor" in refusal(text)
    assert only(text, RecordingForm(columns={"y": "z"})).positions[1, 0].tolist() == pytest.approx(
        [1.0, math.nan, 3.0], nan_ok=True
    )
    assert only(text, RecordingForm(columns={"y": "y [cm]"})).positions[1, 0, 1] == pytest.approx(0.03)
    assert "no column is called 'Y'; columns: t, x, y; others by their places, 1 to 3" in refusal(
        text, RecordingForm(columns={"Y": "z"})
    )


# --- pixels ---

SIDE = PixelScale(per_metre=100.0, origin=(320.0, 240.0), image_axes=True)


@pytest.mark.parametrize("header", ["t,u,v", "t,x_px,y_px", "t,x [px],y [pixels]", "t,pixel_x,pixel_y", "t,x,y"])
def test_pixels_of_a_side_view_give_x_and_height(header: str) -> None:
    run = only(f"{header}\n0,420,140\n1,420,\n", RecordingForm(pixels=SIDE))
    assert run.positions[0, 0].tolist() == pytest.approx([1.0, math.nan, 1.0], nan_ok=True)
    assert np.isnan(run.positions[1, 0, 2])


def test_pixels_of_a_top_view_give_x_and_y_and_may_count_upwards() -> None:
    run = only("t,u,v\n0,50,300\n1,50,300\n", RecordingForm(pixels=PixelScale(per_metre=100.0, view="top")))
    assert run.positions[0, 0].tolist() == pytest.approx([0.5, 3.0, math.nan], nan_ok=True)


def test_pixels_without_a_scale_and_a_scale_without_pixels_are_refused() -> None:
    assert "line 1: columns u and v are pixels: state the length of one" in refusal("t,u,v\n0,1,2\n")
    assert "there are x, z" in refusal("t,x,z\n0,1,2\n", RecordingForm(pixels=SIDE))
    assert "states a unit of length" in refusal("t,x [mm],y [mm]\n0,1,2\n", RecordingForm(pixels=SIDE))
    with pytest.raises(ValueError, match="positive number of pixels per metre, got 0"):
        PixelScale(per_metre=0.0)


def test_a_speed_called_v_is_no_pixel() -> None:
    with pytest.warns(UserWarning, match=r"columns not used: u \[m/s\], v \[m/s\]"):
        assert only("t,z,u [m/s],v [m/s]\n0,1,2,3\n1,1,2,3\n").positions[0, 0, 2] == 1.0


# --- angles ---


def pendulum(angle: float = 0.0, arm: float = 2.0, **more: object) -> World:
    """A bob that hangs from a hinge along y at height 3 m, turned by `angle` [rad] about it."""
    bob = RigidObject(
        name="bob",
        shape=Sphere(radius=0.1),
        position=(-arm * math.sin(angle), 0.5, 3.0 - arm * math.cos(angle)),
        orientation=(math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0),
    )
    hinge = Hinge(name="hinge", object="bob", anchor=(0.0, 0.0, 3.0), axis=(0.0, 2.0, 0.0))
    return World.model_validate({"objects": (bob,), "joints": (hinge,), **more})


def test_an_angle_places_a_body_on_its_hinge() -> None:
    run = only("t,theta [deg]\n0,0\n1,90\n2,\n", world=pendulum())
    assert run.names == ("bob",)
    assert run.positions[0, 0].tolist() == pytest.approx([0.0, math.nan, 1.0], nan_ok=True)
    # By the right-hand rule about +y what hangs (-z) goes towards -x.
    assert run.positions[1, 0].tolist() == pytest.approx([-2.0, math.nan, 3.0], nan_ok=True)
    assert np.isnan(run.positions[2]).all()
    assert np.isnan(run.orientations).all()  # the one number measured is counted once
    assert run.arms == (2.0,)


@pytest.mark.parametrize("start", [0.0, 0.7, -2.0])
def test_the_zero_of_an_angle_is_the_described_pose_or_where_the_body_hangs(start: float) -> None:
    world = pendulum(start)
    hanging = only(f"t,theta\n0,{math.pi}\n1,{math.pi + start}\n", RecordingForm(theta_hanging=math.pi), world)
    assert hanging.positions[0, 0, [0, 2]].tolist() == pytest.approx([0.0, 1.0])
    assert hanging.positions[1, 0, [0, 2]].tolist() == pytest.approx([world.objects[0].position[i] for i in (0, 2)])
    described = only("t,theta\n0,0.2\n1,0.2\n", RecordingForm(theta_described=0.2), world)
    assert described.positions[0, 0, [0, 2]].tolist() == pytest.approx([world.objects[0].position[i] for i in (0, 2)])


def test_an_angle_of_a_wheel_is_its_orientation() -> None:
    run = only("t,angle\n0,0\n1,0.4\n", world=pendulum(arm=0.0))
    assert np.isnan(run.positions).all()
    assert run.orientations[1, 0].tolist() == pytest.approx([math.cos(0.2), 0.0, math.sin(0.2), 0.0])


def test_an_angle_without_a_hinge_to_the_world_is_refused() -> None:
    text = "t,theta\n0,0\n"
    assert "theta of object 'ball' needs a world with its hinge" in refusal(text)
    loose = pendulum().model_copy(update={"joints": ()})
    assert refusal("t;theta [deg]\n0;0\n", world=loose) == (
        "line 1: theta [deg] of object 'bob': an angle does not place it: no hinge of the world holds it; describe "
        "such a hinge in the world, or give x, y, z"
    )
    cart = RigidObject(name="cart", shape=Box(half_extents=(0.1, 0.1, 0.1)), position=(0.0, 0.0, 3.0))
    world = pendulum()
    held = world.joints[0].model_copy(update={"other": "cart"})
    both = world.model_copy(update={"objects": (*world.objects, cart), "joints": (held,)})
    assert "hinge 'hinge' holds it to a moving body" in refusal("object,t,theta\nbob,0,0\n", world=both)
    upright = pendulum(environment={"gravity": (0.0, -9.81, 0.0)})
    assert "hangs nowhere" in refusal(text, RecordingForm(theta_hanging=0.0), upright)


def test_the_zero_of_an_angle_that_was_not_measured_is_refused() -> None:
    for form, name in (
        (RecordingForm(theta_hanging=0.0), "hanging"),
        (RecordingForm(theta_described=0.1), "described"),
    ):
        assert f"line 2: theta_{name} is given, but column theta is missing" in refusal("# a\nt,x\n0,0\n", form)


def test_an_object_that_is_not_among_those_known_is_refused_with_its_first_line() -> None:
    text = "run;body;t;x\n1;red;0;0\n1;Blue;0;1\n1;Blue;1;1\n"
    with pytest.raises(ValueError, match=r"\w") as raised:
        parse_recording(text, ("red", "blue"))
    assert str(raised.value) == (
        "line 3: body is 'Blue', but the world has only red, blue (did you mean 'blue'?); describe 'Blue' in the world "
        "or leave its rows out"
    )
    markers = parse_recording("object,t,x,y,z\nrope#0,0,0,0,0\nrope#1,0,1,0,0\n", ("rope",))
    assert markers.runs[0].names == ("rope#0", "rope#1")
