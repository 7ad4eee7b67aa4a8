"""Units of length and time, axes and time stamps, read from free flight and from the stamps themselves."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.screening import Finding, screen
from polyworld.world import Effect, Environment, World
from tests.polyworld.screening import cases

WORLD = cases.ball_world()


@cache
def launches(rate: float = 120.0, drag: float = 0.0, noise: float = 1e-3) -> Recording:
    times = cases.sampling(rate)
    return cases.recorded(times, cases.bounces(times, law=cases.drag(drag) if drag else None), noise)


def only(world: World, recording: Recording) -> Finding:
    (finding,) = screen(world, recording).findings
    return finding


@pytest.mark.parametrize("drag", [0.0, 0.3])
@pytest.mark.parametrize(("unit", "factor"), [("mm", 1000.0), ("cm", 100.0), ("in", 39.3701), ("ft", 3.28084)])
def test_positions_in_other_units_are_refused_and_the_unit_is_named(unit: str, factor: float, drag: float) -> None:
    found = only(WORLD, cases.scaled(launches(drag=drag), space=factor))
    assert (found.kind, found.severity) == ("units", "refuse")
    assert f"--units {unit}," in found.message
    assert cases.numbers(found)[0] == pytest.approx(factor, rel=0.1)


def test_positions_in_pixels_are_a_caution_because_their_scale_is_unknown() -> None:
    found = only(WORLD, cases.scaled(launches(), space=437.0))
    assert (found.kind, found.severity) == ("units", "caution")
    assert "--pixels-per-metre" in found.message
    assert cases.numbers(found)[0] == pytest.approx(437.0, rel=0.01)


@pytest.mark.parametrize("space", [1.0, 1000.0])
def test_times_in_milliseconds_are_refused(space: float) -> None:
    found = only(WORLD, cases.scaled(launches(), space=space, time=1000.0))
    assert (found.kind, found.severity) == ("units", "refuse")
    assert "milliseconds" in found.message
    assert ("--units mm" in found.message) is (space == 1000.0)


@pytest.mark.parametrize(("rate", "drag"), [(24.0, 0.0), (30.0, 0.3), (60.0, 0.05), (120.0, 0.0)])
def test_frame_numbers_are_refused_and_gravity_gives_the_frame_rate(rate: float, drag: float) -> None:
    recording = cases.altered(launches(rate, drag), lambda r: replace(r, times=np.arange(len(r.times)) * 1.0))
    found = only(WORLD, recording)
    assert (found.kind, found.severity) == ("frame_numbers", "refuse")
    assert f"--fps {rate:g}," in found.message


@pytest.mark.parametrize(
    ("axes", "signs", "up", "word"),
    [
        ((0, 2, 1), (1.0, 1.0, 1.0), "y", "swapped"),
        ((0, 2, 1), (1.0, -1.0, 1.0), "-y", "swapped"),
        ((2, 0, 1), (1.0, 1.0, 1.0), "x", "swapped"),
        ((2, 0, 1), (-1.0, 1.0, 1.0), "-x", "swapped"),
        ((0, 1, 2), (1.0, 1.0, -1.0), "-z", "flipped"),
    ],
)
def test_swapped_and_flipped_axes_are_refused_and_both_cures_work(
    axes: tuple[int, ...], signs: tuple[float, ...], up: str, word: str
) -> None:
    recording = cases.relabelled(launches(), axes, signs)
    found = only(WORLD, recording)
    assert (found.kind, found.severity) == ("axes", "refuse")
    assert word in found.message
    # What the message says to write for the columns sets the data right, and keeps them right-handed.
    columns, flips = [0, 1, 2], [1.0, 1.0, 1.0]
    for part in found.message.split("write ")[1].split(" for the columns")[0].split(", "):
        new, old = part.split(" = ")
        columns["xyz".index(new)] = "xyz".index(old[-1])
        flips["xyz".index(new)] = -1.0 if old.startswith("-") else 1.0
    assert columns[2] == "xyz".index(up[-1])
    assert np.linalg.det(np.eye(3)[columns] * np.array(flips)[:, None]) == pytest.approx(1.0)
    assert screen(WORLD, cases.relabelled(recording, columns, flips)).findings == ()
    gravity = found.message.split("gravity (")[1].split(")")[0]
    turned = Environment(gravity=tuple(float(v) for v in gravity.split(", ")))
    assert screen(World(objects=WORLD.objects, environment=turned), recording).findings == ()


def test_a_vertical_axis_that_was_never_measured_is_noticed() -> None:
    """Two columns x and y of a video with y up, in a world with z up."""
    recording = cases.altered(
        cases.relabelled(launches(), (0, 2, 1)), lambda r: replace(r, positions=r.positions * [1.0, 1.0, np.nan])
    )
    found = only(WORLD, recording)
    assert (found.kind, found.severity) == ("axes", "refuse")
    assert "which was not measured" in found.message


def test_nothing_is_said_about_units_without_gravity_on_tables_on_joints_and_under_driving_effects() -> None:
    in_millimetres = cases.scaled(launches(), space=1000.0)
    weightless = World(objects=WORLD.objects, environment=Environment(gravity=(0.0, 0.0, 0.0)))
    driven = WORLD.model_copy(
        update={"effects": (Effect(name="push", kind="uniform_acceleration", parameters={"a_x": 9000.0}),)}
    )
    pendulum, swing = cases.swinging(cases.sampling(60.0, 3.0), noise=1e-3)
    for world, recording in (
        (weightless, in_millimetres),
        (cases.table_world(), in_millimetres),
        (driven, in_millimetres),
        (pendulum, cases.scaled(swing, space=1000.0)),
    ):
        assert not {"units", "axes"} & {f.kind for f in screen(world, recording).findings}


def test_frame_numbers_and_milliseconds_on_a_table_are_cautions() -> None:
    times = cases.sampling(60.0, 1.0)
    starts = [((0.0, 0.0, 0.0), (1.0 + 0.2 * k, 0.3 * k - 0.5, 0.0)) for k in range(5)]
    recording = cases.recorded(times, cases.bounces(times, starts, floor=False, gravity=0.0))
    table = cases.table_world()
    assert screen(table, recording).findings == ()
    frames = only(table, cases.altered(recording, lambda r: replace(r, times=np.arange(60) * 1.0)))
    assert (frames.kind, frames.severity) == ("frame_numbers", "caution")
    assert "--fps" in frames.message
    milliseconds = only(table, cases.scaled(recording, time=1000.0))
    assert (milliseconds.kind, milliseconds.severity) == ("milliseconds", "caution")
    assert 60.0 in cases.numbers(milliseconds)


@pytest.mark.parametrize("decimals", [2, 3])
def test_rounded_time_stamps_are_a_caution_where_they_make_the_noise(decimals: int) -> None:
    def rounded(run: Run) -> Run:
        return replace(run, times=np.round(run.times, decimals))

    found = only(WORLD, cases.altered(launches(60.0, noise=3e-4), rounded))
    assert found.kind == "rounded_times"
    assert 10.0**-decimals in cases.numbers(found)
    assert cases.numbers(found)[-1] == pytest.approx(60.0, rel=0.01)
    # Milliseconds do no harm beside a noise of a centimetre.
    assert screen(WORLD, cases.altered(launches(60.0, noise=1e-2), rounded)).findings == () or decimals == 2


def test_irregular_stamps_are_a_caution_and_missing_frames_are_not() -> None:
    rng = np.random.default_rng(1)
    uneven = cases.altered(launches(), lambda r: replace(r, times=r.times + rng.uniform(-0.3, 0.3, len(r.times)) / 120))
    assert only(WORLD, uneven).kind == "irregular_times"
    gaps = cases.altered(launches(), lambda r: r.rows(rng.random(len(r.times)) > 0.15))
    assert screen(WORLD, gaps).findings == ()
