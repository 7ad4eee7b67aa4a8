"""Tracks themselves: pixels, frames that are shown twice, stuck trackers, bodies inside a floor."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from polyworld.data.noise import noise_levels
from polyworld.data.recording import Recording
from polyworld.screening import Screening, screen
from polyworld.screening.grid import grid_step
from polyworld.screening.time_stamps import repeated_rows
from polyworld.screening.tracks import subject
from polyworld.world import StaticObject
from polyworld.world.shapes import Box
from tests.polyworld.screening import cases

WORLD = cases.ball_world()


@cache
def launches() -> Recording:
    times = cases.sampling()
    return cases.recorded(times, cases.bounces(times))


def kinds(screening: Screening) -> list[str]:
    return [f.kind for f in screening.findings]


def steps_of(recording: Recording) -> dict[tuple[str, int], float]:
    tracks = subject(WORLD, recording).tracks
    return {(t.object, axis): float(q) for t in tracks for axis, q in enumerate(t.quantum) if q > 0.0}


def on_pixels(recording: Recording, step: float) -> Recording:
    return cases.altered(recording, lambda r: replace(r, positions=np.round(r.positions / step) * step))


@pytest.mark.parametrize("step", [0.00371, 0.004, 0.01])
def test_pixels_are_measured_and_harmless_where_the_object_crosses_them_in_every_frame(step: float) -> None:
    found = on_pixels(launches(), step)
    assert steps_of(found) == pytest.approx({("ball", axis): step for axis in range(3)}, rel=1e-3)
    assert kinds(screen(WORLD, found)) == []


@pytest.mark.parametrize("decimals", [4, 12])
def test_slow_motion_from_pixel_to_pixel_is_a_caution(decimals: int) -> None:
    world, swing = cases.swinging(cases.sampling(60.0, 6.0))
    coarse = on_pixels(swing, 0.0237)
    rounded = cases.altered(coarse, lambda r: replace(r, positions=np.round(r.positions, decimals)))
    found = screen(world, rounded)
    assert "quantised" in kinds(found)
    assert "repeated_rows" not in kinds(found)
    assert steps_of(rounded)["ball", 0] == pytest.approx(0.0237, rel=0.01)


@pytest.mark.parametrize("seed", range(20))
def test_grid_is_found_whatever_its_origin_and_never_in_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = 0.3 + np.cumsum(rng.uniform(0.0, 0.05, 60))
    noisy = path + 1e-3 * rng.standard_normal(60)
    assert grid_step(noisy, np.diff(noisy)) == 0.0
    step = rng.uniform(0.003, 0.02)
    gridded = 0.123456 + step * np.round(path / step)
    assert grid_step(gridded, np.diff(gridded)) == pytest.approx(step, rel=1e-6)


def test_noise_is_measured_on_smooth_motion_and_on_fast_oscillations() -> None:
    rng = np.random.default_rng(4)
    times = np.arange(300) / 60.0
    values = np.stack([times**2, np.sin(2.0 * np.pi * 6.0 * times)], axis=1)
    found = noise_levels(times, values + 1e-3 * rng.standard_normal(values.shape))
    assert found[0] == pytest.approx(1e-3, rel=0.2)
    assert found[1] == pytest.approx(1e-3, rel=1.5)


def test_every_second_row_of_a_slower_source_is_a_repeat() -> None:
    times = cases.sampling(60.0, 1.0)
    rng = np.random.default_rng(2)
    fall = np.stack([1.5 * times, 2.0 - 0.5 * cases.G * times**2], axis=1) + 1e-4 * rng.standard_normal((60, 2))
    shown = fall[np.arange(60) // 2 * 2]
    again = np.flatnonzero(repeated_rows(times, shown))
    assert np.array_equal(again, np.arange(3, 59, 2))  # the first and the last pair have motion on one side only
    assert repeated_rows(times, fall).sum() == 0


def test_clips_that_show_frames_twice_are_a_caution() -> None:
    twice = cases.altered(launches(), lambda r: replace(r, positions=r.positions[np.arange(len(r.times)) // 2 * 2]))
    (found,) = screen(WORLD, twice).findings
    assert (found.kind, found.severity) == ("repeated_rows", "caution")
    repeated, rows = cases.numbers(found)[-2:]
    assert repeated / rows == pytest.approx(0.5, abs=0.02)


def test_a_track_that_is_stuck_in_one_run_is_a_caution() -> None:
    recording = launches()
    first = recording.runs[0]
    stuck = replace(first, positions=np.tile(first.positions[:1], (len(first.times), 1, 1)))
    (found,) = screen(WORLD, Recording((stuck, *recording.runs[1:]))).findings
    assert (found.kind, found.severity, "run run_0," in found.message) == ("constant", "caution", True)


def test_recordings_without_motion_are_refused_where_constant_and_a_caution_where_noisy() -> None:
    times = cases.sampling(60.0, 1.0)
    still = np.tile([[[0.0, 0.0, cases.RADIUS]], [[0.5, 0.0, cases.RADIUS]]], (1, len(times), 1))
    assert screen(WORLD, cases.recorded(times, still, 0.0)).refused
    noisy = screen(WORLD, cases.recorded(times, still, 1e-3))
    assert not noisy.refused
    assert "at_rest" in kinds(noisy)


def test_a_floor_that_is_too_high_and_a_radius_that_is_too_large_are_cautions() -> None:
    (found,) = screen(cases.ball_world(floor=0.1), launches()).findings
    assert (found.kind, found.severity) == ("penetration", "caution")
    assert "floor" in found.message
    assert 0.0 < cases.numbers(found)[0] < 100.0  # mm
    (found,) = screen(cases.ball_world(radius=1.6 * cases.RADIUS), launches()).findings
    assert found.kind == "penetration"
    assert kinds(screen(cases.ball_world(radius=1.03 * cases.RADIUS), launches())) == []


def test_a_disc_inside_a_wall_of_a_planar_world_is_a_caution_although_its_height_was_not_measured() -> None:
    times = cases.sampling(60.0, 1.0)
    starts = [((0.0, 0.0, 0.0), (1.0 + 0.1 * k, 0.0, 0.0)) for k in range(3)]
    recording = cases.recorded(times, cases.bounces(times, starts, floor=False, gravity=0.0))
    flat = cases.altered(recording, lambda r: replace(r, positions=r.positions * [1.0, 1.0, np.nan]))
    block = StaticObject(name="block", shape=Box(half_extents=(0.1, 0.5, 0.1)), position=(0.6, 0.0, 0.0))
    world = cases.table_world()
    assert "penetration" not in kinds(screen(world, flat))
    found = screen(world.model_copy(update={"statics": (block,)}), flat)
    assert "penetration" in kinds(found)
